//! What the wheeled robot's estimator makes of bad inputs, gaps, standstill and wrong parameters.

use super::drive::{DT, drive, parameters, run};
use wheelstate::estimator::Diagnostics;
use wheelstate::estimator::wheeled_robot::{Channels, Inputs, Outputs, Parameters, WheeledRobot};
use wheelstate::{Estimator, Status, Variables};

fn rmse(outputs: &[Outputs], log: &[(Inputs, [f64; 3])]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (o, (_, x)) in outputs.iter().zip(log).skip(100) {
        let errors = [o.speed_x.value - x[0], o.speed_y.value - x[1], o.yaw_rate.value - x[2]];
        sum.iter_mut().zip(errors).for_each(|(sum, e)| *sum += e * e);
    }
    sum.map(|s| (s / (log.len() - 100) as f64).sqrt())
}

#[test]
fn a_standing_robot_is_known_to_stand_only_from_its_wheels() {
    let log = drive(1, 10.0, 0.0, 0.0);
    let mut p = parameters(Channels::WheelSpeed);
    p.initial.speed_x = 0.0;
    for o in run(&p, &log, |_, _| {}).iter().skip(20) {
        let motion = [o.speed_x, o.speed_y, o.yaw_rate].map(|estimate| estimate.value.abs());
        assert!(motion[0] < 0.15 && motion[1] < 0.05 && motion[2] < 0.05, "{o:?}");
        assert!(o.diagnostics.status.contains(Status::STANDSTILL) && o.diagnostics.healthy);
    }
    for channels in [Channels::Patent, Channels::Gyro] {
        p.filter.channels = channels;
        for (k, o) in run(&p, &log, |_, _| {}).iter().enumerate().skip(100) {
            let Diagnostics { status, healthy, .. } = o.diagnostics;
            assert!(status.contains(Status::UNOBSERVABLE) && !healthy, "{channels:?} {k}: {status}");
            assert!(o.speed_x.std > 0.1, "{channels:?} {k}: {}", o.speed_x.std);
        }
    }
}

#[test]
fn straight_driving_hides_the_speed_from_accelerometers() {
    let straight = drive(2, 10.0, 3.0, 0.0);
    for channels in [Channels::Patent, Channels::Gyro] {
        let end = run(&parameters(channels), &straight, |_, _| {}).pop().unwrap();
        let Diagnostics { status, healthy, .. } = end.diagnostics;
        assert!(status.contains(Status::UNOBSERVABLE) && !healthy, "{channels:?}: {status}");
        let error = end.speed_x.value - straight.last().unwrap().1[0];
        println!("straight, {channels:?}: error {error:.3} m/s, claimed {:.3} m/s", end.speed_x.std);
        assert!(error.abs() < 3.0 * end.speed_x.std);
    }
    let end = run(&parameters(Channels::WheelSpeed), &straight, |_, _| {}).pop().unwrap();
    assert!(end.diagnostics.status == Status::OK && end.diagnostics.healthy && end.speed_x.std < 0.05 + 0.04 * 3.0);
    // while it snakes, the gyroscope's filter sees the speed
    let snake = drive(2, 10.0, 3.0, 0.15);
    let healthy = run(&parameters(Channels::Gyro), &snake, |_, _| {}).iter().skip(200).all(|o| o.diagnostics.healthy);
    assert!(healthy);
}

fn nothing(i: &mut Inputs) {
    (i.accel_x, i.accel_y, i.gyro_z) = (f64::NAN, f64::NAN, f64::NAN);
    (i.wheel_speed_fl, i.wheel_speed_fr, i.wheel_speed_rl, i.wheel_speed_rr) = (f64::NAN, f64::NAN, f64::NAN, f64::NAN);
}

