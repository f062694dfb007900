//! The wheeled robot's estimator on its own plant: accuracy, consistency, observability.

use wheelstate::estimator::wheeled_robot::{Channels, Outputs, Parameters, WheeledRobot};
use wheelstate::variable::Estimate;
use wheelstate::{Estimator, Status};
use wheelstate_identify::log::Log;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::tune::replay::Track;
use wheelstate_identify::vehicles::wheeled_robot;

const SCENARIOS: [&str; 6] = ["sine", "vector", "lane-change", "step-steer", "accelerate-brake", "low-friction"];

fn log_with(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let request = Request { scenario: scenario.to_owned(), seed, settings };
    wheeled_robot::VEHICLE.simulate(&request).unwrap()
}

fn log(scenario: &str, seed: u64) -> Log {
    log_with(scenario, seed, &[])
}

/// The filter of the source: all constants are known and the noise is as declared.
fn exact(p: &mut Parameters) {
    for tire in [&mut p.tire.front, &mut p.tire.rear] {
        (tire.stiffness_std, tire.friction_std) = (0.0, 0.0);
    }
    (p.wheel.radius_std, p.imu.accel_y_bias_std, p.filter.measurement_std.steering_angle_bias) = (0.0, 0.0, 0.0);
    (p.vehicle.yaw_inertia_std, p.vehicle.cg_std, p.imu.accel_x_bias_std) = (0.0, 0.0, 0.0);
    (p.imu.gyro_z_bias_std, p.imu.gyro_z_scale_std, p.imu.gyro_z_delay_std) = (0.0, 0.0, 0.0);
    (p.vehicle.mass_std, p.observer.torque_bias_std) = (0.0, 0.0);
    (p.filter.adaptive, p.filter.gate) = (false, 0.0);
}

/// As the study ran it: started 0.2 m/s too fast, the constants and the friction known.
fn parameters(scenario: &str, channels: Channels) -> Parameters {
    let mut p = Parameters::default();
    p.filter.channels = channels;
    exact(&mut p);
    p.initial.speed_x = if scenario == "accelerate-brake" { 1.7 } else { 3.2 };
    if scenario == "low-friction" {
        for tire in [&mut p.tire.front, &mut p.tire.rear] {
            tire.friction *= 0.4375;
            tire.friction_slope *= 0.4375;
        }
    }
    p
}

fn run(log: &Log, p: &Parameters) -> Vec<Outputs> {
    replay(&Track::new(log), p)
}

fn replay(track: &Track<WheeledRobot>, p: &Parameters) -> Vec<Outputs> {
    let mut all = Vec::with_capacity(track.time.len());
    track.run(WheeledRobot::new(p).unwrap(), |_, outputs| all.push(outputs.clone()));
    all
}

/// As [`run`], with nothing but steering and torques on every second sample.
fn run_halved(log: &Log, p: &Parameters) -> Vec<Outputs> {
    let mut track = Track::<WheeledRobot>::new(log);
    for i in track.inputs.iter_mut().skip(1).step_by(2) {
        (i.accel_x, i.accel_y, i.gyro_z) = (f64::NAN, f64::NAN, f64::NAN);
        (i.wheel_speed_fl, i.wheel_speed_fr) = (f64::NAN, f64::NAN);
        (i.wheel_speed_rl, i.wheel_speed_rr) = (f64::NAN, f64::NAN);
    }
    replay(&track, p)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
    f64::sqrt(sum / count)
}

/// RMSE of speed_x, speed_y and yaw_rate after the first second.
fn errors(log: &Log, outputs: &[Outputs]) -> [f64; 3] {
    errors_over(log, outputs, |_| [1.0; 3])
}

/// As [`errors`], each error over the standard deviation that the filter claims.
fn claimed_errors(log: &Log, outputs: &[Outputs]) -> [f64; 3] {
    errors_over(log, outputs, |o| [o.speed_x.std, o.speed_y.std, o.yaw_rate.std])
}

