//! The wheelchair's scenarios and its fit.

use crate::support::{assert_close, median, vector_table, vector_text};
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::{Inputs, Outputs, Parameters, Wheelchair};
use wheelstate::model::wheelchair::wheel_angles;
use wheelstate_identify::log::{Log, Series};
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::FitReport;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::solve::Loss;
use wheelstate_identify::vehicles::wheelchair;

fn simulated(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    wheelchair::VEHICLE.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn run(logs: &[Log], request: &FitRequest) -> FitReport {
    let report = wheelchair::VEHICLE.fit(logs, request, &Progress::none()).unwrap();
    for (name, p) in &report.parameters {
        println!("{name}: {:.5} +- {:.5} {} {:?}", p.value, p.std_error, p.unit, p.verdict);
    }
    println!("{:?} {:?} cond {:.1e}", report.warnings, report.notes, report.condition_number);
    for signal in &report.validation.signals {
        println!("{signal:?}");
    }
    report
}

fn value(report: &FitReport, name: &str) -> f64 {
    report.parameters[name].value
}

/// What the reference fits: `M, D, Fc, IP, B, tauc, ML`.
fn products(report: &FitReport) -> [f64; 7] {
    let [m, l] = ["chair.mass", "chair.com_ahead"].map(|name| value(report, name));
    let inertia = value(report, "chair.yaw_inertia") + m * l * l;
    let rolling = value(report, "rolling.coefficient") * m * 9.80665;
    let [d, b, tauc] = ["chair.drag", "chair.yaw_drag", "chair.yaw_friction"].map(|name| value(report, name));
    [m, d, rolling, inertia, b, tauc, m * l]
}

/// The reference log: 40 s on a slope of 0.05 rad, biases of 0.05 m/s2, encoders of 4096 steps.
fn reference_log() -> Log {
    let table = vector_table("wheelchair/id_log.csv");
    let chair = Parameters::default().chair();
    let (mut left, mut right) = (vec![], vec![]);
    for (travel, heading) in table.values("y1").iter().zip(table.values("y2")) {
        let (r, l) = wheel_angles(&chair, *travel, heading);
        right.push(r);
        left.push(l);
    }
    let mut log = Log { source: "reference".into(), time: table.values("t").into(), ..Log::default() };
    log.push("encoder_left", left);
    log.push("encoder_right", right);
    for (name, column) in
        [("accel_x", "y4"), ("accel_y", "y5"), ("accel_z", "y6"), ("drive_force", "u_f"), ("drive_moment", "u_r")]
    {
        log.push(name, table.values(column));
    }
    log
}

#[test]
fn the_reference_log_gives_the_reference_estimate() {
    let text = vector_text("wheelchair/id_expected.csv");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .filter(|line| !line.starts_with(['#', 'M']))
        .map(|line| line.split(',').map(|cell| cell.trim().parse().unwrap()).collect())
        .collect();
    let names = ["M", "D", "Fc", "IP", "B", "tauc", "ML"];
    let report = run(&[reference_log()], &FitRequest::default());
    let found = products(&report);
    for (k, bound) in [0.01, 0.03, 0.05, 0.03, 0.12, 0.15, 0.04].into_iter().enumerate() {
        println!("{}: {:.5}, reference {:.5}, truth {:.5}", names[k], found[k], rows[1][k], rows[0][k]);
        assert_close(&format!("{} against the truth", names[k]), found[k], rows[0][k], bound, 0.0);
    }
    // The reference smooths the sign of the speed over 0.03 m/s, its signals once, and lets half of a moment act before
    // its sample: within the specification's half a per cent.
    let settings = vec![("rolling.smoothing_speed".to_owned(), 0.03)];
    let mut log = reference_log();
    let moment = &mut log.channels.iter_mut().find(|channel| channel.name == "drive_moment").unwrap().values;
    for k in 0..moment.len() - 1 {
        moment[k] = 0.5 * (moment[k] + moment[k + 1]);
    }
    let same = products(&run(&[log], &FitRequest { settings, ..FitRequest::default() }));
    for k in 0..7 {
        assert_close(&format!("{} against the reference", names[k]), same[k], rows[1][k], 5e-3, 0.0);
    }
    // This log has no biases.
    assert_close("accel_x_bias", value(&report, "initial.accel_x_bias"), 0.0, 0.0, 0.01);
    assert_close("accel_y_bias", value(&report, "initial.accel_y_bias"), 0.0, 0.0, 0.01);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
}

const TRUTH: [(&str, f64); 7] = [
    ("chair.mass", 100.0),
    ("chair.yaw_inertia", 7.0),
    ("chair.com_ahead", 0.12),
    ("chair.drag", 12.0),
    ("chair.yaw_drag", 3.0),
    ("chair.yaw_friction", 0.6),
    ("rolling.coefficient", 0.012),
];

/// Median and largest relative error of every parameter over four logs, against `bounds` on the median.
fn accuracy(what: &str, settings: &[(&str, f64)], bounds: [f64; 7]) {
    let mut errors = vec![vec![]; 7];
    let mut within = 0;
    for seed in 0..4 {
        let report = run(&[simulated("identification", seed, settings)], &FitRequest::default());
        for (k, (name, truth)) in TRUTH.iter().enumerate() {
            let p = &report.parameters[*name];
            assert!(p.identified, "{what}, seed {seed}: {:?}", report.warnings);
            errors[k].push((p.value / truth - 1.0).abs());
            within += usize::from((p.value - truth).abs() < 3.0 * p.std_error);
        }
    }
    for (k, (name, _)) in TRUTH.iter().enumerate() {
        let largest = errors[k].iter().fold(0.0_f64, |a, b| a.max(*b));
        println!("{what} {name}: median {:.2} %, largest {:.2} %", 100.0 * median(&errors[k]), 100.0 * largest);
        assert!(median(&errors[k]) <= bounds[k], "{what}: {name} {}", median(&errors[k]));
    }
    assert!(within >= 24, "{what}: only {within} of 28 within three standard errors");
}

/// Windows last as long at every rate, a moment that is held from sample to sample is integrated as such, and signs are
/// rounded off no more than noise needs: the yaw inertia is the more exact the faster the sampling.
#[test]
fn exact_sensors_give_the_truth_at_every_rate() {
    for (period, inertia) in [(0.02, 5e-5), (0.01, 1.2e-5), (0.002, 1e-6)] {
        let exact = ["noise.encoder", "noise.gyro", "noise.accel", "plant.encoder_counts"].map(|name| (name, 0.0));
        let settings: Vec<(&str, f64)> = exact.into_iter().chain([("sample_period", period)]).collect();
        let report = run(&[simulated("identification", 1, &settings)], &FitRequest::default());
        for ((name, truth), bound) in TRUTH.into_iter().zip([2e-5, inertia, 2e-4, 2e-4, 2e-4, 2e-4, 2e-3]) {
            assert_close(&format!("{name} at {period} s"), value(&report, name), truth, bound, 0.0);
        }
    }
}

const TABLE: [f64; 7] = [0.01, 0.03, 0.04, 0.03, 0.12, 0.15, 0.05];

#[test]
fn parameters_are_found_on_a_slope_with_biased_sensors() {
    let biases = [("plant.accel_x_bias", 0.05), ("plant.accel_y_bias", -0.05), ("plant.gyro_bias", 0.01)];
    accuracy("biased", &biases, TABLE);
    let report = run(&[simulated("identification", 9, &biases)], &FitRequest::default());
    assert_close("accel_x_bias", value(&report, "initial.accel_x_bias"), 0.05, 0.0, 0.015);
    assert_close("accel_y_bias", value(&report, "initial.accel_y_bias"), -0.05, 0.0, 0.015);
}

#[test]
fn parameters_are_found_with_three_percent_outliers() {
    accuracy("outliers", &[("noise.outliers", 0.03), ("plant.accel_x_bias", 0.05)], TABLE);
    let log = simulated("identification", 0, &[("noise.outliers", 0.03)]);
    assert!(run(&[log], &FitRequest::default()).notes.iter().any(|note| note.contains("outliers")));
}

#[test]
fn parameters_are_found_on_flat_ground() {
    let flat =
        [("plant.slope_base", 0.0), ("plant.slope", 0.0), ("plant.encoder_counts", 0.0), ("noise.encoder", 5e-4)];
    accuracy("flat", &flat, [0.01, 0.06, 0.08, 0.15, 0.20, 0.20, 0.08]);
}

#[test]
fn several_logs_and_other_losses_agree() {
    let logs: Vec<Log> = (0..3).map(|seed| simulated("identification", seed, &[("chair.mass", 120.0)])).collect();
    for loss in [Loss::Ls, Loss::Huber, Loss::L1] {
        let report = run(&logs, &FitRequest { loss, ..FitRequest::default() });
        assert_close("mass", value(&report, "chair.mass"), 120.0, 0.01, 0.0);
        assert_close("com_ahead", value(&report, "chair.com_ahead"), 0.12, 0.04, 0.0);
    }
}

/// Missing and infinite samples cost windows, not the fit.
#[test]
fn gaps_are_left_out() {
    let mut log = simulated("identification", 1, &[]);
    for (k, channel) in log.channels.iter_mut().enumerate().take(8) {
        for j in 0..5 {
            let from = 200 + 700 * j + 37 * k;
            let bad = if j % 2 == 0 { f64::NAN } else { f64::INFINITY };
            channel.values[from..from + 8].fill(bad);
        }
    }
    let report = run(&[log], &FitRequest::default());
    assert_close("mass", value(&report, "chair.mass"), 100.0, 0.015, 0.0);
    assert!(report.windows_used < 310);
}

/// Nothing happens, and nothing is identified.
#[test]
fn a_chair_at_rest_identifies_nothing() {
    let mut log = simulated("identification", 2, &[("plant.duration", 20.0)]);
    for name in ["encoder_left", "encoder_right", "drive_force", "drive_moment"] {
        let channel = log.channels.iter_mut().find(|channel| channel.name == name).unwrap();
        channel.values.fill(0.0);
    }
    let noise: Series = log.channel("accel_z").unwrap().iter().map(|a| a - 9.79).collect();
    for name in ["accel_x", "accel_y"] {
        log.channels.iter_mut().find(|channel| channel.name == name).unwrap().values.clone_from(&noise);
    }
    // The same against the brakes: force and moment act, nothing moves.
    let mut braked = log.clone();
    for (name, size) in [("drive_force", 50.0), ("drive_moment", 4.0)] {
        let values = (0..log.len()).map(|k| size * (0.011 * k as f64).sin()).collect();
        braked.channels.iter_mut().find(|channel| channel.name == name).unwrap().values = values;
    }
    for log in [log, braked] {
        let report = run(&[log], &FitRequest::default());
        assert!(report.parameters.values().all(|p| !p.identified), "{:?}", report.parameters);
        assert!(report.warnings.len() >= report.parameters.len());
    }
}

/// Driving straight on: what turning would show stays unknown.
#[test]
fn without_turning_there_is_no_yaw_inertia() {
    let mut log = simulated("climb", 3, &[]);
    let mean = log.series("encoder_left").unwrap();
    log.channels.iter_mut().find(|channel| channel.name == "encoder_right").unwrap().values = mean;
    let report = run(&[log], &FitRequest::default());
    for name in ["chair.yaw_inertia", "chair.yaw_drag", "chair.yaw_friction", "chair.com_ahead"] {
        assert!(!report.parameters[name].identified, "{name}");
    }
}

/// The estimator on every scenario, with its start values from nothing but the scenario's heading.
#[test]
fn the_estimator_follows_every_scenario() {
    for scenario in wheelchair::VEHICLE.simulation.scenarios.iter().filter(|s| s.name != "identification") {
        let log = simulated(scenario.name, 4, &[("plant.gyro_bias", 0.01), ("plant.accel_x_bias", 0.03)]);
        assert_eq!(log, simulated(scenario.name, 4, &[("plant.gyro_bias", 0.01), ("plant.accel_x_bias", 0.03)]));
        let channel = |name: &str| log.channel(name).unwrap();
        let mut parameters = Parameters::default();
        parameters.initial.heading = channel("true_heading")[0];
        let mut estimator = Wheelchair::new(&parameters).unwrap();
        let mut o = Outputs::default();
        for k in 0..log.len() {
            let inputs = Inputs {
                encoder_left: channel("encoder_left")[k],
                encoder_right: channel("encoder_right")[k],
                gyro_pitch: channel("gyro_pitch")[k],
                accel_x: channel("accel_x")[k],
                accel_y: channel("accel_y")[k],
                accel_z: channel("accel_z")[k],
                drive_force: channel("drive_force")[k],
                drive_moment: channel("drive_moment")[k],
            };
            estimator.step(&inputs, 0.01);
            estimator.outputs(&inputs, 0.0, &mut o);
            let slope_error = (o.slope.value - channel("true_slope")[k]).abs();
            assert!(slope_error < 0.03, "{} at {k}: {slope_error}", scenario.name);
            assert!((o.speed.value - channel("true_speed")[k]).abs() < 0.06, "{} at {k}", scenario.name);
            assert!((o.heading.value - channel("true_heading")[k]).abs() < 0.01, "{} at {k}", scenario.name);
        }
        assert!((o.gyro_bias.value - 0.01).abs() < 3.0 * o.gyro_bias.std, "{}: {}", scenario.name, o.gyro_bias.value);
    }
    let unknown = Request { scenario: "fly".to_owned(), ..Request::default() };
    let message = wheelchair::VEHICLE.simulate(&unknown).unwrap_err().to_string();
    assert!(message.contains("climb, oblique, yaw-moment, identification"), "{message}");
    let wrong = Request { scenario: "climb".into(), settings: vec![("plant.mass".into(), -1.0)], seed: 0 };
    assert!(wheelchair::VEHICLE.simulate(&wrong).unwrap_err().to_string().contains("allowed range"));
}

/// Without a turn the moment's rows hold nothing but the gyroscope's noise, which a moment of inertia of zero fits best.
#[test]
fn straight_climbs_tell_the_mass_and_nothing_of_the_turn() {
    let logs: Vec<Log> = (1..=3).map(|seed| simulated("climb", seed, &[])).collect();
    let report = run(&logs, &FitRequest::default());
    let mass = &report.parameters["chair.mass"];
    assert!(mass.identified && (mass.value - 100.0).abs() < 3.0 * mass.std_error);
    for name in ["chair.yaw_inertia", "chair.com_ahead", "chair.yaw_drag", "initial.accel_y_bias"] {
        let p = &report.parameters[name];
        assert!(!p.identified && !p.std_error.is_finite(), "{name} {} +- {}", p.value, p.std_error);
    }
    assert!(report.warnings.iter().all(|text| !text.contains("NaN") && !text.contains("inf")), "{:?}", report.warnings);
}

#[test]
fn beside_a_log_that_turns_a_straight_one_has_no_share_in_the_yaw_inertia() {
    let logs = [simulated("climb", 3, &[]), simulated("identification", 3, &[])];
    let inertia = &run(&logs, &FitRequest::default()).parameters["chair.yaw_inertia"];
    assert!(inertia.identified && (inertia.value - 7.0).abs() < 2.0 * inertia.std_error, "{inertia:?}");
}
