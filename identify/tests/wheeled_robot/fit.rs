//! Tyre parameters of the built-in plant: stiffness from gentle and strong driving, true verdicts,
//! and what the observer's forces cost.

use nalgebra::{Matrix4, Vector4};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheeled_robot::Parameters;
use wheelstate::model::tire::Tire;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::FitReport;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::solve::Loss;
use wheelstate_identify::vehicles::wheeled_robot;
use wheelstate_identify::vehicles::wheeled_robot::problem::axles::{Instant, axles};
use wheelstate_identify::vehicles::wheeled_robot::problem::solve;

const STIFFNESS: f64 = 1318.464;

fn log(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    wheeled_robot::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn tires(logs: &[Log], start: &[(&str, f64)]) -> FitReport {
    let settings = start.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let request = FitRequest { start: settings, exact: true, ..FitRequest::default() };
    let report = wheeled_robot::VEHICLE.fit(logs, &request, &Progress::none()).unwrap();
    for (name, p) in &report.parameters {
        println!("   {name}: {:.4} ± {:.4} {:?}", p.value, p.std_error, p.verdict);
    }
    report
}

#[test]
fn strong_steering_gives_the_stiffness_with_the_observers_forces() {
    let log = log("sine", 3, &[("plant.lateral", 5.0), ("plant.duration", 20.0)]);
    // start values that are 30 % off
    let start = [("tire.front.stiffness", 0.7 * STIFFNESS), ("tire.rear.stiffness", 1.3 * STIFFNESS)];
    let observed = tires(std::slice::from_ref(&log), &start);
    let mut true_forces = log;
    for wheel in ["fl", "fr", "rl", "rr"] {
        let force = true_forces.channel(&format!("true_wheel_force_x_{wheel}")).unwrap().to_vec();
        true_forces.push(&format!("wheel_force_x_{wheel}"), force);
    }
    let exact = tires(&[true_forces], &start);
    for axle in ["front", "rear"] {
        let name = format!("tire.{axle}.stiffness");
        let (with, without) = (&observed.parameters[&name], &exact.parameters[&name]);
        println!("{name}: observer's forces {:.1}, true forces {:.1}, truth {STIFFNESS}", with.value, without.value);
        assert!(with.identified && (with.value / STIFFNESS - 1.0).abs() < 0.06, "{name} {}", with.value);
        assert!((with.value / without.value - 1.0).abs() < 0.02, "the observer costs less than 2 %");
    }
}

#[test]
fn gentle_driving_leaves_the_peak_to_the_prior() {
    let report = tires(&[log("sine", 4, &[("plant.lateral", 1.0), ("plant.duration", 20.0)])], &[]);
    for axle in ["front", "rear"] {
        let stiffness = &report.parameters[&format!("tire.{axle}.stiffness")];
        // noise in the slip angles flattens the curve; the interval knows
        assert!(stiffness.ci95[0] < STIFFNESS && STIFFNESS < stiffness.ci95[1], "{:?}", stiffness.ci95);
        assert!(stiffness.identified && (stiffness.value / STIFFNESS - 1.0).abs() < 0.06, "{}", stiffness.value);
        for name in ["friction", "shape", "curvature"] {
            let name = format!("tire.{axle}.{name}");
            assert!(!report.parameters[&name].identified, "{name}");
            assert!(report.notes.iter().any(|n| n.starts_with(&name) && n.contains("prior only")), "{name}");
        }
    }
}

#[test]
fn rolling_resistance_needs_torques() {
    let settings = [("rolling.coefficient", 0.02), ("plant.duration", 20.0), ("plant.lateral", 2.0)];
    let mut log = log("sine", 5, &settings);
    let found = &tires(std::slice::from_ref(&log), &[]).parameters["rolling.coefficient"].clone();
    assert!(found.identified && (found.value - 0.02).abs() < 0.004, "{}", found.value);
    log.channels.retain(|channel| !channel.name.contains("torque"));
    let report = tires(&[log], &[]);
    assert!(!report.parameters["rolling.coefficient"].identified);
    assert!(report.parameters["tire.front.stiffness"].identified);
}

#[test]
fn a_log_without_lateral_speed_is_refused_by_name() {
    let mut log = log("sine", 6, &[]);
    log.channels.retain(|channel| channel.name != "speed_y");
    let error = wheeled_robot::VEHICLE.fit(&[log], &FitRequest::default(), &Progress::none()).unwrap_err();
    assert!(error.to_string().contains("speed_y"), "{error}");
}

/// Swinging beyond the limit of a slippery road, the front tyres pass their peak.
fn beyond_the_limit(seed: u64) -> Log {
    let settings = [("plant.lateral", 7.0), ("plant.speed", 4.0), ("plant.duration", 60.0), ("plant.friction", 0.4375)];
    log("sine", seed, &settings)
}

#[test]
fn driving_beyond_the_limit_shows_the_peak() {
    let report = tires(&[beyond_the_limit(3)], &[]);
    // the plant's friction is 0.4375 of the estimator's known value
    for (name, truth) in [("friction", 0.35), ("shape", 1.4), ("curvature", -0.2), ("stiffness", STIFFNESS)] {
        let found = &report.parameters[&format!("tire.front.{name}")];
        assert!(found.identified, "{name}");
        assert!(found.ci95[0] < truth && truth < found.ci95[1], "{name} {:?}", found.ci95);
    }
    let friction = &report.parameters["tire.front.friction"];
    assert!((friction.value / 0.35 - 1.0).abs() < 0.02, "{}", friction.value);
    // the rear tyres stay before theirs, and their known friction of 0.8 is wrong: the stiffness says so
    assert!(!report.parameters["tire.rear.friction"].identified);
    let rear = &report.parameters["tire.rear.stiffness"];
    assert!(rear.ci95[1] > STIFFNESS, "{:?}", rear.ci95);
}

/// A car on tyres of friction 1.6 in a slalom up to 1.2 g, by a bicycle of its own; the slip angles stay before the peak.
fn grippy_car(seed: u64) -> Log {
    let (mass, inertia, front, rear) = (982.0, 1605.0, 1.33, 1.07);
    let base = front + rear;
    let tire = |slip: f64, load: f64, stiffness: f64| {
        let peak = 1.6 * load;
        peak * (1.3 * (stiffness / (1.3 * peak) * slip).atan()).sin()
    };
    let weight = 0.5 * mass * 9.81 / base;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let (mut vy, mut r) = (0.0, 0.0);
    let mut columns = vec![Vec::new(); 7];
    for k in 0..6000 {
        let time = 0.01 * f64::from(k);
        let speed = 30.0 + 5.0 * (0.2 * time).sin();
        let growing = 0.4 + 0.6 * (0.05 * time + 1.0).sin().powi(2);
        let delta = 0.045 * (std::f64::consts::FRAC_PI_2 * time + f64::from(seed as u32)).sin() * growing;
        let mut accel = 0.0;
        for _ in 0..5 {
            let ahead = 2.0 * tire(delta - (vy + front * r) / speed, weight * rear, 34e3);
            let behind = 2.0 * tire(-(vy - rear * r) / speed, weight * front, 53e3);
            accel = (ahead + behind) / mass;
            vy += 0.002 * (accel - speed * r);
            r += 0.002 * (front * ahead - rear * behind) / inertia;
        }
        let row = [delta, speed + noise(0.03), r + noise(0.003), accel + noise(0.2), speed, vy, time];
        columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
    }
    let mut log = Log { time: columns.pop().unwrap().into(), ..Log::default() };
    let names = ["steering_angle", "speed", "gyro_z", "accel_y", "speed_x", "speed_y"];
    names.iter().zip(columns).for_each(|(name, column)| log.push(name, column));
    log
}

#[test]
fn axle_forces_beyond_friction_times_load_contradict_the_friction() {
    let load = |lever: f64| 0.5 * 982.0 * 9.81 * lever / 2.4;
    for seed in 1..4 {
        let car = [
            ("vehicle.mass", 982.0),
            ("vehicle.yaw_inertia", 1605.0),
            ("vehicle.cg_to_front", 1.33),
            ("vehicle.cg_to_rear", 1.07),
            ("vehicle.cg_height", 0.0),
            ("tire.front.nominal_load", load(1.07)),
            ("tire.rear.nominal_load", load(1.33)),
        ];
        let tires = ["front", "rear"].into_iter().flat_map(|axle| {
            [("shape", 1.3), ("curvature", 0.0), ("friction", 1.0), ("friction_slope", 0.0), ("load_sensitivity", 0.0)]
                .map(|(name, value)| (format!("tire.{axle}.{name}"), value))
        });
        let settings = car.iter().map(|(name, value)| ((*name).to_owned(), *value)).chain(tires).collect();
        let request = FitRequest { settings, ..FitRequest::default() };
        let report = wheeled_robot::VEHICLE.fit(&[grippy_car(seed)], &request, &Progress::none()).unwrap();
        for (axle, stiffness) in [("front", 34e3), ("rear", 53e3)] {
            let at = |name: &str| &report.parameters[&format!("tire.{axle}.{name}")];
            let friction = at("friction");
            println!(
                "{axle}: friction {:.3} {:.3?}, stiffness {:.0}",
                friction.value,
                friction.ci95,
                at("stiffness").value
            );
            assert!(report.warnings.iter().any(|w| w.contains(&format!("tire.{axle}.friction = 1 is contradicted"))));
            assert!(friction.identified && friction.ci95[0] < 1.6 && 1.6 < friction.ci95[1], "{:?}", friction.ci95);
            assert!((at("stiffness").value / stiffness - 1.0).abs() < 0.06, "{}", at("stiffness").value);
            // what the filter shall consider comes from the fit's own errors, and is never less than tyres vary by
            assert!(at("friction_std").identified && at("friction_std").value >= 0.1);
            assert!(at("stiffness_std").value >= (at("stiffness").std_error / at("stiffness").value).max(0.15));
        }
    }
}

/// The Magic Formula again, one tyre at a time.
fn tire_force(theta: &[f64; 4], known: &Tire, slip: f64, load: f64) -> f64 {
    let [stiffness, shape, friction, curvature] = [theta[0].exp(), theta[1], theta[2].exp(), theta[3]];
    let part = load / known.nominal_load;
    let mu = friction * (1.0 + known.friction_slope / known.friction * (part - 1.0)).max(0.05);
    let c2 = known.load_sensitivity;
    let slope = stiffness * (2.0 * (part / c2).atan()).sin() / (2.0 * (1.0 / c2).atan()).sin();
    let x = slope / (shape * mu * load) * slip;
    mu * load * (shape * (x - curvature * (x - x.atan())).atan()).sin()
}

/// Huber's loss beyond 1.345 standard deviations, and its weight.
fn huber(u: f64) -> (f64, f64) {
    const K: f64 = 1.345;
    if u.abs() <= K { (0.5 * u * u, 1.0) } else { (K * (u.abs() - 0.5 * K), K / u.abs()) }
}

/// Levenberg and Marquardt's method with Huber's weights, from several starts: shares nothing with the
/// sequential convex programs.
fn levenberg_marquardt(residuals: &dyn Fn(&[f64; 4]) -> Vec<f64>, scale: f64, prior: [f64; 4]) -> f64 {
    let (low, high) = ([10f64.ln(), 1.0, 0.05f64.ln(), -5.0], [1e7f64.ln(), 2.2, 2f64.ln(), 0.95]);
    let rows = |theta: &[f64; 4]| {
        let mut all: Vec<f64> = residuals(theta).iter().map(|r| r / scale).collect();
        all.extend([(theta[1] - prior[1]) / 0.3, theta[3] - prior[3]]);
        all
    };
    let cost = |rows: &[f64]| {
        let (data, priors) = rows.split_at(rows.len() - 2);
        data.iter().map(|u| huber(*u).0).sum::<f64>() + priors.iter().map(|u| 0.5 * u * u).sum::<f64>()
    };
    let mut best = f64::INFINITY;
    for start in [prior, [prior[0] - 0.3, 1.2, prior[2] - 0.8, 0.3], [prior[0] + 0.3, 1.8, prior[2] + 0.3, -1.5]] {
        let (mut theta, mut damping) = (start, 1e-2);
        let mut value = cost(&rows(&theta));
        for _ in 0..120 {
            let here = rows(&theta);
            let slopes: Vec<Vec<f64>> = (0..4)
                .map(|j| {
                    let mut moved = theta;
                    moved[j] += 1e-6;
                    rows(&moved).iter().zip(&here).map(|(a, b)| (a - b) / 1e-6).collect()
                })
                .collect();
            let last = here.len() - 2;
            let weight = |i: usize| if i < last { huber(here[i]).1 } else { 1.0 };
            let sum = |f: &dyn Fn(usize) -> f64| (0..here.len()).map(|i| weight(i) * f(i)).sum::<f64>();
            let mut normal = Matrix4::from_fn(|j, k| sum(&|i| slopes[j][i] * slopes[k][i]));
            let gradient = Vector4::from_fn(|j, _| sum(&|i| slopes[j][i] * here[i]));
            (0..4).for_each(|j| normal[(j, j)] *= 1.0 + damping);
            let Some(step) = normal.lu().solve(&gradient) else { break };
            let trial: [f64; 4] = std::array::from_fn(|j| (theta[j] - step[j]).clamp(low[j], high[j]));
            let reached = cost(&rows(&trial));
            if reached < value {
                (theta, value, damping) = (trial, reached, damping * 0.3);
            } else {
                damping *= 4.0;
            }
            if damping > 1e12 {
                break;
            }
        }
        best = best.min(value);
    }
    best
}

/// The sequential convex programs end at the cost that another method finds.
#[test]
fn the_fit_is_as_good_as_an_independent_least_squares() {
    let gentle = log("sine", 4, &[("plant.lateral", 1.0), ("plant.duration", 20.0)]);
    let strong = log("sine", 3, &[("plant.lateral", 5.0), ("plant.duration", 20.0)]);
    let p = Parameters::default();
    for (about, log) in [("gentle", gentle), ("strong", strong), ("beyond the limit", beyond_the_limit(3))] {
        let pair = [p.tire.front, p.tire.rear];
        let found = axles(&log, &p).unwrap();
        let instants: Vec<_> = found.instants.iter().map(|instant| (0, instant)).collect();
        for axle in 0..2 {
            let fit = solve(&p, &instants, axle, &pair, [true; 4], [false; 4], Loss::Huber, &Progress::none()).unwrap();
            let known = pair[axle];
            let other =
                |i: &Instant, wheel: usize| tire_force(&theta_of(&pair[0]), &pair[0], i.slip[wheel], i.load[wheel]);
            let residuals = |theta: &[f64; 4]| -> Vec<f64> {
                let of = |i: &Instant| {
                    let force = |wheel: usize| tire_force(theta, &known, i.slip[wheel], i.load[wheel]);
                    if axle == 0 {
                        let (left, right) = (force(0), force(1));
                        i.axle_force[0] - i.across * (left + right) - i.leak * (left - right)
                    } else {
                        i.axle_force[1] - force(2) - force(3) + i.leak * (other(i, 0) - other(i, 1))
                    }
                };
                found.instants.iter().map(of).collect()
            };
            let own = *fit.cost.last().unwrap();
            let exact = levenberg_marquardt(&residuals, fit.scales[0], theta_of(&known));
            println!("{about}, axle {axle}: cost {own:.4}, independent {exact:.4}");
            assert!((own / exact - 1.0).abs() < 0.01, "{about}, axle {axle}");
        }
    }
}

fn theta_of(tire: &Tire) -> [f64; 4] {
    [tire.stiffness.ln(), tire.shape, tire.friction.ln(), tire.curvature]
}
