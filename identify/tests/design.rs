//! What the design of experiments promises against what fits to drives of the plan then have.
//!
//! The machines that drive are not those of the plan: their parameters are drawn, and their tyres, drives and sensors
//! differ from the built-in plant's by what the plan does not know.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use wheelstate_identify::design::{Candidate, DesignRequest, Plan, Promise, design};
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles;

type Values = Vec<(String, f64)>;
/// A number between two others, drawn.
type Uniform<'a> = dyn FnMut(f64, f64) -> f64 + 'a;

fn vehicle(name: &str) -> &'static Vehicle {
    vehicles::ALL.into_iter().find(|vehicle| vehicle.name == name).unwrap()
}

fn simulate(vehicle: &Vehicle, scenario: &str, seed: u64, settings: &[(String, f64)]) -> Log {
    let request = Request { scenario: scenario.into(), seed, settings: settings.to_vec() };
    let log = vehicle.simulate(&request).unwrap();
    Log { source: format!("{scenario} {seed}"), ..log }
}

fn plan(vehicle: &Vehicle, logs: &[Log], request: &DesignRequest) -> Plan {
    design(vehicle, logs.to_vec(), request, |_| {}, &Progress::none()).unwrap()
}

/// A machine that drives: its first log, and what its user knows of it.
struct Case {
    vehicle: &'static str,
    first: &'static str,
    wanted: &'static [&'static str],
    /// Parameters and what the built-in plant lacks, drawn.
    truth: fn(&mut Uniform) -> Vec<(&'static str, f64)>,
    /// The manoeuvre of the short test.
    short: &'static str,
    /// Parameters that the user gives.
    given: &'static [&'static str],
}

const CASES: [Case; 4] = [
    Case {
        vehicle: "wheelchair",
        short: "identification",
        first: "climb",
        wanted: &["chair.yaw_inertia", "chair.yaw_drag", "chair.drag"],
        truth: |u| {
            vec![
                ("chair.yaw_inertia", u(5.0, 10.0)),
                ("chair.com_ahead", u(0.08, 0.16)),
                ("chair.drag", u(8.0, 17.0)),
                ("chair.yaw_drag", u(2.0, 4.5)),
                ("chair.yaw_friction", u(0.1, 1.2)),
                ("rolling.coefficient", u(0.003, 0.018)),
                ("plant.force_gain", u(0.985, 1.015)),
                ("plant.moment_gain", u(0.985, 1.015)),
                ("plant.gyro_bias", u(-0.002, 0.002)),
                ("plant.accel_x_bias", u(-0.025, 0.025)),
            ]
        },
        given: &[],
    },
    Case {
        vehicle: "nursing-robot",
        short: "identification",
        first: "smooth-start",
        wanted: &["human.stiffness_pitch", "human.damping_pitch"],
        truth: |u| {
            vec![
                ("plant.draw_patient", 0.0),
                ("human.nominal_mass", u(55.0, 85.0)),
                ("human.stiffness_pitch", u(350.0, 700.0)),
                ("human.damping_pitch", u(18.0, 45.0)),
                ("human.stiffness_roll", u(420.0, 800.0)),
                ("human.damping_roll", u(20.0, 45.0)),
                ("rolling.coefficient", u(0.01, 0.02)),
                ("plant.yaw_inertia", u(15.0, 26.0)),
                ("plant.motor_lag", u(0.005, 0.03)),
                ("noise.tilt_bias", u(-0.007, 0.007)),
                ("noise.tilt_rate_bias", u(-0.002, 0.002)),
            ]
        },
        given: &["human.nominal_mass"],
    },
    Case {
        vehicle: "wheel-loader",
        short: "accelerate-brake",
        first: "bumpy-c",
        wanted: &["initial.slip_stiffness", "initial.cg_ratio"],
        truth: |u| {
            vec![
                ("plant.slip_stiffness", u(14.0, 26.0)),
                ("plant.cg_ratio", u(0.4, 0.5)),
                ("plant.cg_height", u(0.8, 1.1)),
                ("plant.load_sensitivity", u(-0.05, 0.12)),
                ("plant.shape", u(1.4, 1.65)),
                ("plant.curvature", u(-0.2, 0.5)),
                ("plant.relaxation_length", u(0.25, 0.5)),
                ("plant.pitch_inertia", u(5000.0, 8000.0)),
                ("plant.wheel_moments", u(0.0, 1.0)),
                ("plant.mass_error", u(-0.03, 0.03)),
            ]
        },
        given: &[],
    },
    Case {
        vehicle: "wheeled-robot",
        short: "lane-change",
        first: "vector",
        wanted: &["tire.front.stiffness", "tire.rear.stiffness"],
        truth: |u| {
            let stiffness = 1318.464; // as declared
            vec![
                ("tire.front.stiffness", stiffness * u(0.7, 1.4)),
                ("tire.rear.stiffness", stiffness * u(0.7, 1.4)),
                ("plant.slip_shape", u(1.4, 1.8)),
                ("plant.slip_stiffness", u(9.0, 16.0)),
                ("plant.drive_lag", u(0.01, 0.04)),
                ("noise.gyro_bias", u(-0.002, 0.002)),
                ("noise.accel_bias", u(-0.025, 0.025)),
            ]
        },
        given: &[],
    },
];

