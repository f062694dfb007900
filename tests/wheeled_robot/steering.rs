//! A steering angle that is commanded and comes late, and ground that is more slippery than said: axle forces that no error of a
//! constant explains.

use super::drive::{drive_of, machine, parameters, run};
use super::multibody::{car, sensors};
use super::slip::{judge, without_torques};
use crate::support::vector_table;
use wheelstate::estimator::wheeled_robot::{Channels, Inputs, Parameters};
use wheelstate::plant::wheeled_robot::Machine;

type Drive = Vec<(Inputs, [f64; 3])>;

/// With the steering angle that the wheels will have so many samples later.
fn commanded(drives: &[Drive], p: &Parameters, early: usize, torques: bool, what: &str) -> ([f64; 2], f64) {
    let runs: Vec<_> = drives
        .iter()
        .map(|drive| {
            let spoil = |k: usize, i: &mut Inputs| {
                i.steering_angle = drive[(k + early).min(drive.len() - 1)].0.steering_angle;
                if !torques {
                    without_torques(i);
                }
            };
            (run(p, drive, spoil), drive.clone())
        })
        .collect();
    judge(what, &runs)
}

#[test]
fn a_robot_whose_steering_angle_is_the_command_is_not_sure_of_a_wrong_lateral_speed() {
    for (name, ground) in [("dry", 1.0), ("slippery", 0.6)] {
        let robot = Machine { ground: [ground; 4], combined: true, ..machine() };
        let p = parameters(Channels::WheelSpeed);
        // the largest swing takes the front tyres far beyond their peak: 0.2 s late it is wrong and healthy in up to 5 %
        for (swing, latest) in [(0.1, 20), (0.3, 20), (0.5, 15)] {
            let drives: Vec<_> = (6000..6008).map(|seed| drive_of(&robot, seed, 8.0, 3.0, swing)).collect();
            for early in [5, 10, 15, 20].into_iter().filter(|early| *early <= latest) {
                for torques in [true, false] {
                    let what = format!("{name}, swing {swing}, {early}0 ms, torques {torques}");
                    let (wrong, healthy) = commanded(&drives, &p, early, torques, &what);
                    assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01, "{what}: {wrong:?} {healthy}");
                }
            }
        }
    }
}

#[test]
fn a_multibody_car_whose_steering_angle_is_the_command_is_not_sure_of_a_wrong_lateral_speed() {
    for name in ["sine", "dlc", "step", "low_mu"] {
        let table = vector_table(&format!("wheeled_robot/multibody_{name}.csv"));
        let mut p = car(true, if name == "low_mu" { 0.45 } else { 1.0 });
        p.initial.speed_x = table.at(0, "true_speed_x");
        let drives: Vec<_> = (6010..6014).map(|seed| sensors(&table, seed)).collect();
        for early in [0, 5, 10, 15, 20] {
            let what = format!("{name}, {early}0 ms");
            let (wrong, healthy) = commanded(&drives, &p, early, true, &what);
            assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01, "{what}: {wrong:?} {healthy}");
        }
    }
}
