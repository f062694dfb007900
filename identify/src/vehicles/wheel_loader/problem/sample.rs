//! Samples of a loader's log and the forces and loads that follow from them.

use super::{CLUSTER, HEIGHT, RADII, RATIO, ROLLING, STIFFNESS};
use crate::log::Log;
use crate::problem::{FitError, Known};
use wheelstate::estimator::wheel_loader::Parameters;
use wheelstate::model::wheel_loader::{Drive, GRAVITY, Loader, WheelLoader};

/// Share of `tau_fr`, by which the front wheel speed is later than the rear one, in how late the speed is against that of
/// each axle.
pub const SHARE_APART: [f64; 2] = [-0.5, 0.5];

/// What is known of the machine, and of its logs' clocks.
#[derive(Clone, Debug)]
pub struct Machine {
    /// Masses, lengths and rolling resistance as given.
    pub model: WheelLoader,
    /// Rolling radii, m.
    pub radius: [f64; 2],
    /// Relative standard deviation of the radii as given.
    pub radius_std: f64,
    /// Rolling resistance coefficient.
    pub rolling: f64,
    /// Standard deviations of the speed and of the wheel speeds.
    pub noise: [f64; 2],
    /// `[K, lambda, h]` about which is linearised.
    pub unknowns: [f64; 3],
    /// How late the speed of each log is against its wheel speeds, s: about which is linearised.
    pub late: Vec<f64>,
    /// What is known of that beforehand, standard deviation, s.
    pub late_std: f64,
    /// How late the front wheel speed of each log is against the rear one, s: about which is linearised.
    pub apart: Vec<f64>,
    /// What is known of that beforehand, standard deviation, s.
    pub apart_std: f64,
}

impl Machine {
    /// From the known parameters, for so many logs.
    pub fn new(known: &Known, logs: usize) -> Self {
        Self {
            model: known.parameters::<Parameters>().machine(),
            radius: [known.get(RADII[0]), known.get(RADII[1])],
            radius_std: known.get("initial.wheel_radius_std"),
            rolling: known.get(ROLLING),
            noise: [known.get("filter.measurement_std.speed"), known.get("filter.measurement_std.wheel_speed")],
            unknowns: [known.get(STIFFNESS), known.get(RATIO), known.get(HEIGHT)],
            late: vec![0.0; logs],
            late_std: 0.0,
            apart: vec![0.0; logs],
            apart_std: 0.0,
        }
    }

    /// How late the speed of a log is against the wheel speed of an axle, s: `tau - tau_fr/2` of the front one and
    /// `tau + tau_fr/2` of the rear one.
    pub fn late_against(&self, log: usize, axle: usize) -> f64 {
        self.late[log] + SHARE_APART[axle] * self.apart[log]
    }

    /// Smooth sign `s(v)` of a speed.
    pub fn sense(&self, speed: f64) -> f64 {
        (speed / self.model.rolling.smoothing_speed).tanh()
    }
}

/// One sample of a log.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Net torque of each axle, brakes subtracted, N.m.
    pub torque: [f64; 2],
    /// What acts on the machine.
    pub drive: Drive,
    /// Measured speed, m/s.
    pub speed: f64,
    /// The speed averaged over a quarter of a second: a weight that does not share the slip's noise.
    pub smooth: f64,
    /// Measured wheel speeds, rad/s.
    pub wheel: [f64; 2],
    /// Gravity along the ground, `g sin alpha`, and across it, `g cos alpha`, m/s2.
    pub gravity: [f64; 2],
    /// Smooth sign of the speed.
    pub sense: f64,
}

/// What the forces of a sample make of it, without slip.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// `g_i` of each axle: its load is `g_i . (1, lambda, h)`.
    pub load_row: [[f64; 3]; 2],
    /// Torque of each axle that reaches the ground, N.m.
    pub traction: [f64; 2],
    /// `v'`, m/s2.
    pub rate: f64,
}

/// A log as its samples.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its samples.
    pub samples: Vec<Sample>,
    /// Time between two of them, s.
    pub period: f64,
}