/// What was promised and what a drive gave.
struct Kept {
    name: String,
    scenario: String,
    promise: Promise,
    achieved: f64,
}

impl Kept {
    fn inside(&self) -> bool {
        (self.promise.low..=self.promise.high).contains(&self.achieved)
    }
}

/// A first log, the plan, and drives of its candidates on the same machine: of all, or of the one of the short test.
fn drive(case: &Case, seed: u64, all: bool) -> Vec<Kept> {
    let vehicle = vehicle(case.vehicle);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let mut truth: Values =
        (case.truth)(&mut uniform).into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    let log = simulate(vehicle, case.first, seed, &truth);
    // What the first drive drew besides belongs to the machine.
    for variable in vehicle.parameters() {
        let known = truth.iter().any(|(name, _)| *name == variable.name);
        if let Some(values) = log.channel(&format!("true_{}", variable.name)).filter(|_| !known) {
            truth.push((variable.name.clone(), values[0]));
        }
    }
    let settings: Values = truth.iter().filter(|(name, _)| case.given.contains(&name.as_str())).cloned().collect();
    let request = DesignRequest {
        settings: settings.clone(),
        parameters: case.wanted.iter().map(|name| (*name).to_owned()).collect(),
        seed,
        scenarios: if all { Vec::new() } else { vec![case.short.to_owned()] },
        draws: if all { DesignRequest::default().draws } else { 9 },
        ..DesignRequest::default()
    };
    let plan = plan(vehicle, std::slice::from_ref(&log), &request);
    let mut kept = Vec::new();
    let mut judge = |candidate: &Candidate, promises: &[Option<Promise>], times: u64| {
        let drives = (0..times).map(|k| simulate(vehicle, &candidate.scenario, 7000 + 10 * seed + k, &truth));
        let logs: Vec<Log> = std::iter::once(log.clone()).chain(drives).collect();
        let request = FitRequest { settings: settings.clone(), ..FitRequest::default() };
        let report = vehicle.fit(&logs, &request, &Progress::none()).unwrap();
        for (interest, promise) in plan.parameters.iter().zip(promises) {
            let Some(promise) = promise.clone() else { continue };
            let achieved = report.parameters[&interest.name].std_error;
            let scenario = format!("{} x {times}", candidate.scenario);
            kept.push(Kept { name: interest.name.clone(), scenario, promise, achieved });
        }
    };
    for candidate in &plan.candidates {
        judge(candidate, &candidate.promises, 1);
    }
    for repeat in plan.repeats.iter().filter(|repeat| all || repeat.times == 2) {
        judge(&plan.candidates[0], &repeat.promises, repeat.times as u64);
    }
    kept
}