fn errors_over(log: &Log, outputs: &[Outputs], scale: impl Fn(&Outputs) -> [f64; 3]) -> [f64; 3] {
    let truth = ["true_speed_x", "true_speed_y", "true_yaw_rate"].map(|name| log.channel(name).unwrap());
    let error = |i: usize, k: usize| {
        let o = &outputs[k];
        ([o.speed_x, o.speed_y, o.yaw_rate][i].value - truth[i][k]) / scale(o)[i]
    };
    std::array::from_fn(|i| rms((100..log.len()).map(|k| error(i, k))))
}

fn forces(o: &Outputs) -> [Estimate; 4] {
    [o.wheel_force_x_fl, o.wheel_force_x_fr, o.wheel_force_x_rl, o.wheel_force_x_rr]
}

fn true_forces(log: &Log) -> [&[f64]; 4] {
    ["fl", "fr", "rl", "rr"].map(|wheel| log.channel(&format!("true_wheel_force_x_{wheel}")).unwrap())
}

/// Mean over seeds of the RMSE of speed_x, speed_y and yaw_rate.
fn mean_errors(logs: &[Log], p: &Parameters) -> [f64; 3] {
    mean(logs, |log| errors(log, &run(log, p)))
}

fn mean(logs: &[Log], figures: impl Fn(&Log) -> [f64; 3]) -> [f64; 3] {
    let all: Vec<[f64; 3]> = logs.iter().map(figures).collect();
    std::array::from_fn(|i| all.iter().map(|e| e[i]).sum::<f64>() / all.len() as f64)
}

/// RMSE of the wheel forces and the mean of their squared errors over the claimed variances.
fn force_errors(log: &Log, outputs: &[Outputs]) -> (f64, f64) {
    let truth = true_forces(log);
    let each = |k: usize| (0..4).map(move |i| (k, i));
    let pairs: Vec<(f64, f64)> = (10..log.len())
        .flat_map(each)
        .map(|(k, i)| (forces(&outputs[k])[i], truth[i][k]))
        .map(|(force, truth)| (force.value - truth, force.std))
        .collect();
    (rms(pairs.iter().map(|p| p.0)), pairs.iter().map(|p| (p.0 / p.1).powi(2)).sum::<f64>() / pairs.len() as f64)
}

fn seeds(scenario: &str, count: u64) -> Vec<Log> {
    (0..count).map(|seed| log(scenario, seed)).collect()
}

#[test]
fn wheel_forces_are_found_and_their_errors_predicted() {
    let mut p = Parameters::default();
    // That the plant rolls without resistance is known here.
    p.rolling.coefficient_std = 0.0;
    for (scenario, limit) in [("sine", 0.52), ("accelerate-brake", 1.8), ("vector", 0.65), ("lane-change", 0.52)] {
        for log in seeds(scenario, 3) {
            let (rmse, consistency) = force_errors(&log, &run(&log, &p));
            println!("{scenario}: force RMSE {rmse:.3} N, squared error over variance {consistency:.2}");
            assert!(rmse < limit, "{scenario}: {rmse} N");
            assert!((0.3..3.5).contains(&consistency), "{scenario}: {consistency}");
        }
    }
    // Torque over radius, the estimate without an observer, is far worse while the wheels accelerate.
    let log = log("sine", 0);
    let (rmse, _) = force_errors(&log, &run(&log, &p));
    let truth = true_forces(&log);
    let static_estimate = ["fl", "fr", "rl", "rr"].map(|w| log.channel(&format!("drive_torque_{w}")).unwrap());
    let naive = rms((0..4).flat_map(|i| {
        let (torque, truth) = (static_estimate[i], truth[i]);
        (10..log.len()).map(move |k| torque[k] / 0.15 - truth[k])
    }));
    println!("sine: observer {rmse:.3} N, torque over radius {naive:.3} N");
    assert!(naive > 3.5 * rmse);
    // Feedforward follows steps of the torque better.
    let log = self::log("accelerate-brake", 0);
    let (plain, _) = force_errors(&log, &run(&log, &p));
    (p.observer.feedforward, p.observer.gain, p.observer.nominal_rate) = (true, 5.0, 5.0);
    (p.observer.amplitude, p.observer.steepness) = (60.0, 0.25);
    let (feedforward, _) = force_errors(&log, &run(&log, &p));
    println!("accelerate-brake: {plain:.3} N, with feedforward {feedforward:.3} N");
    assert!(feedforward < plain);
}