#[test]
fn missing_and_infinite_samples_are_bridged_and_said() {
    let log = drive(3, 10.0, 3.0, 0.15);
    let p = parameters(Channels::WheelSpeed);
    let whole = rmse(&run(&p, &log, |_, _| {}), &log);
    // a second without anything: the doubt grows until nothing is healthy, and then it recovers
    let gap = run(&p, &log, |k, i| {
        if (400..510).contains(&k) {
            nothing(i)
        }
    });
    println!("speed_x_std before {:.4}, after a second {:.4}", gap[399].speed_x.std, gap[499].speed_x.std);
    assert!(gap[499].speed_x.std > 0.15 && gap[499].speed_x.std < 0.4 && !gap[509].diagnostics.healthy);
    assert!(gap[499].diagnostics.status.contains(Status::NO_MEASUREMENT));
    assert!((gap[520].speed_x.value - log[520].1[0]).abs() < 0.1 && gap[520].diagnostics.healthy);
    // infinite inputs are missing ones; single missing inputs are held or left out
    for spoil in [
        |i: &mut Inputs| i.accel_y = f64::INFINITY,
        |i: &mut Inputs| i.steering_angle = f64::NEG_INFINITY,
        |i: &mut Inputs| i.drive_torque_fl = f64::INFINITY,
        |i: &mut Inputs| i.wheel_speed_rl = f64::INFINITY,
    ] {
        let out = run(&p, &log, |k, i| {
            if k == 300 {
                spoil(i)
            }
        });
        assert!(out[300].diagnostics.status.contains(Status::INFINITE), "{}", out[300].diagnostics.status);
        assert!(rmse(&out, &log)[0] < 1.2 * whole[0]);
    }
    let out = run(&p, &log, |k, i| {
        if k == 300 {
            i.steering_angle = f64::NAN
        }
    });
    assert_eq!(out[300].diagnostics.status, Status::HELD_INPUT);
    let out = run(&p, &log, |k, i| {
        if k == 300 {
            i.accel_x = 1e6
        }
    });
    assert!(out[300].diagnostics.status.contains(Status::IMPLAUSIBLE));
}

#[test]
fn an_outlier_is_gated() {
    let log = drive(4, 8.0, 3.0, 0.15);
    let peak = |gate: f64| {
        let mut p = parameters(Channels::WheelSpeed);
        p.filter.gate = gate;
        let out = run(&p, &log, |k, i| {
            if k == 400 {
                i.accel_y = 100.0
            }
        });
        assert_eq!(out[400].diagnostics.status.contains(Status::GATED), gate > 0.0);
        out.iter().zip(&log).skip(400).map(|(o, (_, x))| (o.speed_y.value - x[1]).abs()).fold(0.0, f64::max)
    };
    let (open, gated) = (peak(0.0), peak(9.0));
    println!("lateral speed error after one sample of 100 m/s2: {open:.3} m/s, gated {gated:.3} m/s");
    assert!(open > 1.0 && gated < 0.05);
    // A gate never shuts the filter out for good.
    let mut p = parameters(Channels::WheelSpeed);
    (p.filter.gate, p.initial.speed_x, p.initial.speed_x_std) = (9.0, 3.0, 0.01);
    let out = run(&p, &log, |_, i| i.gyro_z += 1.0);
    assert!(out.iter().filter(|o| !o.diagnostics.status.contains(Status::GATED)).count() > 50);
}

#[test]
fn unusable_time_steps_change_nothing_and_long_ones_restart() {
    let log = drive(5, 4.0, 3.0, 0.15);
    let mut estimator = WheeledRobot::new(&parameters(Channels::WheelSpeed)).unwrap();
    log[..200].iter().for_each(|(inputs, _)| {
        estimator.step(inputs, DT);
    });
    let before = estimator.state().clone();
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        assert_eq!(estimator.step(&log[200].0, dt), Status::BAD_STEP | Status::SKIPPED, "{dt}");
        assert_eq!(estimator.state(), &before, "{dt}");
    }
    // a gap of half a second is predicted through, one of five seconds is a new start
    assert_eq!(estimator.step(&log[250].0, 0.5), Status::OK);
    assert!(estimator.step(&log[300].0, 5.0).contains(Status::RESTARTED));
    let mut out = Outputs::default();
    log[301..400].iter().for_each(|(inputs, _)| {
        estimator.step(inputs, DT);
        estimator.outputs(inputs, 0.0, &mut out);
    });
    assert!((out.speed_x.value - log[399].1[0]).abs() < 0.1 && out.diagnostics.healthy);
    // a state repeats its bytes, and one that is not finite is refused
    let mut again = WheeledRobot::new(&parameters(Channels::WheelSpeed)).unwrap();
    again.restore(&before).unwrap();
    let mut once = again.clone();
    log[200..300].iter().for_each(|(inputs, _)| {
        again.step(inputs, DT);
        once.step(inputs, DT);
    });
    assert_eq!(again.state(), once.state());
    let broken = serde_json::to_string(&before).unwrap().replacen("\"steering\":", "\"steering\":1e999,\"x_\":", 1);
    if let Ok(state) = serde_json::from_str(&broken) {
        assert!(again.restore(&state).is_err());
    }
}

