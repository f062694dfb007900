//! The wheelchair's filter against the reference runs, step by step.

use super::chairs::{reference_chair, reference_limits, reference_noise};
use crate::support::{Table, assert_close, vector_table, vector_text};
use nalgebra::SVector;
use wheelstate::estimator::wheelchair::ekf::{ChairEkf, Drive, Form};
use wheelstate::estimator::wheelchair::{Basic, Biased, Mover};
use wheelstate::filter::gaussian::Gaussian;
use wheelstate::filter::innovation::Gate;
use wheelstate::model::wheelchair::{Command, Output};

const RELATIVE: f64 = 1e-8;
const ABSOLUTE: f64 = 1e-10;

/// Mean and upper triangle of the covariance by rows, as in the files.
#[track_caller]
fn compare<const N: usize>(run: &str, row: usize, states: usize, table: &Table, filter: &Gaussian<N>) {
    for i in 0..states {
        let what = format!("{run} row {row} xhat{}", i + 1);
        assert_close(&what, filter.mean[i], table.at(row, &format!("xhat{}", i + 1)), RELATIVE, ABSOLUTE);
        for j in i..states {
            let name = format!("P{}_{}", i + 1, j + 1);
            assert_close(
                &format!("{run} row {row} {name}"),
                filter.covariance[(i, j)],
                table.at(row, &name),
                RELATIVE,
                ABSOLUTE,
            );
        }
    }
}

fn run<const N: usize, const K: usize, const P: usize, F: Form<N, K, P>>(name: &str, form: F) {
    let runs: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/runs.json")).unwrap();
    let params: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/params.json")).unwrap();
    let file = format!("{name}.csv");
    let setup = &runs[&file];
    // What the source's state has not is known to be zero.
    let states = setup["x0"].as_array().unwrap().len();
    let numbers =
        |list: &serde_json::Value| SVector::<f64, N>::from_fn(|i, _| list.get(i).map_or(0.0, |v| v.as_f64().unwrap()));
    let mut chair = reference_chair(setup["variant"].as_str().unwrap());
    chair.heading_reference = setup["alpha_ref"].as_f64().unwrap();
    let noise = reference_noise(&setup["config"]);
    let gate = Gate { deviations: setup["config"]["gate"].as_f64().unwrap_or(0.0), patience: 10 };
    let observer = ChairEkf { chair, noise, limits: reference_limits(), gate, form };
    let mut filter =
        Gaussian::independent(numbers(&setup["x0"]), &numbers(&params[setup["P0"].as_str().unwrap()]).map(f64::sqrt));
    let table = vector_table(&format!("wheelchair/{file}"));
    let irregular = table.columns[0] == "dt";
    let mut counters = [0; 6];
    let command = |row: usize| Command::new(table.at(row, "u_f"), table.at(row, "u_r"));
    for row in 0..table.rows.len() {
        let still = !irregular && table.at(row, "still") == 1.0;
        let predicted_before = row > 0 || irregular;
        if predicted_before {
            // The irregular run predicts with the command of the same row.
            let (dt, held) = if irregular {
                (table.at(row, "dt"), row)
            } else {
                (table.at(row, "t") - table.at(row - 1, "t"), row - 1)
            };
            let accel_x = (!irregular).then(|| table.at(held, "y4"));
            let drive = Drive { accel_x, ..Drive::reported(command(held), still) };
            observer.predict(&mut filter, dt, &drive);
        }
        if !irregular {
            for i in 0..states {
                let what = format!("{name} row {row} xminus{}", i + 1);
                assert_close(&what, filter.mean[i], table.at(row, &format!("xminus{}", i + 1)), RELATIVE, ABSOLUTE);
            }
        }
        let y = Output::from_fn(|i, _| table.at(row, &format!("y{}", i + 1)));
        let drive = Drive::reported(command(row), still);
        let mut y = y;
        if name == "ekf_missing_full" && row % 2 == 1 {
            y[0] = f64::NAN; // the encoders deliver every other sample
            y[1] = f64::NAN;
        }
        let update = observer.correct(&mut filter, &mut counters, &y.into(), &drive).unwrap();
        compare(name, row, states, &table, &filter);
        // the source counts the rows that were used only
        let (rejected, white) = (update.sensors.rejected, update.sensors.whitened);
        let used_nis = update.nis - (0..6).filter(|i| rejected[*i]).map(|i| white[i] * white[i]).sum::<f64>();
        let rejected = rejected.iter().filter(|row| **row).count();
        // ... and writes NaN where there is none
        let expected = if update.dof > rejected { table.at(row, "nis") } else { 0.0 };
        assert_close(&format!("{name} row {row} nis"), used_nis, expected, RELATIVE, ABSOLUTE);
        if !irregular {
            assert_eq!((update.dof - rejected) as f64, table.at(row, "ndof"), "{name} row {row} ndof");
            let used = update.sensors.used.iter().fold(0.0, |mask, used| 10.0 * mask + f64::from(u8::from(*used)));
            assert_eq!(used, table.at(row, "used"), "{name} row {row} used");
        }
    }
}