impl Run {
    /// From a log; brakes, slope and spading forces may be absent and are then zero.
    pub fn new(log: &Log, machine: &Machine) -> Result<Self, FitError> {
        let zeros = vec![0.0; log.len()];
        let optional = |name: &str| log.channel(name).unwrap_or(&zeros);
        let period = log.period();
        let torque = [log.require("torque_front")?, log.require("torque_rear")?];
        let wheel = [log.require("wheel_speed_front")?, log.require("wheel_speed_rear")?];
        let speed = log.require("speed")?;
        let brake = [optional("brake_front"), optional("brake_rear")];
        let (slope, push, pull) = (optional("slope"), optional("spading_force_x"), optional("spading_force_z"));
        let mut run = Self { samples: Vec::with_capacity(log.len()), period };
        let reach = run.steps(CLUSTER) / 2;
        run.samples.extend((0..log.len()).map(|k| {
            let drive = Drive {
                torque: [torque[0][k], torque[1][k]],
                brake: [brake[0][k], brake[1][k]],
                slope: slope[k],
                force_x: push[k],
                force_z: pull[k],
            };
            let sense = machine.sense(speed[k]);
            let net = |i: usize| drive.torque[i] - drive.brake[i].abs() * sense;
            Sample {
                torque: [net(0), net(1)],
                drive,
                speed: speed[k],
                smooth: average(speed, k, reach),
                wheel: [wheel[0][k], wheel[1][k]],
                gravity: [GRAVITY * slope[k].sin(), GRAVITY * slope[k].cos()],
                sense,
            }
        }));
        Ok(run)
    }

    /// The speed that belongs to sample `k`, which has one, if the speed is late by so much: between two samples on a
    /// straight line; NaN where there are none that near.
    pub fn speed(&self, k: usize, late: f64) -> f64 {
        let at = k as f64 + late / self.period;
        let speed = |index: usize| self.samples.get(index).map(|sample| sample.speed).filter(|speed| speed.is_finite());
        if at < 0.0 || speed(k).is_none() {
            return f64::NAN;
        }
        let floor = at as usize;
        if at == floor as f64
            && let Some(speed) = speed(floor)
        {
            return speed;
        }
        // A channel that is recorded more slowly has samples in between that are missing.
        let reach = self.steps(CLUSTER);
        let recorded = |index: usize| Some((index as f64, speed(index)?));
        let before = (floor.saturating_sub(reach)..=floor).rev().find_map(recorded);
        let after = (floor + 1..=floor + reach).find_map(recorded);
        match (before, after) {
            (Some((from, before)), Some((to, after))) => before + (at - from) / (to - from) * (after - before),
            _ => f64::NAN,
        }
    }

    /// Adds to the slope.
    pub fn tilt(&mut self, slope: f64) {
        for sample in &mut self.samples {
            let [along, across] = sample.gravity;
            sample.gravity = [along + across * slope, across];
        }
    }

    /// Steps between samples in a time, at least one.
    pub fn steps(&self, seconds: f64) -> usize {
        ((seconds / self.period).round() as usize).max(1)
    }

    /// Number of the cluster of a sample.
    pub fn cluster(&self, sample: usize) -> u32 {
        (sample / self.steps(CLUSTER)) as u32
    }
}

/// Mean of the samples around `k`, missing ones left out.
fn average(values: &[f64], k: usize, reach: usize) -> f64 {
    let around = &values[k.saturating_sub(reach)..(k + reach + 1).min(values.len())];
    let (sum, count) =
        around.iter().filter(|value| value.is_finite()).fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

impl Sample {
    /// Force balance. The specific force comes from the forces alone: `a_s = v' + g sin alpha`,
    /// `v' = (sum T/r - f W - F_x - m g sin alpha) / (m + sum I/r^2)`; the spinning masses feel `v'`, not `a_s`.
    pub fn balance(&self, machine: &Machine) -> Balance {
        let Machine { model, radius, rolling, .. } = machine;
        let Loader { mass, wheelbase: l, bucket_reach: reach, bucket_height: height, .. } = model.loader;
        let inertia = model.loader.axle_inertia();
        let spinning: f64 = (0..2).map(|i| inertia[i] / (radius[i] * radius[i])).sum();
        let drive: f64 = (0..2).map(|i| self.torque[i] / radius[i]).sum();
        let (push, pull) = (self.drive.force_x, self.drive.force_z);
        let [along, across] = self.gravity;
        let rolling = rolling * self.sense * (mass * across + pull);
        let rate = (drive - rolling - push - mass * along) / (mass + spinning);
        let (a_s, weight) = (rate + along, mass * across);
        Balance {
            load_row: [
                [pull * (l + reach) / l - push * height / l, weight, -mass / l * a_s],
                [weight - pull * reach / l + push * height / l, -weight, mass / l * a_s],
            ],
            traction: std::array::from_fn(|i| self.torque[i] - inertia[i] * rate / radius[i]),
            rate,
        }
    }
}
