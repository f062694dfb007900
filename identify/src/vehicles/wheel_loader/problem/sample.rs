//! Samples of a loader's log and the forces and loads that follow from them.

use super::{CLUSTER, HEIGHT, RADII, RATIO, ROLLING, STIFFNESS};
use crate::log::Log;
use crate::problem::{FitError, Known};
use wheelstate::estimator::wheel_loader::Parameters;
use wheelstate::model::wheel_loader::{Drive, GRAVITY, Loader, WheelLoader};

/// What is known of the machine.
#[derive(Clone, Copy, Debug)]
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
}

impl Machine {
    /// From the known parameters.
    pub fn new(known: &Known) -> Self {
        Self {
            model: known.parameters::<Parameters>().machine(),
            radius: [known.get(RADII[0]), known.get(RADII[1])],
            radius_std: known.get("initial.wheel_radius_std"),
            rolling: known.get(ROLLING),
            noise: [known.get("filter.measurement_std.speed"), known.get("filter.measurement_std.wheel_speed")],
            unknowns: [known.get(STIFFNESS), known.get(RATIO), known.get(HEIGHT)],
        }
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
        let torque = [log.require("torque_front")?, log.require("torque_rear")?];
        let wheel = [log.require("wheel_speed_front")?, log.require("wheel_speed_rear")?];
        let speed = log.require("speed")?;
        let brake = [optional("brake_front"), optional("brake_rear")];
        let (slope, push, pull) = (optional("slope"), optional("spading_force_x"), optional("spading_force_z"));
        let mut run = Self { samples: Vec::with_capacity(log.len()), period: log.period() };
        let reach = run.steps(CLUSTER) / 2;
        run.samples.extend((0..log.len()).map(|k| {
            let drive = Drive {
                torque: [torque[0][k], torque[1][k]],
                brake: [brake[0][k], brake[1][k]],
                slope: slope[k],
                force_x: push[k],
                force_z: pull[k],
            };
            let net = |i: usize| drive.torque[i] - drive.brake[i].abs() * machine.sense(speed[k]);
            Sample {
                torque: [net(0), net(1)],
                drive,
                speed: speed[k],
                smooth: average(speed, k, reach),
                wheel: [wheel[0][k], wheel[1][k]],
            }
        }));
        Ok(run)
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
    /// Specific force from the forces alone: `(sum T/r - f W - F_x) / (m + sum I/r^2)`, and `v'`.
    pub fn acceleration(&self, machine: &Machine) -> (f64, f64) {
        let Machine { model, radius, rolling, .. } = machine;
        let (mass, inertia) = (model.loader.mass, model.loader.axle_inertia());
        let spinning: f64 = (0..2).map(|i| inertia[i] / (radius[i] * radius[i])).sum();
        let drive: f64 = (0..2).map(|i| self.torque[i] / radius[i]).sum();
        let gravity = GRAVITY * self.drive.slope.sin();
        // The spinning masses feel v', not the specific force.
        let rate = (drive
            - rolling * machine.sense(self.speed) * model.weight(&self.drive)
            - self.drive.force_x
            - mass * gravity)
            / (mass + spinning);
        (rate + gravity, rate)
    }

    /// `g_i`: the axle's load is `g_i . (1, lambda, h)`.
    pub fn load_row(&self, machine: &Machine, axle: usize) -> [f64; 3] {
        let (a_s, _) = self.acceleration(machine);
        let Loader { mass, wheelbase: l, bucket_reach: reach, bucket_height: height, .. } = machine.model.loader;
        let static_part = mass * GRAVITY * self.drive.slope.cos();
        let (push, pull) = (self.drive.force_x, self.drive.force_z);
        if axle == 0 {
            [pull * (l + reach) / l - push * height / l, static_part, -mass / l * a_s]
        } else {
            [static_part - pull * reach / l + push * height / l, -static_part, mass / l * a_s]
        }
    }

    /// Slip speed `r w - v`, m/s: unlike the slip it has no noise in a denominator.
    pub fn slip_speed(&self, machine: &Machine, axle: usize) -> f64 {
        machine.radius[axle] * self.wheel[axle] - self.speed
    }

    /// Torque that reaches the ground.
    pub fn traction(&self, machine: &Machine, axle: usize) -> f64 {
        let (_, rate) = self.acceleration(machine);
        self.torque[axle] - machine.model.loader.axle_inertia()[axle] * rate / machine.radius[axle]
    }
}
