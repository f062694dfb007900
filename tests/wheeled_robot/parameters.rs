//! Vehicles that are not as the parameters say: yaw inertia, place of the centre of gravity, an acceleration that nothing shows.

use super::drive::{drive_of, machine, parameters, run};
use super::multibody::{car, sensors};
use super::slip::{judge, without_torques};
use crate::support::vector_table;
use wheelstate::estimator::wheeled_robot::{Channels, Inputs, Parameters};
use wheelstate::plant::wheeled_robot::Machine;

/// Without any of the two errors considered.
fn sure(p: &Parameters) -> Parameters {
    let mut sure = p.clone();
    (sure.vehicle.yaw_inertia_std, sure.vehicle.cg_std) = (0.0, 0.0);
    sure
}

/// Yaw inertia 20 % off, the centre of gravity 5 cm of 80: one standard deviation and a little more.
#[test]
fn a_wrong_yaw_inertia_or_centre_of_gravity_of_a_robot_is_in_the_standard_deviations() {
    for (inertia, ahead) in [(1.2, 0.0), (0.8, 0.0), (1.0, 0.05), (1.0, -0.05), (1.2, 0.05), (0.8, -0.05)] {
        let Machine { arms: [front, rear], yaw_inertia, .. } = machine();
        let robot = Machine { yaw_inertia: inertia * yaw_inertia, arms: [front - ahead, rear + ahead], ..machine() };
        // tyres that are known leave nothing else that could explain it
        let mut p = parameters(Channels::WheelSpeed);
        for tire in [&mut p.tire.front, &mut p.tire.rear] {
            (tire.stiffness_std, tire.friction_std) = (0.03, 0.03);
        }
        for swing in [0.1, 0.3] {
            let drives: Vec<_> = (60..66).map(|seed| drive_of(&robot, seed, 8.0, 3.0, swing)).collect();
            let what = format!("inertia {inertia}, {ahead} m ahead, swing {swing}");
            let of = |p: &Parameters, what: &str| {
                let runs: Vec<_> = drives.iter().map(|drive| (run(p, drive, |_, _| {}), drive.clone())).collect();
                judge(what, &runs)
            };
            let (sure, _) = of(&sure(&p), &format!("{what}, not considered"));
            let (wrong, healthy) = of(&p, &what);
            assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01 && healthy > 0.95, "{what}: {wrong:?} {healthy}");
            assert!(ahead == 0.0 || swing < 0.2 || sure[1] > 0.01, "{what} shows in no case: {sure:?}");
        }
    }
}

/// The same of a car of 2.6 m between the axles, on a model of another program: 13 cm.
#[test]
fn a_wrong_yaw_inertia_or_centre_of_gravity_of_a_multibody_car_is_in_the_standard_deviations() {
    for name in ["sine", "dlc", "step", "low_mu"] {
        let table = vector_table(&format!("wheeled_robot/multibody_{name}.csv"));
        for (inertia, ahead) in [(1.2, 0.13), (0.8, 0.13), (1.2, -0.13), (0.8, -0.13)] {
            let mut p = car(true, if name == "low_mu" { 0.45 } else { 1.0 });
            p.initial.speed_x = table.at(0, "true_speed_x");
            p.vehicle.yaw_inertia *= inertia;
            (p.vehicle.cg_to_front, p.vehicle.cg_to_rear) =
                (p.vehicle.cg_to_front + ahead, p.vehicle.cg_to_rear - ahead);
            let what = format!("{name}, inertia {inertia}, {ahead} m");
            let of = |p: &Parameters, what: &str| {
                let one = |seed| {
                    let drive = sensors(&table, seed);
                    (run(p, &drive, |_, _| {}), drive)
                };
                judge(what, &(910..913).map(one).collect::<Vec<_>>())
            };
            of(&sure(&p), &format!("{what}, not considered"));
            let (wrong, healthy) = of(&p, &what);
            assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01 && healthy > 0.95, "{what}: {wrong:?} {healthy}");
        }
    }
}

/// Neither torques nor an accelerometer: wheels that hold the ground are all that shows the speed, and it changes by what a
/// vehicle usually does.
#[test]
fn an_acceleration_that_nothing_shows_is_in_the_standard_deviation_of_the_speed() {
    for (name, torque) in [("drives off", 5.0), ("brakes", -5.0)] {
        let drives: Vec<_> = (70..76).map(|seed| accelerated(seed, torque)).collect();
        let blind = |_, i: &mut Inputs| {
            without_torques(i);
            (i.accel_x, i.accel_y) = (f64::NAN, f64::NAN);
        };
        let p = parameters(Channels::WheelSpeed);
        let runs: Vec<_> = drives.iter().map(|drive| (run(&p, drive, blind), drive.clone())).collect();
        let (wrong, healthy) = judge(name, &runs);
        assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01 && healthy > 0.95, "{name}: {wrong:?} {healthy}");
    }
}

/// A robot on soft tyres that drives off or brakes with 2 m/s2, twice.
fn accelerated(seed: u64, torque: f64) -> Vec<(Inputs, [f64; 3])> {
    let robot = Machine { combined: true, ..machine() };
    super::drive::drive_with(&robot, seed, 8.0, 3.0, 0.05, |time, _| {
        let burst = (1.0..2.0).contains(&time) || (4.0..5.0).contains(&time);
        if burst { torque } else { 0.0 }
    })
}
