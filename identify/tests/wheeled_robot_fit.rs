//! Tyre parameters of the built-in plant: stiffness from gentle and strong driving, honest verdicts,
//! and what the observer's forces cost.

use wheelstate_identify::log::Log;
use wheelstate_identify::problem::fit;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::report::FitReport;
use wheelstate_identify::request::FitRequest;
use wheelstate_identify::simulate::{Request, simulate};
use wheelstate_identify::vehicle::Vehicle;

const STIFFNESS: f64 = 1318.464;

fn log(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    simulate(Vehicle::WheeledRobot, &Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn tires(logs: &[Log], start: &[(&str, f64)]) -> FitReport {
    let settings = start.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    let request = FitRequest { start: settings, ..FitRequest::default() };
    let report = fit(Vehicle::WheeledRobot, logs, &request, &Progress::none()).unwrap();
    for (name, p) in &report.parameters {
        println!("   {name}: {:.4} ± {:.4} {:?}", p.value, p.std_error, p.verdict);
    }
    report
}

#[test]
fn stiffness_from_strong_steering_with_the_observers_forces() {
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
            assert!(report.warnings.iter().any(|w| w.starts_with(&name) && w.contains("prior only")), "{name}");
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
    let error = fit(Vehicle::WheeledRobot, &[log], &FitRequest::default(), &Progress::none()).unwrap_err();
    assert!(error.to_string().contains("speed_y"), "{error}");
}
