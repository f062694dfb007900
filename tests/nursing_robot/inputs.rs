//! The nursing robot's estimator under arbitrary inputs, and its stored states.

use nalgebra::SMatrix;
use proptest::prelude::*;
use wheelstate::estimator::nursing_robot::sway::SwayBelief;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters, SwayModel};
use wheelstate::filter::sigma_points::cholesky;
use wheelstate::{Estimator, Status, Variables};

/// Plausible, extreme and broken numbers.
fn any_sample(scale: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -scale..scale,
        2 => Just(0.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NEG_INFINITY),
        1 => Just(1e300),
        1 => Just(-1e300),
        1 => Just(5e-324),
    ]
}

fn any_inputs() -> impl Strategy<Value = Inputs> {
    let channels = [25.0, 25.0, 2.0, 1.0, 0.5, 2.0, 0.5, 2.0, 3.0].map(any_sample);
    channels.prop_map(|flat| {
        let mut inputs = Inputs::default();
        inputs.read(&flat);
        inputs
    })
}

fn any_step() -> impl Strategy<Value = f64> {
    prop_oneof![20 => Just(0.01), 2 => 1e-9..0.2, 1 => any_sample(1.0)]
}

/// All models, a car, an empty robot.
fn configurations() -> Vec<Parameters> {
    let models = [SwayModel::Auto, SwayModel::PaperRaw, SwayModel::Paper, SwayModel::SoundTorque];
    let mut list: Vec<Parameters> = models
        .into_iter()
        .map(|model| {
            let mut p = Parameters::default();
            p.sway.model = model;
            p
        })
        .collect();
    let mut imu = Parameters::default();
    (imu.sway.use_tilt, imu.sway.use_tilt_rate) = (true, true);
    let mut car = Parameters::default();
    (car.robot.mass, car.human.swaying_fraction, car.mass.use_accelerometer) = (1300.0, 0.0, true);
    (car.aero.drag_area, car.limit.torque, car.limit.speed) = (0.7, 1e6, 200.0);
    let mut light = Parameters::default();
    (light.robot.mass, light.limit.load_mass, light.limit.slip_residual) = (1.0, 1e5, 1e6);
    list.extend([imu, car, light]);
    list
}

fn definite<const N: usize>(covariance: &SMatrix<f64, N, N>) -> bool {
    cholesky(covariance).is_some()
}

fn check(estimator: &NursingRobot, out: &Outputs) {
    assert!(out.to_vec().iter().all(|x| x.is_finite()), "{out:?}");
    let stds = Outputs::declare().into_iter().zip(out.to_vec()).filter(|(v, _)| v.name.ends_with("_std"));
    stds.for_each(|(v, std)| assert!(std >= 0.0, "{} = {std}", v.name));
    if let Some(state) = &estimator.state().machine.sway {
        let good = match state.belief {
            SwayBelief::Two(belief) => definite(&belief.covariance),
            SwayBelief::Three(belief) => definite(&belief.covariance),
            SwayBelief::Four(belief) => definite(&belief.covariance),
        };
        assert!(good, "{:?}", state.belief);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    #[test]
    fn outputs_stay_finite_and_covariances_positive(
        samples in prop::collection::vec((any_inputs(), any_step(), any_sample(0.1)), 1..300)
    ) {
        for parameters in configurations() {
            let mut estimator = NursingRobot::new(&parameters).unwrap();
            let mut out = Outputs::default();
            for (inputs, dt, horizon) in &samples {
                estimator.step(inputs, *dt);
                for horizon in [0.0, horizon.abs()] {
                    estimator.outputs(inputs, horizon, &mut out);
                    check(&estimator, &out);
                }
            }
            // A sane sample afterwards finds a working filter.
            (0..200).for_each(|_| {
                estimator.step(&standing(), 0.01);
            });
            estimator.outputs(&standing(), 0.0, &mut out);
            check(&estimator, &out);
            assert!(!out.diagnostics.status.contains(Status::RECOVERED));
        }
    }

    /// Any parameters within their ranges are refused with a reason or give a working estimator.
    #[test]
    fn any_allowed_parameters_work(shares in prop::collection::vec(0.0..=1.0f64, Parameters::COUNT), inputs in prop::collection::vec(any_inputs(), 20)) {
        let mut parameters = Parameters::default();
        let flat: Vec<f64> = Parameters::declare()
            .iter()
            .zip(&shares)
            .map(|(v, share)| {
                let (low, high) = v.range;
                let value = if low > 0.0 { low * (high / low).powf(*share) } else { low + (high - low) * share };
                let whole = v.kind != wheelstate::variable::Kind::Real;
                if whole { value.round() } else { value }.clamp(low, high)
            })
            .collect();
        parameters.read(&flat);
        if let Ok(mut estimator) = NursingRobot::new(&parameters) {
            let mut out = Outputs::default();
            for inputs in &inputs {
                estimator.step(inputs, parameters.sample_period);
                estimator.outputs(inputs, 0.5 * parameters.sample_period, &mut out);
                assert!(out.to_vec().iter().all(|x| x.is_finite()), "{parameters:?} {out:?}");
            }
        }
    }
}

/// A robot that stands and measures everything.
fn standing() -> Inputs {
    let mut inputs = Inputs::default();
    inputs.read(&[0.0; Inputs::COUNT]);
    inputs
}

fn drive(row: usize) -> Inputs {
    let t = row as f64 * 0.01;
    Inputs {
        torque_left: 6.0 + 5.0 * (2.0 * t).sin(),
        torque_right: 6.0 + 5.0 * (2.1 * t).sin(),
        speed: 0.5 * t.sin() + 0.6,
        yaw_rate: 0.1 * t.cos(),
        tilt: 0.02 * (3.0 * t).sin(),
        tilt_rate: if row.is_multiple_of(17) { f64::NAN } else { 0.06 * (3.0 * t).cos() },
        ..Inputs::default()
    }
}

#[test]
fn a_stored_state_continues_with_the_same_bits() {
    for parameters in configurations() {
        let mut first = NursingRobot::new(&parameters).unwrap();
        (0..400).for_each(|row| {
            first.step(&drive(row), 0.01);
        });
        let stored = serde_json::to_value(first.state()).unwrap();
        let state: <NursingRobot as Estimator>::State = serde_json::from_value(stored).unwrap();
        let mut second = NursingRobot::new(&parameters).unwrap();
        second.restore(&state).unwrap();
        let (mut a, mut b) = (Outputs::default(), Outputs::default());
        for row in 400..700 {
            first.step(&drive(row), 0.01);
            second.step(&drive(row), 0.01);
            first.outputs(&drive(row), 0.003, &mut a);
            second.outputs(&drive(row), 0.003, &mut b);
            let bits = |out: &Outputs| out.to_vec().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&a), bits(&b), "row {row}");
        }
    }
}

