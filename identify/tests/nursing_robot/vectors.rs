//! Identification of the nursing robot against the reference vectors.

use crate::support::{assert_close, vector_table, vector_text};
use wheelstate_identify::problem::weak_form::ModulatingFunction;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::solve::{Loss, Options, Regression, Rows, Unknown, solve};
use wheelstate_identify::vehicles::nursing_robot::problem::refine::{Segment, Setup, refine};
use wheelstate_identify::vehicles::nursing_robot::problem::rows::{self, Body, Drive, Signals, Windows};
use wheelstate_identify::vehicles::nursing_robot::problem::sway::Passive;

fn expected() -> serde_json::Value {
    serde_json::from_str(&vector_text("nursing_robot/ident_expected.json")).unwrap()
}

fn body(expected: &serde_json::Value) -> Body {
    let truth = |name: &str| expected["truth"][name].as_f64().unwrap();
    let (human_mass, mu, h, rho) = (truth("m_h"), truth("mu"), truth("h"), truth("rho"));
    Body {
        robot_mass: 160.0,
        rotating_mass: 2.0 * 0.0004 / 0.0825f64.powi(2),
        human_mass,
        lever: mu * h,
        b: mu * human_mass * h,
        j: mu * human_mass * (h * h + rho * rho),
        efficiency: 1.0,
        smoothing_speed: 0.02,
        air_density: 1.2,
        drag_area: 0.0,
    }
}

fn signals() -> Signals {
    let table = vector_table("nursing_robot/ident_log.csv");
    let (left, right) = (table.values("tau_l"), table.values("tau_r"));
    Signals {
        period: 0.01,
        start: 0.0,
        force: left.iter().zip(&right).map(|(l, r)| (l + r) / 0.0825).collect(),
        speed: table.values("v").into(),
        yaw_rate: table.values("omega").into(),
        pitch: table.values("phi_y").into(),
        pitch_rate: table.values("gyro_y").into(),
        roll: table.values("phi_x").into(),
        roll_rate: Default::default(),
        turning: Default::default(),
        accel: Default::default(),
    }
}

fn regression(kind: &str, body: &Body, signals: &Signals) -> Regression {
    let psi = if kind == "blind" {
        ModulatingFunction::polynomial(200, 0.01, 6)
    } else {
        ModulatingFunction::polynomial(120, 0.01, 4)
    };
    let windows = Windows { signals, psi: &psi, stride: 10, cluster: 12, progress: Progress::none() };
    let stiffness = || vec![Unknown::within("k", 0.0, 5000.0), Unknown::within("c", 0.0, 500.0), Unknown::free("k0")];
    let unknowns = match kind {
        "long_f" => vec![Unknown::within("f", 0.0, 0.1)],
        "long_f_eta" => vec![Unknown::within("f", 0.0, 0.1), Unknown::within("eta", 0.5, 1.5)],
        "long_f_mh" => vec![Unknown::within("fM", 0.0, 100.0), Unknown::within("m_h", 0.0, 300.0)],
        "blind" => vec![Unknown::within("c", 0.0, 500.0), Unknown::free("k'"), Unknown::free("p3")],
        _ => stiffness(),
    };
    let mut group = Rows::new(kind, "N.m", unknowns.len());
    match kind {
        "pitch" => rows::pitch(&mut group, &windows, body),
        "roll" => rows::roll(&mut group, &windows, body),
        "long_f" => rows::drive(&mut group, &windows, body, Drive::Rolling, false),
        "long_f_eta" => rows::drive(&mut group, &windows, body, Drive::RollingEfficiency, false),
        "long_f_mh" => rows::drive(&mut group, &windows, body, Drive::RollingLoad, false),
        _ => rows::wheels_only(&mut group, &windows, body),
    }
    Regression { name: kind.into(), unknowns, groups: vec![group], constraints: Vec::new() }
}

#[test]
fn weak_form_fits_match_the_reference() {
    let expected = expected();
    let (body, signals) = (body(&expected), signals());
    for kind in ["pitch", "roll", "long_f", "long_f_eta", "long_f_mh", "blind"] {
        let regression = regression(kind, &body, &signals);
        for (loss, tolerance) in [(Loss::Ls, 1e-4), (Loss::Huber, 1e-4), (Loss::L1, 1e-3)] {
            let what = format!("{kind}/{}", loss.word());
            let fit = &expected["fits"][&what];
            let numbers = |key: &str| -> Vec<f64> {
                fit[key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
            };
            let group = &regression.groups[0];
            assert_eq!(group.len() as u64, fit["n"].as_u64().unwrap(), "{what}");
            for (actual, expected) in group.row(0).iter().zip(numbers("A_first_row")) {
                assert_close(&format!("{what} first row"), *actual, expected, 1e-9, 1e-9);
            }
            assert_close(&format!("{what} first y"), group.y[0], fit["y_first"].as_f64().unwrap(), 1e-9, 1e-9);
            let solution = solve(&regression, &Options { loss, ..Options::default() }).unwrap();
            for (j, expected) in numbers("x").into_iter().enumerate() {
                assert_close(&format!("{what} x{j}"), solution.theta[j], expected, tolerance, tolerance);
            }
            assert_close(&format!("{what} scale"), solution.scales[0], fit["scale"].as_f64().unwrap(), 1e-6, 0.0);
            assert_close(&format!("{what} cond"), solution.condition_number, fit["cond"].as_f64().unwrap(), 1e-6, 0.0);
            for (j, expected) in numbers("se").into_iter().enumerate() {
                let actual = solution.sandwich[(j, j)].sqrt();
                assert_close(&format!("{what} se{j}"), actual, expected, tolerance, 0.0);
            }
        }
    }
}

#[test]
fn refinement_matches_the_reference() {
    let expected = expected();
    let (body, mut signals) = (body(&expected), signals());
    signals.force.truncate(1500);
    for channel in [&mut signals.speed, &mut signals.yaw_rate, &mut signals.pitch] {
        *channel = channel.part(0..1500);
    }
    let huber = &expected["fits"]["pitch/huber"]["x"];
    let start = Passive {
        stiffness: huber[0].as_f64().unwrap(),
        damping: huber[1].as_f64().unwrap(),
        rolling: expected["fits"]["long_f/huber"]["x"][0].as_f64().unwrap(),
        rest: huber[2].as_f64().unwrap() / huber[0].as_f64().unwrap(),
    };
    // The reference weighs speeds with 0.006 m/s: sensor noise and quantisation.
    let setup = Setup {
        speed_std: 0.006,
        pitch_std: Some(0.01),
        efficiency: false,
        loss: Loss::Huber,
        correct: false,
        profiled: [false; 3],
        progress: &Progress::none(),
    };
    let segment = Segment { signals: &signals, samples: 0..1500 };
    let solution = refine(&[segment], &body, &start, &setup).unwrap().solution;
    let reference = &expected["refine_15s"];
    let cost = reference["cost"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    assert_close("cost", *solution.cost.last().unwrap(), cost, 1e-3, 0.0);
    for j in 0..7 {
        let (x, se) = (reference["x"][j].as_f64().unwrap(), reference["se"][j].as_f64().unwrap());
        println!("{}: {} {x}, se {} {se}", reference["names"][j], solution.theta[j], solution.sandwich[(j, j)].sqrt());
        assert_close(&reference["names"][j].to_string(), solution.theta[j], x, 1e-3, 1e-3);
    }
}
