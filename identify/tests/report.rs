//! The files that a fit leaves behind, read back by other means than the code that wrote them.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use wheelstate_identify::report;
use wheelstate_identify::result::{
    CorrelationPair, Covariance, FORMAT_VERSION, FitReport, LogEntry, OfLog, Parameter, SignalFit, Trace, Validation,
    Verdict,
};

fn parameter(value: f64, std_error: f64, unit: &str, verdict: Verdict) -> Parameter {
    Parameter {
        value,
        unit: unit.to_owned(),
        std_error,
        ci95: [value - 1.96 * std_error, value + 1.96 * std_error],
        identified: verdict == Verdict::Identified,
        at_bound: verdict == Verdict::AtBound,
        verdict,
        ..Parameter::default()
    }
}

/// A result with every kind of entry, and a trace whose residual is white noise of 0.01 rad.
fn sample() -> FitReport {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let time: Vec<f64> = (0..1600).map(|k| 24.0 + 0.01 * f64::from(k)).collect();
    let predicted: Vec<f64> = time.iter().map(|t| 0.1 * (TAU * 0.7 * t).sin()).collect();
    // A sum of twelve uniform draws is close enough to normal for a picture.
    let mut noise = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
    let mut measured: Vec<f64> = predicted.iter().map(|p| p + 0.01 * noise()).collect();
    measured[700..760].fill(f64::NAN);
    FitReport {
        format_version: FORMAT_VERSION,
        vehicle: "nursing-robot".to_owned(),
        parameters: [
            ("human.stiffness_pitch", parameter(412.34, 3.7, "N.m/rad", Verdict::Identified)),
            ("human.damping_pitch", parameter(24.1, 0.9, "N.m.s/rad", Verdict::Identified)),
            ("human.rest_pitch", parameter(0.011, 0.009, "rad", Verdict::Weak)),
            ("human.stiffness_roll", parameter(f64::NAN, f64::NAN, "N.m/rad", Verdict::NotIdentifiable)),
            ("robot.drive_efficiency", parameter(1.5, 0.2, "1", Verdict::AtBound)),
            ("rolling.coefficient", parameter(0.0153, 0.0001, "1", Verdict::Identified)),
        ]
        .map(|(name, parameter)| (name.to_owned(), parameter))
        .into(),
        covariance: Some(Covariance {
            parameters: vec!["human.stiffness_pitch".to_owned(), "rolling.coefficient".to_owned()],
            matrix: vec![vec![13.69, 0.0], vec![0.0, 1e-8]],
        }),
        correlation_worst_pair: Some(CorrelationPair {
            parameters: ["human.rest_pitch".to_owned(), "human.stiffness_pitch".to_owned()],
            correlation: -0.912,
        }),
        condition_number: f64::INFINITY,
        loss: "huber".to_owned(),
        windows_used: 388,
        validation: Validation {
            held_out: 0.4,
            signals: vec![SignalFit {
                name: "body pitch".to_owned(),
                unit: "rad".to_owned(),
                samples: 1540,
                rmse: 0.01,
                fit_percent: 85.9,
                fit_percent_training: 86.2,
                residual_correlation: 0.01,
                ..SignalFit::default()
            }],
        },
        logs: vec![LogEntry { file: "run <1> & 2.csv".to_owned(), sha256: "0f".repeat(32), samples: 4000 }],
        solver_status: "Solved".to_owned(),
        warnings: vec!["human.rest_pitch: the standard error is 82 % of the value".to_owned()],
        traces: vec![Trace {
            name: "body pitch".to_owned(),
            unit: "rad".to_owned(),
            log: "run <1> & 2.csv".to_owned(),
            time,
            measured,
            predicted,
        }],
        ..FitReport::default()
    }
}

