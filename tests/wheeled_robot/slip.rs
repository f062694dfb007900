//! Wheels that slip, spin or lock: the robot's plant with a longitudinal tyre, and the multi-body car.

use super::drive::{DT, machine, parameters, run, sensed};
use super::multibody::{car, sensors};
use crate::support::vector_table;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheeled_robot::{Axle, Channels, Inputs, Outputs};
use wheelstate::plant::wheeled_robot::Controls;

/// Sensors with the true motion.
type Drive = Vec<(Inputs, [f64; 3])>;

/// What a ride asks of the wheels: the torques of drive and brake on each wheel while it pulls or brakes, N m, and the
/// ground's friction under each wheel.
#[derive(Clone, Copy, Debug)]
struct Ride {
    name: &'static str,
    drive: [f64; 4],
    brake: [f64; 4],
    ground: [f64; 4],
    speed: f64,
}

/// Friction gives about 17 N m on a wheel.
const RIDES: [Ride; 6] = [
    Ride { name: "driven hard", drive: [0.0, 0.0, 12.0, 12.0], brake: [0.0; 4], ground: [1.0; 4], speed: 1.5 },
    Ride {
        name: "driven until it spins",
        drive: [0.0, 0.0, 22.0, 22.0],
        brake: [0.0; 4],
        ground: [1.0; 4],
        speed: 1.5,
    },
    Ride { name: "four wheels spin", drive: [22.0; 4], brake: [0.0; 4], ground: [1.0; 4], speed: 1.5 },
    Ride { name: "braked hard", drive: [0.0; 4], brake: [14.0, 14.0, 8.0, 8.0], ground: [1.0; 4], speed: 8.0 },
    Ride { name: "braked until it locks", drive: [0.0; 4], brake: [30.0; 4], ground: [1.0; 4], speed: 8.0 },
    Ride {
        name: "one wheel on ice",
        drive: [0.0, 0.0, 6.0, 6.0],
        brake: [0.0; 4],
        ground: [1.0, 1.0, 1.0, 0.1],
        speed: 2.0,
    },
];

/// Two bursts of half a second to a second, steered a little, between holding the speed.
fn ride(of: &Ride, seed: u64) -> Drive {
    let mut machine = machine();
    (machine.combined, machine.ground) = (true, of.ground);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut start = 1.0;
    let bursts: [(f64, f64); 2] = std::array::from_fn(|_| {
        let from = start + rng.random_range(0.5..1.5);
        let until = from + rng.random_range(0.5..1.0);
        start = until + 2.0;
        (from, until)
    });
    let (swing, rate) = (rng.random_range(0.01..0.05), rng.random_range(1.0..3.0));
    let mut noise = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let mut x = machine.rolling_at(of.speed);
    let mut wanted = of.speed;
    (0..900)
        .map(|k| {
            let time = f64::from(k) * DT;
            let burst = bursts.iter().any(|(from, until)| (*from..*until).contains(&time));
            if burst {
                wanted = x[0].max(0.5);
            }
            let hold = 0.1 * (wanted - x[0]).clamp(-5.0, 5.0) * 9.0;
            let (drive, brake) = if burst { (of.drive, of.brake) } else { ([hold; 4], [0.0; 4]) };
            let steering = swing * (rate * time).sin();
            let controls = Controls { steering, drive, brake };
            let truth = machine.truth(&x, &controls);
            let sample = sensed(&x, &truth, &controls, &mut noise);
            let motion = [x[0], x[1], x[2]];
            x = machine.advance(&x, DT, |_| controls);
            (sample, motion)
        })
        .collect()
}

/// Shares of the samples of speed_x and speed_y that are healthy and beyond three standard deviations; share healthy.
pub fn judge(what: &str, runs: &[(Vec<Outputs>, Drive)]) -> ([f64; 2], f64) {
    let (mut squares, mut within, mut wrong, mut healthy, mut count) = ([0.0; 2], [0.0; 2], [0.0; 2], 0.0, 0.0);
    let samples = runs.iter().flat_map(|(out, drive)| out.iter().zip(drive));
    for (o, (_, truth)) in samples {
        for (i, estimate) in [o.speed_x, o.speed_y].into_iter().enumerate() {
            let error = (estimate.value - truth[i]).abs();
            squares[i] += error * error;
            within[i] += f64::from(error < 2.0 * estimate.std);
            wrong[i] += f64::from(o.diagnostics.healthy && error > 3.0 * estimate.std);
        }
        healthy += f64::from(o.diagnostics.healthy);
        count += 1.0;
    }
    let error = squares.map(|sum: f64| (sum / count).sqrt());
    let ([within, wrong], healthy) = ([within, wrong].map(|n| n.map(|n| n / count)), healthy / count);
    println!(
        "{what}: speed_x, speed_y: error {error:.3?} m/s, within 2 std {within:.3?}, healthy and beyond 3 std \
         {wrong:.4?}; healthy {healthy:.3}"
    );
    (wrong, healthy)
}