/// Runs per machine.
fn runs() -> u64 {
    std::env::var("WHEELSTATE_DRAWS").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

/// Share of achieved standard errors inside the promised range, by parameter and manoeuvre.
fn study(case: &Case, first: u64, all: bool) -> f64 {
    let mut table: BTreeMap<(String, String), Vec<Kept>> = BTreeMap::new();
    for seed in first..first + runs() {
        for kept in drive(case, seed, all) {
            table.entry((kept.name.clone(), kept.scenario.clone())).or_default().push(kept);
        }
    }
    for ((name, scenario), kept) in &table {
        let n = kept.len() as f64;
        let inside = kept.iter().filter(|kept| kept.inside()).count();
        let ratio = (kept.iter().map(|k| (k.achieved / k.promise.std_error).ln()).sum::<f64>() / n).exp();
        let width = (kept.iter().map(|k| (k.promise.high / k.promise.low).ln()).sum::<f64>() / n / 2.0).exp();
        println!(
            "{:14} {name:24} {scenario:22} inside {inside:3} of {n:3}  achieved / promised {ratio:.2}  range */ {width:.2}",
            case.vehicle
        );
        for k in kept.iter().filter(|k| !k.inside()) {
            println!(
                "      outside: {:.4} of {:.4} ({:.4}..{:.4})",
                k.achieved, k.promise.std_error, k.promise.low, k.promise.high
            );
        }
    }
    let count = table.values().flatten().count();
    let inside = table.values().flatten().filter(|kept| kept.inside()).count();
    println!("{:14} inside {inside} of {count}", case.vehicle);
    inside as f64 / count as f64
}

#[test]
fn the_range_of_a_promise_holds_on_plants_with_other_tyres_drives_and_sensors() {
    let kept: Vec<Kept> = CASES.iter().flat_map(|case| drive(case, 40, false)).collect();
    let inside = kept.iter().filter(|kept| kept.inside()).count();
    // With nine machines a further one is inside in 80 of 100 cases, and the plant's own margin comes to that.
    assert!(kept.len() > 12 && 10 * inside >= 8 * kept.len(), "{inside} of {}", kept.len());
}

#[test]
#[ignore = "an hour: WHEELSTATE_DRAWS=10, WHEELSTATE_MACHINE=wheelchair, WHEELSTATE_SEED=500 for one machine"]
fn the_ranges_hold_for_all_manoeuvres() {
    let only = std::env::var("WHEELSTATE_MACHINE").ok();
    let first = std::env::var("WHEELSTATE_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(500);
    for case in CASES.iter().filter(|case| only.as_deref().is_none_or(|name| name == case.vehicle)) {
        assert!(study(case, first, true) >= 0.9);
    }
}

#[test]
fn the_settings_that_are_found_are_better_than_both_ends_of_their_limits() {
    let vehicle = vehicle("wheelchair");
    let request = DesignRequest {
        parameters: vec!["chair.drag".into()],
        scenarios: vec!["identification".into()],
        limits: vec![("plant.effort".into(), 0.3, 1.1)],
        exact: true,
        draws: 5,
        ..DesignRequest::default()
    };
    let best = &plan(vehicle, &[], &request).candidates[0];
    assert!((0.3..=1.1).contains(&best.settings["plant.effort"]), "{best:?}");
    let std_error = |candidate: &Candidate| candidate.promises[0].as_ref().map_or(f64::INFINITY, |p| p.std_error);
    for end in [0.3, 1.1] {
        let settings = vec![("plant.effort".into(), end)];
        let other =
            &plan(vehicle, &[], &DesignRequest { limits: Vec::new(), settings, ..request.clone() }).candidates[0];
        // The search knows one seed, and the bottom of the valley is flat.
        assert!(std_error(best) < 1.2 * std_error(other), "{best:?} {other:?}");
    }
}

#[test]
fn what_cannot_be_designed_is_refused_in_one_line_with_what_could_be() {
    let refused = |name: &str, request: DesignRequest| {
        let refusal = design(vehicle(name), Vec::new(), &request, |_| {}, &Progress::none()).unwrap_err().to_string();
        assert!(!refusal.contains('\n'), "{refusal}");
        refusal
    };
    let asked = |change: &dyn Fn(&mut DesignRequest)| {
        let mut request = DesignRequest::default();
        change(&mut request);
        request
    };
    for (name, request, words) in [
        ("human-dynamics", DesignRequest::default(), "no manoeuvre with commands"),
        ("wheelchair", asked(&|r| r.parameters = vec!["chair.dragg".into()]), "did you mean chair.drag?"),
        ("wheelchair", asked(&|r| r.limits = vec![("plant.effort".into(), 2.0, 1.0)]), "2..1 is no range"),
        ("wheelchair", asked(&|r| r.limits = vec![("plant.effort".into(), 1.0, 99.0)]), "plant.effort"),
        ("wheelchair", asked(&|r| r.scenarios = vec!["climbs".into()]), "did you mean climb?"),
        ("wheelchair", asked(&|r| r.draws = 1), "at least 5"),
        ("nursing-robot", asked(&|r| r.parameters = vec!["human.damping_roll".into()]), "do not foresee"),
        ("wheel-loader", asked(&|r| r.settings = vec![("plant.nothing".into(), 1.0)]), "plant.nothing"),
    ] {
        let refusal = refused(name, request);
        assert!(refusal.contains(words), "{name}: {refusal}");
    }
}
