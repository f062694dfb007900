//! What no input tells the robot: how late a speed over ground comes, and what its brakes hold on a slope.

use super::drive::{drive, drive_with, machine, parameters, run};
use wheelstate::estimator::wheeled_robot::Channels;

/// Speed from a satellite receiver, ten times a second and a tenth of a second late, of a robot that accelerates and brakes by
/// up to 4 m/s².
#[test]
fn a_speed_over_ground_that_comes_late_is_not_believed_to_its_noise() {
    let wrong_and_healthy = |delay_std: f64, seed: u64| {
        let log = drive_with(&machine(), seed, 20.0, 3.0, 0.1, |t, _| 9.0 * (1.6 * t).sin());
        let mut p = parameters(Channels::WheelSpeed);
        p.filter.use_speed = true;
        p.filter.measurement_std.speed_delay = delay_std;
        let outputs = run(&p, &log, |k, i| {
            if k % 10 == 0 {
                i.speed = log[k.saturating_sub(10)].1[0];
            }
        });
        let wrong = outputs
            .iter()
            .zip(&log)
            .skip(100)
            .filter(|(o, (_, x))| o.diagnostics.healthy && (o.speed_x.value - x[0]).abs() > 3.0 * o.speed_x.std);
        wrong.count() as f64 / (log.len() - 100) as f64
    };
    let default = parameters(Channels::WheelSpeed).filter.measurement_std.speed_delay;
    for seed in 7000..7004 {
        let (counted, taken_for_right) = (wrong_and_healthy(default, seed), wrong_and_healthy(0.0, seed));
        println!("healthy and wrong: {counted:.3}; if it is taken for right {taken_for_right:.3}");
        assert!(counted <= 0.01 && taken_for_right > 0.05);
    }
}

/// Gravity's share on a slope of 5 degrees, which the brakes hold and no sensor of the robot shows.
#[test]
fn brakes_that_hold_on_a_slope_may_hold_that_much() {
    let mut p = parameters(Channels::WheelSpeed);
    p.initial.speed_x = 0.0;
    let held = 0.25 * p.vehicle.mass * 9.81 * 5_f64.to_radians().sin();
    let log = drive(1, 3.0, 0.0, 0.0);
    let braked = run(&p, &log, |_, i| {
        (i.brake_torque_fl, i.brake_torque_fr, i.brake_torque_rl, i.brake_torque_rr) = (20.0, 20.0, 20.0, 20.0);
    });
    for o in braked.iter().skip(100) {
        for force in [o.wheel_force_x_fl, o.wheel_force_x_fr, o.wheel_force_x_rl, o.wheel_force_x_rr] {
            assert!((force.value - held).abs() < 3.0 * force.std, "{force:?} where {held} N may be held");
        }
    }
}
