//! The four-wheeled robot.

pub mod checks;
pub mod problem;
pub mod simulate;

use crate::simulate::Simulation;
use crate::vehicle::{Seat, Vehicle};
use wheelstate::Variables;
use wheelstate::estimator::wheeled_robot::{Parameters, WheeledRobot};

/// The record.
pub static VEHICLE: Vehicle = Vehicle {
    name: "wheeled-robot",
    about: "Four-wheeled robot or car",
    estimator: Seat::of::<WheeledRobot>(),
    problem: problem::PROBLEM,
    checks: checks::CHECKS,
    simulation: Simulation {
        scenarios: simulate::SCENARIOS,
        run: simulate::simulate,
        companions: |_| Ok(Vec::new()),
        manoeuvres: simulate::MANOEUVRES,
    },
    needed: &[&["steering_angle", "drive_torque_*", "brake_torque_*", "wheel_speed_*", "gyro_z"]],
    noise_floors,
    body_tree: false,
};

/// Power spectral densities of the accelerations `2 sigma_F/m, Kf sigma_delta/m, lf Kf sigma_delta/Iz` held over a sample
/// period, `Kf` of both front wheels: no model predicts better.
fn noise_floors(parameters: &[f64]) -> Vec<(String, f64)> {
    let mut p = Parameters::default();
    p.read(parameters);
    let (v, o, dt) = (&p.vehicle, &p.observer, p.sample_period);
    let kappa = (o.gain + o.amplitude * o.steepness).min(1.9 / dt);
    let noise = o.measurement_std.wheel_speed * (2.0 / (2.0 - kappa * dt)).sqrt();
    let force = p.wheel.inertia / p.wheel.radius * kappa * noise;
    let steered = p.steering_acceleration_std();
    [
        ("filter.process_psd.speed_x", 2.0 * force / v.mass),
        ("filter.process_psd.speed_y", steered),
        ("filter.process_psd.yaw_rate", v.cg_to_front * v.mass * steered / v.yaw_inertia),
    ]
    .map(|(name, acceleration)| (name.to_owned(), acceleration * acceleration * dt))
    .to_vec()
}