#[test]
fn a_torque_bias_goes_into_the_force_as_it_must() {
    let mut p = Parameters::default();
    p.observer.torque_bias_std = 0.3;
    let (clean, biased) = (log("lane-change", 1), log_with("lane-change", 1, &[("noise.torque_bias", 0.3)]));
    let mean = |log: &Log| {
        let (out, truth) = (run(log, &p), true_forces(log));
        (0..4).map(|i| (100..log.len()).map(|k| forces(&out[k])[i].value - truth[i][k]).sum::<f64>()).sum::<f64>()
            / (4 * (log.len() - 100)) as f64
    };
    let offset = mean(&biased) - mean(&clean);
    assert!((offset - 0.3 / 0.15).abs() < 0.02 * 2.0, "{offset} N");
    let (_, consistency) = force_errors(&biased, &run(&biased, &p));
    assert!(consistency < 2.0, "a bias of one declared standard deviation is covered: {consistency}");
}

#[test]
fn the_motion_on_the_sine_is_found_with_each_set_of_channels() {
    let logs = seeds("sine", 5);
    let p = |channels| parameters("sine", channels);
    let mut none = p(Channels::Patent);
    none.observer.force_limit = 1e-6;
    let [patent, zero] = [mean_errors(&logs, &p(Channels::Patent)), mean_errors(&logs, &none)];
    println!("patent {patent:.4?}, with forces set to zero {zero:.4?}");
    assert!(patent[0] <= 0.11 && zero[0] >= 5.0 * patent[0]);
    for (channels, limits) in
        [(Channels::Gyro, [0.0313, 0.0062, 0.0084]), (Channels::WheelSpeed, [0.0118, 0.0061, 0.0083])]
    {
        let found = mean_errors(&logs, &p(channels));
        println!("{channels:?} {found:.4?}");
        for i in 0..3 {
            assert!(found[i] <= 1.3 * limits[i], "{channels:?} {found:?}");
        }
    }
}

#[test]
fn the_motion_is_found_with_wheel_speeds_in_all_scenarios() {
    for scenario in SCENARIOS {
        let p = parameters(scenario, Channels::WheelSpeed);
        let logs = seeds(scenario, 2);
        let found = mean_errors(&logs, &p);
        let outputs = run(&logs[0], &p);
        let nis = outputs.iter().map(|o| o.diagnostics.nis).sum::<f64>() / outputs.len() as f64;
        println!("{scenario}: {found:.4?}, NIS per channel {nis:.2}");
        assert!(found[1] <= 0.0095 && found[2] <= 0.0105, "{scenario} {found:?}");
        assert!(found[0] <= 0.03, "{scenario} {found:?}");
        assert!((0.2..2.0).contains(&nis), "{scenario} {nis}");
        assert!(outputs.iter().all(|o| o.diagnostics.healthy && o.diagnostics.status == Status::OK), "{scenario}");
    }
}

/// With the defaults, which take neither tyres nor radius as known, what is known all the same costs no accuracy.
#[test]
fn doubt_about_constants_that_are_right_costs_little() {
    for scenario in SCENARIOS {
        let known = parameters(scenario, Channels::WheelSpeed);
        let mut p = Parameters::default();
        (p.filter.channels, p.initial.speed_x) = (Channels::WheelSpeed, known.initial.speed_x);
        for (to, from) in [(&mut p.tire.front, &known.tire.front), (&mut p.tire.rear, &known.tire.rear)] {
            (to.friction, to.friction_slope) = (from.friction, from.friction_slope);
        }
        let logs = seeds(scenario, 3);
        let (sure, doubt) = (mean_errors(&logs, &known), mean_errors(&logs, &p));
        let claimed = mean(&logs, |log| claimed_errors(log, &run(log, &p)));
        println!("{scenario}: {sure:.4?}, with doubt {doubt:.4?}, errors over std {claimed:.2?}");
        assert!(doubt[1] < 0.0095 && doubt[1] < 1.2 * sure[1] && doubt[2] < 1.1 * sure[2], "{scenario} {doubt:?}");
        assert!(claimed.iter().all(|claimed| *claimed < 1.1), "{scenario} {claimed:?}");
    }
}