#[test]
fn parameters_are_refused_by_name() {
    for (name, value) in [
        ("vehicle.mass", 0.0),
        ("vehicle.yaw_inertia", -1.0),
        ("wheel.inertia", 0.0),
        ("wheel.radius", f64::NAN),
        ("vehicle.track_front", 0.0),
        ("vehicle.track_rear", f64::INFINITY),
        ("vehicle.cg_to_front", 0.0),
        ("vehicle.cg_height", -0.1),
        ("tire.front.curvature", 1.1),
        ("tire.rear.shape", 0.9),
        ("tire.front.nominal_load", 0.0),
        ("tire.rear.stiffness", 0.0),
        ("tire.front.friction", 0.0),
        ("filter.measurement_std.gyro_z", 0.0),
        ("filter.process_psd.speed_x", -1.0),
        ("sample_period", 0.0),
    ] {
        let declared = Parameters::declare();
        let index = declared.iter().position(|v| v.name == name).unwrap_or_else(|| panic!("{name}"));
        let mut flat = Parameters::default().to_vec();
        flat[index] = value;
        let mut p = Parameters::default();
        p.read(&flat);
        let error = WheeledRobot::new(&p).unwrap_err();
        assert_eq!(error.name, name);
    }
    // the process may be taken as exact
    let mut p = Parameters::default();
    p.filter.process_psd.speed_x = 0.0;
    assert!(WheeledRobot::new(&p).is_ok());
    // observer gains: 0.5 is advised, 1 is the limit
    p.observer.gain = 40.0;
    assert!(WheeledRobot::new(&p).unwrap().machine().warning().unwrap().contains("0.5"));
    p.observer.gain = 90.0;
    assert_eq!(WheeledRobot::new(&p).unwrap_err().name, "observer.steepness");
    (p.observer.gain, p.observer.amplitude) = (50.0, 50.0 / p.observer.steepness);
    assert_eq!((p.observer.gain + p.observer.amplitude * p.observer.steepness) * p.sample_period, 1.0);
    assert!(WheeledRobot::new(&p).is_ok(), "the limit itself is allowed");
    // integration at low speed
    let mut p = Parameters::default();
    p.filter.substeps = 2;
    let error = WheeledRobot::new(&p).unwrap_err().to_string();
    assert!(
        error.contains("filter.substeps") && error.contains("sample_period") && error.contains("3 substeps"),
        "{error}"
    );
    p.filter.minimum_speed = 1.2;
    assert!(WheeledRobot::new(&p).is_ok());
    // as many steps as a slower sampling needs, where nobody says how many
    let mut p = Parameters { sample_period: 0.02, ..Parameters::default() };
    assert!(WheeledRobot::new(&p).is_ok());
    p.filter.minimum_speed = 1e-3;
    p.sample_period = 0.03;
    assert!(WheeledRobot::new(&p).unwrap_err().to_string().contains("filter.substeps = 1000 is too few"));
}

#[test]
fn other_channels_replace_those_that_a_log_lacks() {
    let log = drive(6, 8.0, 3.0, 0.15);
    // neither torques nor wheel speeds, but a reference speed: forces from the accelerometer
    let mut p = parameters(Channels::WheelSpeed);
    p.filter.use_speed = true;
    let bare = |inputs: &mut Inputs, speed: f64| {
        *inputs = Inputs {
            steering_angle: inputs.steering_angle,
            accel_x: inputs.accel_x,
            accel_y: inputs.accel_y,
            gyro_z: inputs.gyro_z,
            speed,
            ..Inputs::default()
        };
    };
    let out = run(&p, &log, |k, i| bare(i, log[k].1[0] + if k % 2 == 0 { 0.03 } else { -0.03 }));
    let error = rmse(&out, &log);
    println!("without torques and wheel speeds: {error:.4?}");
    assert!(error[0] < 0.03 && error[1] < 0.015 && error[2] < 0.0105);
    assert!(out[700].diagnostics.healthy);
    assert_eq!(out[700].diagnostics.status, Status::MISSING | Status::NEVER_SET);
}