/// Copies of a stored state, each with another number replaced by the largest one.
fn spoilt(value: &serde_json::Value, copies: &mut Vec<serde_json::Value>) {
    fn paths(value: &serde_json::Value, here: String, list: &mut Vec<String>) {
        match value {
            serde_json::Value::Number(n) if n.is_f64() => list.push(here),
            serde_json::Value::Array(items) => {
                items.iter().enumerate().for_each(|(i, item)| paths(item, format!("{here}/{i}"), list));
            }
            serde_json::Value::Object(items) => {
                items.iter().for_each(|(name, item)| paths(item, format!("{here}/{name}"), list));
            }
            _ => {}
        }
    }
    let mut list = Vec::new();
    paths(value, String::new(), &mut list);
    for place in list {
        let mut copy = value.clone();
        // The largest number overflows as soon as anything is computed with it; JSON has no infinity.
        *copy.pointer_mut(&place).unwrap() = serde_json::json!(f64::MAX);
        copies.push(copy);
    }
}

#[test]
fn states_that_do_not_fit_are_refused_or_harmless() {
    let mut estimator = NursingRobot::new(&Parameters::default()).unwrap();
    (0..200).for_each(|row| {
        estimator.step(&drive(row), 0.01);
    });
    let good = estimator.state().clone();
    let other = {
        let mut p = Parameters::default();
        p.sway.model = SwayModel::SoundTorque;
        NursingRobot::new(&p).unwrap()
    };
    assert!(estimator.restore(other.state()).is_err(), "a state of another model is refused");
    assert_eq!(estimator.state(), &good, "a refused state changes nothing");

    // Extreme but finite numbers must not lead to outputs that are not finite.
    let mut states = Vec::new();
    spoilt(&serde_json::to_value(&good).unwrap(), &mut states);
    let mut out = Outputs::default();
    for state in states {
        let state: <NursingRobot as Estimator>::State = serde_json::from_value(state).unwrap();
        let mut estimator = NursingRobot::new(&Parameters::default()).unwrap();
        if estimator.restore(&state).is_ok() {
            for row in 0..20 {
                estimator.outputs(&drive(row), 0.01, &mut out);
                assert!(out.to_vec().iter().all(|x| x.is_finite()), "{out:?}");
                estimator.step(&drive(row), 0.01);
            }
        }
    }
}

#[test]
fn parameters_that_do_not_fit_together_are_refused_by_name() {
    let refused = |change: fn(&mut Parameters)| {
        let mut p = Parameters::default();
        change(&mut p);
        NursingRobot::new(&p).map(|_| ()).unwrap_err().to_string()
    };
    let toppling = refused(|p| p.human.stiffness_pitch = 100.0);
    assert!(toppling.contains("human.stiffness_pitch = 100") && toppling.contains("142.7"), "{toppling}");
    assert!(refused(|p| p.mass.forgetting_fast = 0.999).contains("mass.forgetting_fast"));
    assert!(refused(|p| p.limit.load_mass_low = -160.0).contains("limit.load_mass_low"));
    assert!(refused(|p| p.robot.mass = f64::NAN).contains("robot.mass"));
}