/// Over 40 seeds the error of speed_x grows 1.02 to 1.18 times, in the lane change 1.20, after the step 1.23. So it must:
/// of the wheels' white noise `q, r = 0.02, 0.05` pass `K/(2 - K)`, a factor of 1.18; in a turn noise of the gyroscope
/// and of the steering angle enters too and is carried further without samples: the equations alone give 1.26 in the
/// step's turn (`tests/oracles/wheeled_robot_half_rate.py`). Without that noise the step costs 1.12.
#[test]
fn every_second_sample_may_be_missing() {
    for (scenario, limit) in SCENARIOS.map(|s| (s, if s == "lane-change" || s == "step-steer" { 1.25 } else { 1.2 })) {
        let (p, logs) = (parameters(scenario, Channels::WheelSpeed), seeds(scenario, 8));
        let halved = run_halved(&logs[0], &p);
        assert!(halved[301].diagnostics.status.contains(Status::MISSING | Status::NO_MEASUREMENT));
        let (whole, half) = (mean_errors(&logs, &p), mean(&logs, |log| errors(log, &run_halved(log, &p))));
        let cost: [f64; 3] = std::array::from_fn(|i| half[i] / whole[i]);
        println!("{scenario}: {cost:.3?} of {whole:.4?}");
        assert!(cost[0] < limit && cost[1] < 1.2 && cost[2] < 1.2, "{scenario} {cost:?}");
    }
    let quiet = ["noise.accel", "noise.gyro", "noise.steering", "noise.torque"].map(|name| (name, 0.0));
    let logs: Vec<Log> = (0..4).map(|seed| log_with("step-steer", seed, &quiet)).collect();
    let p = parameters("step-steer", Channels::WheelSpeed);
    let cost = mean(&logs, |log| errors(log, &run_halved(log, &p)))[0] / mean_errors(&logs, &p)[0];
    println!("step-steer, noise of the wheel speeds only: {cost:.3}");
    assert!(cost < 1.18);
}

/// With the source's noise settings the errors on a straight are those that the filter's equations predict
/// (`tests/oracles/wheeled_robot_half_rate.py`, which shares no code with the estimator).
#[test]
fn errors_are_those_that_the_equations_predict() {
    let mut p = parameters("vector", Channels::WheelSpeed);
    p.filter.measurement_std.steering_angle = 0.0;
    let found = mean_errors(&seeds("vector", 8), &p);
    println!("vector: {found:.5?}");
    for (found, predicted) in found.into_iter().zip([1.41e-3, 5.60e-3, 8.22e-3]) {
        assert!((found / predicted - 1.0).abs() < 0.05, "{found}, predicted {predicted}");
    }
}

/// The noise of the steering angle moves the force which the model expects; left out, as in the source, speed_y_std
/// is too small; counted, it is right and the estimate better.
#[test]
fn the_noise_of_the_steering_angle_belongs_to_the_lateral_acceleration() {
    for scenario in SCENARIOS {
        let logs = seeds(scenario, 3);
        let counted = parameters(scenario, Channels::WheelSpeed);
        let mut p = counted.clone();
        p.filter.measurement_std.steering_angle = 0.0;
        let claimed = |p: &Parameters| mean(&logs, |log| claimed_errors(log, &run(log, p)));
        let (before, after) = (claimed(&p), claimed(&counted));
        let (error, better) = (mean_errors(&logs, &p)[1], mean_errors(&logs, &counted)[1]);
        println!("{scenario}: errors over std {before:.2?} -> {after:.2?}, speed_y {error:.4} -> {better:.4} m/s");
        assert!((1.3..1.8).contains(&before[1]) && (0.8..1.1).contains(&after[1]), "{scenario}");
        assert!((0.8..1.1).contains(&after[2]) && after[0] < 1.0 && better < error, "{scenario}");
    }
}