#[test]
fn six_states_match_the_reference_runs() {
    for case in 1..=3 {
        run(&format!("ekf_case{case}_full"), Basic);
        run(&format!("ekf_case{case}_paper"), Basic);
    }
}

#[test]
fn missing_rows_and_gate_match_the_reference_run() {
    run("ekf_missing_full", Basic);
}

#[test]
fn standstill_matches_the_reference_run() {
    run("ekf_still_full", Basic);
}

#[test]
fn irregular_steps_match_the_reference_run() {
    run("ekf_irregular", Basic);
}

#[test]
fn eleven_states_match_the_reference_runs() {
    run("ekf_aug_full", Biased { mover: Mover::Force });
    run("ekf_aug_axin_full", Biased { mover: Mover::Acceleration });
}

/// filterpy's filter with the model written in numpy (`oracles/wheelchair_filterpy.py`), step by step.
#[test]
fn filterpy_agrees() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles/wheelchair_filterpy.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let runs: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/runs.json")).unwrap();
    let params: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/params.json")).unwrap();
    let numbers = |list: &serde_json::Value| {
        SVector::<f64, 6>::from_iterator(list.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()))
    };
    let mut worst = 0.0_f64;
    for (variant, log) in [("full", "ekf_case2_full"), ("full_rich", "ekf_case3_full")] {
        let setup = &runs[format!("{log}.csv")];
        let mut chair = reference_chair(variant);
        chair.heading_reference = setup["alpha_ref"].as_f64().unwrap();
        let gate = Gate { deviations: 0.0, patience: 10 };
        let noise = reference_noise(&serde_json::Value::Null);
        let observer = ChairEkf { chair, noise, limits: reference_limits(), gate, form: Basic };
        let mut filter = Gaussian::independent(numbers(&setup["x0"]), &numbers(&params["P0_6"]).map(f64::sqrt));
        let table = vector_table(&format!("wheelchair/{log}.csv"));
        let expected: Vec<Vec<&str>> =
            text.lines().skip(1).map(|l| l.split(',').collect()).filter(|l: &Vec<&str>| l[1] == log).collect();
        let mut next = expected.iter().peekable();
        for row in 0..table.rows.len() {
            let drive = |row: usize| Drive::reported(Command::new(table.at(row, "u_f"), table.at(row, "u_r")), false);
            if row > 0 {
                observer.predict(&mut filter, 0.01, &drive(row - 1));
            }
            let y = Output::from_fn(|i, _| table.at(row, &format!("y{}", i + 1)));
            observer.correct(&mut filter, &mut [0; 6], &y.into(), &drive(row)).unwrap();
            let Some(line) = next.next_if(|line| line[2].parse() == Ok(row)) else { continue };
            for (name, cell) in header.iter().zip(line).skip(3) {
                let index = |text: &str| text.parse::<usize>().unwrap() - 1;
                let actual = match name.strip_prefix('x') {
                    Some(k) => filter.mean[index(k)],
                    None => {
                        let (i, j) = name[1..].split_once('_').unwrap();
                        filter.covariance[(index(i), index(j))]
                    }
                };
                let expected: f64 = cell.parse().unwrap();
                worst = worst.max((actual - expected).abs());
                assert_close(&format!("{log} row {row} {name}"), actual, expected, 1e-10, 1e-10);
            }
        }
        assert!(next.peek().is_none(), "{log}: not every row was compared");
    }
    println!("largest difference to filterpy: {worst:.1e}");
}
