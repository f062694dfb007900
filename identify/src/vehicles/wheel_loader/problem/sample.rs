//! Samples of a loader's log and the forces and loads that follow from them.

use super::{CLUSTER, HEIGHT, RADII, RATIO, ROLLING, STIFFNESS};
use crate::log::Log;
use crate::problem::{FitError, Known};
use wheelstate::model::wheel_loader::GRAVITY;

/// What is known of the machine.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Mass, kg.
    pub mass: f64,
    /// Wheelbase, m.
    pub wheelbase: f64,
    /// Axle inertias, kg.m2.
    pub inertia: [f64; 2],
    /// Reach and height of the bucket's tip, m.
    pub bucket: [f64; 2],
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
            mass: known.get("loader.mass"),
            wheelbase: known.get("loader.wheelbase"),
            inertia: [known.get("loader.axle_inertia_front"), known.get("loader.axle_inertia_rear")],
            bucket: [known.get("loader.bucket_reach"), known.get("loader.bucket_height")],
            radius: [known.get(RADII[0]), known.get(RADII[1])],
            radius_std: known.get("initial.wheel_radius_std"),
            rolling: known.get(ROLLING),
            noise: [known.get("filter.measurement_std.speed"), known.get("filter.measurement_std.wheel_speed")],
            unknowns: [known.get(STIFFNESS), known.get(RATIO), known.get(HEIGHT)],
        }
    }
}

/// One sample of a log.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Net torque of each axle, brakes subtracted, N.m.
    pub torque: [f64; 2],
    /// Slope, rad.
    pub slope: f64,
    /// Spading forces backwards and down, N.
    pub force: [f64; 2],
    /// Measured speed, m/s.
    pub speed: f64,
    /// The speed averaged over a quarter of a second: a weight that does not share the slip's noise.
    pub smooth: f64,
    /// Measured wheel speeds, rad/s.
    pub wheel: [f64; 2],
}

/// The samples of a log; brakes, slope and spading forces may be absent and are then zero.
pub fn samples(log: &Log) -> Result<Vec<Sample>, FitError> {
    let zeros = vec![0.0; log.len()];
    let optional = |name: &str| log.channel(name).unwrap_or(&zeros);
    let torque = [log.require("torque_front")?, log.require("torque_rear")?];
    let wheel = [log.require("wheel_speed_front")?, log.require("wheel_speed_rear")?];
    let speed = log.require("speed")?;
    let brake = [optional("brake_front"), optional("brake_rear")];
    let (slope, push, pull) = (optional("slope"), optional("spading_force_x"), optional("spading_force_z"));
    Ok((0..log.len())
        .map(|k| {
            let net = |i: usize| torque[i][k] - brake[i][k].abs() * (speed[k] / 0.05).tanh();
            Sample {
                torque: [net(0), net(1)],
                slope: slope[k],
                force: [push[k], pull[k]],
                speed: speed[k],
                smooth: average(speed, k),
                wheel: [wheel[0][k], wheel[1][k]],
            }
        })
        .collect())
}

/// Mean of the samples around `k`, missing ones left out.
fn average(values: &[f64], k: usize) -> f64 {
    let around = &values[k.saturating_sub(CLUSTER / 2)..(k + CLUSTER / 2 + 1).min(values.len())];
    let (sum, count) =
        around.iter().filter(|value| value.is_finite()).fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

impl Sample {
    /// Load on both axles, N.
    pub fn weight(&self, machine: &Machine) -> f64 {
        machine.mass * GRAVITY * self.slope.cos() + self.force[1]
    }

    /// Specific force from the forces alone: `(sum T/r - f W - F_x) / (m + sum I/r^2)`, and `v'`.
    pub fn acceleration(&self, machine: &Machine) -> (f64, f64) {
        let Machine { mass, inertia, radius, rolling, .. } = *machine;
        let sense = (self.speed / 0.05).tanh();
        let spinning: f64 = (0..2).map(|i| inertia[i] / (radius[i] * radius[i])).sum();
        let drive: f64 = (0..2).map(|i| self.torque[i] / radius[i]).sum();
        let gravity = GRAVITY * self.slope.sin();
        // The spinning masses feel v', not the specific force.
        let rate =
            (drive - rolling * sense * self.weight(machine) - self.force[0] - mass * gravity) / (mass + spinning);
        (rate + gravity, rate)
    }

    /// `g_i`: the axle's load is `g_i . (1, lambda, h)`.
    pub fn load_row(&self, machine: &Machine, axle: usize) -> [f64; 3] {
        let (a_s, _) = self.acceleration(machine);
        let Machine { mass, wheelbase: l, bucket: [reach, height], .. } = *machine;
        let static_part = mass * GRAVITY * self.slope.cos();
        let [push, pull] = self.force;
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
        self.torque[axle] - machine.inertia[axle] * rate / machine.radius[axle]
    }
}
