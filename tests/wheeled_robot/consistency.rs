//! Whether the wheeled robot's estimator knows how wrong it is: wrong units and signs, noise beyond what was declared,
//! gaps.

use super::drive::{DT, drive, parameters, run};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheeled_robot::{Channels, Inputs, Outputs, Parameters, WheeledRobot};
use wheelstate::{Estimator, Status};

fn each_wheel(i: &mut Inputs, change: impl Fn(f64) -> f64) {
    for speed in [&mut i.wheel_speed_fl, &mut i.wheel_speed_fr, &mut i.wheel_speed_rl, &mut i.wheel_speed_rr] {
        *speed = change(*speed);
    }
}

/// A name and what it does to the measurements.
type Fault = (&'static str, fn(&mut Inputs));

/// Time after which the measurements contradict, s.
fn contradicted_after(out: &[Outputs]) -> Option<f64> {
    let first = out.iter().position(|o| o.diagnostics.status.contains(Status::CONTRADICTED))?;
    Some(first as f64 * DT)
}

#[test]
fn wrong_units_and_signs_are_contradicted_within_three_seconds() {
    let faults: [Fault; 6] = [
        ("gyro in deg/s", |i| i.gyro_z = i.gyro_z.to_degrees()),
        ("gyro turned", |i| i.gyro_z = -i.gyro_z),
        ("accelerometer turned", |i| i.accel_y = -i.accel_y),
        ("wheel speeds in rpm", |i| each_wheel(i, |speed| speed * 60.0 / std::f64::consts::TAU)),
        ("wheel speeds turned", |i| each_wheel(i, |speed| -speed)),
        ("steering turned", |i| i.steering_angle = -i.steering_angle),
    ];
    for seed in [3, 4] {
        every_fault_is_contradicted(&faults, seed, 0.3);
    }
}

/// Each fault of a log of 10 s, which swings the steering by `swing` rad, is contradicted within 3 s, and the log without
/// a fault is not.
fn every_fault_is_contradicted(faults: &[Fault], seed: u64, swing: f64) {
    let log = drive(seed, 10.0, 3.0, swing);
    let p = parameters(Channels::WheelSpeed);
    assert_eq!(contradicted_after(&run(&p, &log, |_, _| {})), None, "without a fault");
    for (fault, spoil) in faults {
        let out = run(&p, &log, |_, i| spoil(i));
        let after = contradicted_after(&out);
        let healthy = out[300..].iter().filter(|o| o.diagnostics.healthy).count() as f64 / 700.0;
        println!("swing {swing}: {fault}: contradicted after {after:.2?} s, then healthy {healthy:.2} of the time");
        assert!(after.is_some_and(|after| after < 3.0) && healthy < 0.02, "{swing} {fault} {after:?} {healthy}");
    }
}

fn car() -> Parameters {
    let mut p = Parameters::default();
    let v = &mut p.vehicle;
    (v.mass, v.yaw_inertia, v.cg_to_front, v.cg_to_rear) = (1926.2, 2763.49, 1.264, 1.367);
    (v.track_front, v.track_rear, v.cg_height) = (1.54, 1.54, 0.55);
    (p.wheel.radius, p.wheel.inertia, p.sample_period) = (0.32, 1.2, 0.005);
    for (tire, load, stiffness) in [(&mut p.tire.front, 4909.0, 42_722.0), (&mut p.tire.rear, 4539.0, 90_571.0)] {
        (tire.nominal_load, tire.stiffness, tire.friction) = (load, stiffness, 1.0);
    }
    (p.filter.channels, p.filter.use_speed, p.filter.minimum_speed) = (Channels::Gyro, true, 2.0);
    p
}

/// A car that stands for 10 s and then drives straight on, `noisy(t)` being the accelerometer's noise, m/s2: time,
/// lateral speed (truth 0) and outputs after each sample.
fn straight_on(seed: u64, p: &Parameters, noisy: impl Fn(f64) -> f64) -> Vec<(f64, Outputs)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let mut estimator = WheeledRobot::new(p).unwrap();
    let mut out = Outputs::default();
    (0..5000)
        .map(|k| {
            let time = f64::from(k) * p.sample_period;
            let speed = (time - 10.0).clamp(0.0, 10.0) + noise(0.01);
            let (gyro_z, accel_y) = (noise(0.005), noise(noisy(time)));
            let inputs = Inputs { steering_angle: 0.0, speed, gyro_z, accel_y, ..Inputs::default() };
            estimator.step(&inputs, p.sample_period);
            estimator.outputs(&inputs, 0.0, &mut out);
            (time, out.clone())
        })
        .collect()
}