#[test]
fn fit_json_has_the_contract_fields_and_null_for_what_is_unknown() {
    let json: serde_json::Value = serde_json::from_str(&sample().to_json().unwrap()).unwrap();
    for key in [
        "format_version",
        "vehicle",
        "parameters",
        "covariance",
        "correlation_worst_pair",
        "condition_number",
        "loss",
        "windows_used",
        "validation",
        "logs",
        "solver_status",
        "warnings",
    ] {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
    let stiffness = &json["parameters"]["human.stiffness_pitch"];
    assert_eq!(stiffness["value"], 412.34);
    assert_eq!(stiffness["unit"], "N.m/rad");
    assert_eq!(stiffness["identified"], true);
    assert_eq!(stiffness["at_bound"], false);
    assert_eq!(stiffness["ci95"].as_array().unwrap().len(), 2);
    assert!(json["parameters"]["human.stiffness_roll"]["value"].is_null());
    assert_eq!(json["parameters"]["human.stiffness_roll"]["identified"], false);
    assert!(json["condition_number"].is_null());
    assert_eq!(json["logs"][0]["samples"], 4000);
    assert!(json.get("traces").is_none());
}

#[test]
fn fit_json_reads_back() {
    let written = sample();
    let mut read: FitReport = serde_json::from_str(&written.to_json().unwrap()).unwrap();
    assert!(read.parameters["human.stiffness_roll"].value.is_nan() && read.condition_number.is_nan());
    assert_eq!(read.parameters["human.stiffness_pitch"], written.parameters["human.stiffness_pitch"]);
    assert_eq!(read.covariance, written.covariance);
    assert_eq!(read.validation, written.validation);
    read.parameters.retain(|_, p| p.identified);
    assert!(!read.parameters.is_empty() && read.has_warnings());
    // The least that another program may write.
    let least = r#"{"format_version": 1, "vehicle": "wheelchair", "parameters": {}, "loss": "ls", "logs": []}"#;
    assert!(!serde_json::from_str::<FitReport>(least).unwrap().has_warnings());
}

#[test]
fn the_page_is_one_file_without_scripts_or_network() {
    let page = report::html(&sample()).unwrap();
    if let Some(path) = std::env::var_os("WHEELSTATE_KEEP_REPORT") {
        std::fs::write(path, &page).unwrap();
    }
    assert!(page.starts_with("<!DOCTYPE html>"));
    assert!(!page.contains("<script") && !page.contains("<link") && !page.contains("@import"));
    let remote = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!remote.contains("http://") && !remote.contains("https://") && !remote.contains("src="));
    // Interval plot, signal, histogram, autocorrelation.
    assert_eq!(page.matches("<svg").count(), 4);
    assert!(page.contains("run &#60;1&#62; &#38; 2.csv") && !page.contains("run <1>"));
    for words in ["not identifiable", "at bound", "412.3", "[405.1, 419.6]", "85.9 %"] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn a_result_without_anything_still_makes_all_files() {
    let empty = FitReport { vehicle: "wheelchair".to_owned(), loss: "ls".to_owned(), ..FitReport::default() };
    assert!(report::html(&empty).unwrap().contains("wheelchair"));
    assert!(report::table(&empty).contains("0 parameters from 0 logs"));
    assert!(report::ssv(&empty).contains("<ssv:Parameters>"));
    assert_eq!(report::start_values(&empty), None);
}

#[test]
fn degenerate_traces_can_be_drawn() {
    let trace = |measured: Vec<f64>, predicted: Vec<f64>| Trace {
        name: "x".to_owned(),
        unit: "1".to_owned(),
        log: "a.csv".to_owned(),
        time: (0..measured.len()).map(|k| k as f64).collect(),
        measured,
        predicted,
    };
    let traces = vec![
        trace(vec![], vec![]),
        trace(vec![1.0], vec![1.0]),
        trace(vec![0.0; 10], vec![0.0; 10]),
        trace(vec![f64::NAN; 10], vec![1.0; 10]),
        trace(vec![1e300, -1e300, 1e300], vec![f64::INFINITY, 0.0, f64::NAN]),
    ];
    let page = report::html(&FitReport { traces, ..sample() }).unwrap();
    assert!(page.contains("</html>"));
}

#[test]
fn true_values_of_the_logs_stand_beside_the_estimates() {
    let log = |mass: f64, drifting: f64| {
        let mut log = wheelstate_identify::log::Log { time: vec![0.0, 1.0].into(), ..Default::default() };
        log.push("true_human.stiffness_pitch", vec![mass; 2]);
        log.push("true_rolling.coefficient", vec![0.01, drifting]);
        log
    };
    let mut report = sample();
    report.refer_to(&[log(411.0, 0.01), log(411.0, 0.02)]);
    assert_eq!(report.references.get("human.stiffness_pitch"), Some(&411.0));
    assert_eq!(report.references.len(), 1, "what changes during a log is not a reference");
    assert!(report::table(&report).contains("truth"));
    let mut other = sample();
    other.refer_to(&[log(411.0, 0.01), log(412.0, 0.01)]);
    assert!(!other.references.contains_key("human.stiffness_pitch"), "two truths are none");
    assert!(!report::table(&sample()).contains("truth"));
}

#[test]
fn columns_line_up_and_fit_the_terminal() {
    let text = report::table(&FitReport { warnings: vec!["word ".repeat(40)], ..sample() });
    assert!(text.lines().filter(|line| !line.starts_with("fmpy")).all(|line| line.chars().count() <= 100), "{text}");
    let places: Vec<_> = ["verdict", "identified", "weak", "not identifiable", "at bound"]
        .map(|word| text.lines().find_map(|line| line.ends_with(word).then(|| line.chars().count() - word.len())))
        .into();
    assert!(places.iter().all(|place| *place == places[0] && place.is_some()), "{text}");
    assert!(text.contains("412.3  N.m/rad") && text.contains("[405.1, 419.6]"), "{text}");
}

#[test]
fn only_identified_values_become_start_values() {
    let expected = "--start-values human.damping_pitch 24.1 human.stiffness_pitch 412.34 rolling.coefficient 0.0153";
    assert_eq!(report::start_values(&sample()).unwrap(), expected);
}

/// A result of so many logs; the fit of log k is 90 - k %, its rmse 3 rad, that of the last one 4 rad.
fn of_logs(count: usize) -> FitReport {
    let file = |k: usize| format!("log{k}.csv");
    let signal = |k: usize| SignalFit {
        name: "tilt".to_owned(),
        unit: "rad".to_owned(),
        log: file(k),
        samples: 10,
        rmse: if k + 1 == count { 4.0 } else { 3.0 },
        fit_percent: 90.0 - k as f64,
        fit_percent_training: 95.0,
        ..SignalFit::default()
    };
    let own = (0..count).map(|k| (file(k), OfLog { value: k as f64, std_error: 0.5 })).collect();
    let mut report = sample();
    report.logs = (0..count).map(|k| LogEntry { file: file(k), samples: 100, ..LogEntry::default() }).collect();
    report.validation.signals = (0..count).map(signal).collect();
    report.parameters.get_mut("human.rest_pitch").unwrap().per_log = own;
    report
}

#[test]
fn a_signal_of_many_logs_takes_one_line_and_each_log_one_on_demand() {
    let text = report::table(&of_logs(6));
    let lines: Vec<&str> = text.lines().filter(|line| line.contains("tilt")).collect();
    // Fits of 90, 89, ... 85 %; five errors of 3 rad and one of 4: the root of 61 / 6.
    let expected = "fit  87.5 % (training 95.0 %), rmse 3.19 rad, 60 samples of 6 logs; 85.0 % in log5.csv";
    assert!(lines.len() == 1 && lines[0].ends_with(expected), "{lines:?}");
    let few = report::table(&of_logs(2));
    let named =
        ["log0.csv", "log1.csv"].map(|log| few.lines().any(|line| line.contains("tilt") && line.ends_with(log)));
    assert_eq!(named, [true, true], "{few}");
    let each = report::each_log(&of_logs(6));
    let rows: Vec<Vec<&str>> = each.lines().skip(2).map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(rows.len(), 6, "{each}");
    assert_eq!(rows[3], ["log3.csv", "100", "87.0", "%", "3.000", "+-0.50"]);
}