/// No torque was ever set: the accelerometer gives the forces.
pub fn without_torques(i: &mut Inputs) {
    for torque in [
        &mut i.drive_torque_fl,
        &mut i.drive_torque_fr,
        &mut i.drive_torque_rl,
        &mut i.drive_torque_rr,
        &mut i.brake_torque_fl,
        &mut i.brake_torque_fr,
        &mut i.brake_torque_rl,
        &mut i.brake_torque_rr,
    ] {
        *torque = f64::NAN;
    }
}

#[test]
fn a_robot_whose_wheels_slip_spin_or_lock_is_not_sure_of_a_wrong_speed() {
    for of in &RIDES {
        let mut p = parameters(Channels::WheelSpeed);
        p.initial.speed_x = of.speed;
        let (mut front, mut known, mut combined) = (p.clone(), p.clone(), p.clone());
        front.filter.speed_axle = Axle::Front;
        known.wheel.slip_stiffness = 15.0;
        // how much of the grip goes into the drive only the friction ellipse says where no torque does
        combined.tire.combined = true;
        let rides: Vec<Drive> = (700..712).map(|seed| ride(of, seed)).collect();
        let variants = [
            ("torques", &p),
            ("slip stiffness", &known),
            ("front wheels", &front),
            ("inclined sensor", &p),
            ("no torques", &p),
            ("no torques, friction ellipse", &combined),
        ];
        for (what, p) in variants {
            let spoil = |_, i: &mut Inputs| match what {
                "no torques" | "no torques, friction ellipse" => without_torques(i),
                // twice the standard deviation that is said by default
                "inclined sensor" => i.accel_x += 0.4,
                _ => {}
            };
            let runs: Vec<_> = rides.iter().map(|drive| (run(p, drive, spoil), drive.clone())).collect();
            let (wrong, healthy) = judge(&format!("{}, {what}", of.name), &runs);
            assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01 && healthy > 0.2, "{} {what}", of.name);
        }
    }
}

#[test]
fn a_multibody_car_whose_wheels_slip_spin_or_lock_is_not_sure_of_a_wrong_speed() {
    for (name, friction) in [("accel_brake", 1.0), ("launch", 1.0), ("stop", 1.0), ("slippery", 0.45)] {
        let table = vector_table(&format!("wheeled_robot/multibody_{name}.csv"));
        let mut p = car(true, friction);
        p.initial.speed_x = table.at(0, "true_speed_x");
        let mut known = p.clone();
        known.wheel.slip_stiffness = 25.0;
        for (what, p) in [("torques", &p), ("slip stiffness", &known), ("no torques", &p)] {
            let spoil = |_, i: &mut Inputs| {
                if what == "no torques" {
                    without_torques(i)
                }
            };
            let one = |seed| {
                let drive = sensors(&table, seed);
                (run(p, &drive, spoil), drive)
            };
            let (wrong, healthy) = judge(&format!("{name}, {what}"), &(900..905).map(one).collect::<Vec<_>>());
            assert!(wrong[0] <= 0.01 && wrong[1] <= 0.01 && healthy > 0.4, "{name} {what}");
        }
    }
}

/// The wheels of an axle behind a differential whose shaft has the only sensor turn at different speeds in a bend.
#[test]
fn one_sensor_for_both_wheels_shows_their_mean() {
    let p = parameters(Channels::WheelSpeed);
    let drive = super::drive::drive(9, 6.0, 3.0, 0.5);
    let shaft = |_, i: &mut Inputs| {
        let mean = 0.5 * (i.wheel_speed_rl + i.wheel_speed_rr);
        (i.wheel_speed_rl, i.wheel_speed_rr) = (mean, mean);
    };
    let out = run(&p, &drive, shaft);
    let apart = drive.iter().filter(|(i, _)| (i.wheel_speed_rl - i.wheel_speed_rr).abs() * 0.15 > 0.3).count();
    assert!(apart > 200, "{apart}");
    for (k, (o, (_, truth))) in out.iter().zip(&drive).enumerate() {
        assert!((o.speed_x.value - truth[0]).abs() < 0.1, "{k}: {} m/s instead of {}", o.speed_x.value, truth[0]);
    }
}