/// The raw accelerometer of a road vehicle is noisier than declared by far. The filter once followed it past the peak of
/// the tyres' force, where the force no longer says how far: 100 m/s sideways at rest, and healthy.
#[test]
fn a_noisy_accelerometer_moves_no_car_sideways() {
    for seed in 1..4 {
        for noisy in [0.1, 1.0, 2.0, 3.0, 4.0, 6.0] {
            let out = straight_on(seed, &car(), |_| noisy);
            let worst = out.iter().map(|(_, o)| o.speed_y.value.abs()).fold(0.0, f64::max);
            let beyond = |many: f64| {
                let far = |(_, o): &&(f64, Outputs)| o.speed_y.value.abs() > many * o.speed_y.std;
                out.iter().filter(far).count() as f64 / out.len() as f64
            };
            let healthy = out.iter().filter(|(_, o)| o.diagnostics.healthy).count() as f64 / out.len() as f64;
            println!("{noisy} m/s2: at most {worst:.3} m/s, beyond 2 std {:.4}, 3 std {:.4}", beyond(2.0), beyond(3.0));
            assert!(worst < 0.4 && beyond(2.0) < 0.05 && beyond(3.0) < 0.01 && healthy > 0.99, "{seed} {noisy}");
        }
    }
}

#[test]
fn the_lateral_speed_recovers_once_the_accelerometer_is_quiet_again() {
    for seed in 1..4 {
        for mut p in [car(), car()] {
            let followed = seed == 2;
            // even where the noise was not adapted to and the sideslip was lost
            p.filter.adaptive = !followed;
            let out = straight_on(seed, &p, |time| if time < 15.0 { 5.0 } else { 0.1 });
            for (time, o) in out.iter().filter(|(time, _)| *time > 19.0) {
                assert!(o.speed_y.value.abs() < 0.1 && o.diagnostics.healthy, "{seed} {time} {o:?}");
            }
        }
    }
}

/// In gentle driving the process noise can follow such measurements, and the innovations stay small.
#[test]
fn wrong_units_and_signs_are_contradicted_in_gentle_driving_too() {
    let faults: [Fault; 8] = [
        ("gyro in deg/s", |i| i.gyro_z = i.gyro_z.to_degrees()),
        ("gyro turned", |i| i.gyro_z = -i.gyro_z),
        ("accelerometer turned", |i| i.accel_y = -i.accel_y),
        ("accelerometer in g", |i| (i.accel_x, i.accel_y) = (i.accel_x / 9.81, i.accel_y / 9.81)),
        ("accelerometer's axes exchanged", |i| (i.accel_x, i.accel_y) = (i.accel_y, i.accel_x)),
        ("wheel speeds in rpm", |i| each_wheel(i, |speed| speed * 60.0 / std::f64::consts::TAU)),
        ("steering turned", |i| i.steering_angle = -i.steering_angle),
        ("steering in degrees", |i| i.steering_angle = i.steering_angle.to_degrees()),
    ];
    for (seed, swing) in [(3, 0.04), (4, 0.06), (5, 0.1)] {
        every_fault_is_contradicted(&faults, seed, swing);
    }
}

/// Tyres, radius and sensors whose errors are drawn from what the parameters declare.
#[test]
fn errors_of_tyres_radius_and_sensors_are_in_the_standard_deviations() {
    let (mut squares, mut within, mut count) = ([0.0; 2], [0.0; 2], 0.0);
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(100 + seed);
        let mut normal = || <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let mut p = parameters(Channels::WheelSpeed);
        for tire in [&mut p.tire.front, &mut p.tire.rear] {
            (tire.stiffness_std, tire.friction_std) = (0.15, 0.15);
            tire.stiffness *= 1.0 + 0.15 * normal();
            let friction = 1.0 + 0.15 * normal();
            (tire.friction, tire.friction_slope) = (tire.friction * friction, tire.friction_slope * friction);
        }
        p.wheel.radius *= 1.0 + p.wheel.radius_std * normal();
        let (bias, angle) =
            (p.imu.accel_y_bias_std * normal(), p.filter.measurement_std.steering_angle_bias * normal());
        let log = drive(seed, 10.0, 3.0, 0.2);
        let out = run(&p, &log, |_, i| {
            i.accel_y += bias;
            i.steering_angle += angle;
        });
        for (o, (_, truth)) in out.iter().zip(&log).skip(100) {
            for (i, estimate) in [o.speed_x, o.speed_y].into_iter().enumerate() {
                let off = (estimate.value - truth[i]) / estimate.std;
                squares[i] += off * off;
                within[i] += f64::from(off.abs() < 2.0);
            }
            assert!(!o.diagnostics.status.contains(Status::CONTRADICTED));
            count += 1.0;
        }
    }
    let (squares, within) = (squares.map(|s| s / count), within.map(|w| w / count));
    println!("speed_x, speed_y: squared errors over variances {squares:.2?}, within two deviations {within:.3?}");
    assert!(within.iter().all(|share| *share > 0.9) && squares.iter().all(|square| (0.2..1.5).contains(square)));
}

#[test]
fn the_channels_shares_add_up_to_the_normalised_innovation_squared() {
    let log = drive(5, 4.0, 3.0, 0.15);
    let out = run(&parameters(Channels::WheelSpeed), &log, |k, i| match k % 4 {
        1 => i.gyro_z = f64::NAN,
        2 => (i.accel_x, i.accel_y) = (f64::NAN, f64::INFINITY),
        _ => {}
    });
    for (k, o) in out.iter().enumerate() {
        let shares = [o.nis_accel_x, o.nis_accel_y, o.nis_gyro_z, o.nis_speed];
        let whole = o.diagnostics.nis * f64::from(o.diagnostics.nis_channels);
        assert!((shares.iter().sum::<f64>() - whole).abs() <= 1e-12 * whole, "{k} {shares:?} {whole}");
        assert_eq!(shares.iter().filter(|share| **share != 0.0).count() as i32, o.diagnostics.nis_channels, "{k}");
    }
}

/// The robot goes on at another speed and in another direction than before the gap.
#[test]
fn after_a_gap_the_truth_lies_within_what_the_estimator_says_it_does_not_know() {
    let drives = [drive(6, 3.0, 3.0, 0.15), drive(7, 3.0, 1.2, 0.3), drive(8, 3.0, 0.0, 0.0)];
    for (before, after) in [(0, 1), (1, 0), (2, 0), (2, 1), (0, 2)] {
        for channels in [Channels::Patent, Channels::Gyro, Channels::WheelSpeed] {
            for gap in [1.5, 5.0, 60.0] {
                for from in (0..200).step_by(20) {
                    let mut estimator = WheeledRobot::new(&parameters(channels)).unwrap();
                    drives[before].iter().for_each(|(inputs, _)| _ = estimator.step(inputs, DT));
                    let mut out = Outputs::default();
                    for (k, (inputs, truth)) in drives[after][from..].iter().take(100).enumerate() {
                        let status = estimator.step(inputs, if k == 0 { gap } else { DT });
                        assert_eq!(status.contains(Status::RESTARTED | Status::BAD_STEP), k == 0);
                        estimator.outputs(inputs, 0.0, &mut out);
                        for (estimate, truth) in [out.speed_x, out.speed_y, out.yaw_rate].into_iter().zip(truth) {
                            let off = (estimate.value - truth).abs() / estimate.std;
                            let what = format!("{before} to {after}, {channels:?}, {gap} s, from {from}, sample {k}");
                            assert!(off < 4.0, "{what}: {estimate:?}, truth {truth}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_torque_that_was_never_set_is_no_torque_of_zero() {
    let log = drive(8, 4.0, 3.0, 0.15);
    let p = parameters(Channels::WheelSpeed);
    let without = |k: usize, i: &mut Inputs| {
        if k < 200 {
            *i = Inputs {
                drive_torque_fl: f64::NAN,
                drive_torque_fr: f64::NAN,
                drive_torque_rl: f64::NAN,
                drive_torque_rr: f64::NAN,
                brake_torque_fl: f64::NAN,
                brake_torque_fr: f64::NAN,
                brake_torque_rl: f64::NAN,
                brake_torque_rr: f64::NAN,
                ..i.clone()
            };
        }
    };
    let out = run(&p, &log, without);
    for (k, o) in out.iter().enumerate() {
        // the acceleration gives the forces, and is a measurement once a torque does
        let expected = if k < 200 { (Status::NEVER_SET, 3) } else { (Status::OK, 4) };
        assert_eq!((o.diagnostics.status, o.diagnostics.nis_channels), expected, "{k}");
        assert!(o.diagnostics.healthy);
    }
}

/// Under held torques the speed goes on as Newton has it.
#[test]
fn the_speed_at_a_horizon_follows_the_forces() {
    let p = parameters(Channels::WheelSpeed);
    let (mass, radius, torque) = (60.0, 0.15, 1.5);
    let mut estimator = WheeledRobot::new(&p).unwrap();
    let spinning = 4.0 * 0.06 / (radius * radius);
    let acceleration = 4.0 * torque / radius / (mass + spinning);
    let mut inputs = Inputs::default();
    for k in 0..300 {
        let speed = 2.0 + acceleration * DT * f64::from(k);
        inputs = Inputs {
            steering_angle: 0.0,
            drive_torque_fl: torque,
            drive_torque_fr: torque,
            drive_torque_rl: torque,
            drive_torque_rr: torque,
            accel_x: acceleration,
            accel_y: 0.0,
            gyro_z: 0.0,
            speed,
            ..Inputs::default()
        };
        each_wheel(&mut inputs, |_| speed / radius);
        estimator.step(&inputs, DT);
    }
    let at = |horizon: f64| {
        let mut outputs = Outputs::default();
        estimator.outputs(&inputs, horizon, &mut outputs);
        outputs.speed_x.value
    };
    for horizon in [0.02, 0.2] {
        let (gained, expected) = (at(horizon) - at(0.0), acceleration * horizon);
        assert!((gained / expected - 1.0).abs() < 0.15, "{horizon} s: {gained} m/s instead of {expected}");
    }
}
