//! Bad, missing and strange inputs of the wheelchair's estimator, and its state.

use super::runs::{Drive, Normal, Row, drive};
use crate::support::assert_close;
use wheelstate::estimator::wheelchair::{Inputs, Kind, Outputs, Parameters, Wheelchair, Zero};
use wheelstate::plant::wheelchair::Course;
use wheelstate::{Estimator, Status, Variables};

fn parameters(kind: Kind) -> Parameters {
    let mut p = Parameters::default();
    p.initial.heading = Course::Oblique.heading();
    p.filter.kind = kind;
    p
}

const KINDS: [Kind; 4] = [Kind::Basic, Kind::Bias, Kind::AccelerationInput, Kind::GravityVector];

fn rows() -> Vec<Row> {
    drive(&Drive::nominal(Course::Oblique), &mut Normal::new(1))
}

fn outputs(estimator: &Wheelchair, inputs: &Inputs) -> Outputs {
    let mut outputs = Outputs::default();
    estimator.outputs(inputs, 0.0, &mut outputs);
    outputs
}

/// An estimator that has seen the first `count` samples.
fn warm(kind: Kind, rows: &[Row], count: usize) -> Wheelchair {
    let mut estimator = Wheelchair::new(&parameters(kind)).unwrap();
    for row in &rows[..count] {
        estimator.step(&row.inputs, 0.01);
    }
    estimator
}

#[track_caller]
fn all_finite(outputs: &Outputs) {
    for (variable, value) in Outputs::declare().iter().zip(outputs.to_vec()) {
        assert!(value.is_finite(), "{} = {value}", variable.name);
        variable.check(value).unwrap();
    }
}

#[test]
fn impossible_parameters_are_refused_by_name() {
    let positive = [
        "chair.mass",
        "chair.yaw_inertia",
        "chair.wheel_radius",
        "chair.reference_to_right",
        "chair.reference_to_left",
        "gravity",
    ];
    let not_negative = ["chair.drag", "chair.yaw_drag", "rolling.coefficient", "chair.yaw_friction"];
    for (name, value) in
        positive.iter().flat_map(|n| [(n, 0.0), (n, -1.0)]).chain(not_negative.iter().map(|n| (n, -0.1)))
    {
        let declared = Parameters::declare();
        let index = declared.iter().position(|v| v.name == *name).unwrap();
        let mut flat = Parameters::default().to_vec();
        flat[index] = value;
        let mut p = Parameters::default();
        p.read(&flat);
        let error = Wheelchair::new(&p).unwrap_err();
        assert_eq!(error.name, *name);
        assert!(error.to_string().contains("allowed range"), "{error}");
    }
    for (index, variable) in Parameters::declare().iter().enumerate() {
        if variable.kind != wheelstate::variable::Kind::Real {
            continue;
        }
        let mut flat = Parameters::default().to_vec();
        flat[index] = f64::NAN;
        let mut p = Parameters::default();
        p.read(&flat);
        assert_eq!(Wheelchair::new(&p).unwrap_err().name, variable.name, "NaN");
    }
    let mut p = parameters(Kind::GravityVector);
    p.filter.model = wheelstate::estimator::wheelchair::Model::Paper;
    assert_eq!(Wheelchair::new(&p).unwrap_err().name, "filter.kind");
}

#[test]
fn unusable_steps_change_nothing() {
    let rows = rows();
    for kind in KINDS {
        let mut estimator = warm(kind, &rows, 300);
        let before = estimator.state().clone();
        for dt in [0.0, -0.01, f64::NAN, f64::INFINITY] {
            let status = estimator.step(&rows[300].inputs, dt);
            assert!(status.contains(Status::BAD_STEP | Status::SKIPPED), "{dt}: {status}");
            assert_eq!(*estimator.state(), before);
        }
    }
}

/// The same commands with nothing measured.
fn unmeasured(inputs: &Inputs) -> Inputs {
    Inputs { drive_force: inputs.drive_force, drive_moment: inputs.drive_moment, ..Inputs::default() }
}

/// A long step equals its sub-steps with nothing measured in between.
#[test]
fn a_long_step_equals_its_substeps() {
    let rows = rows();
    for kind in [Kind::Basic, Kind::Bias, Kind::GravityVector] {
        let mut long = warm(kind, &rows, 300);
        let mut short = long.clone();
        let nothing = unmeasured(&rows[299].inputs);
        long.step(&nothing, 0.1);
        for _ in 0..5 {
            short.step(&nothing, 0.02);
        }
        let (a, b) = (outputs(&long, &nothing).to_vec(), outputs(&short, &nothing).to_vec());
        for (variable, (a, b)) in Outputs::declare().iter().zip(a.iter().zip(b)) {
            assert_close(&variable.name, *a, b, 1e-12, 1e-14);
        }
    }
}

#[test]
fn the_last_valid_command_is_held() {
    let rows = rows();
    for (bad, bit) in [(f64::NAN, Status::HELD_INPUT), (f64::INFINITY, Status::INFINITE), (1e5, Status::IMPLAUSIBLE)] {
        let mut held = warm(Kind::Basic, &rows, 300);
        let mut repeated = held.clone();
        let mut inputs = rows[300].inputs.clone();
        inputs.drive_force = bad;
        let status = held.step(&inputs, 0.01);
        assert!(status.contains(Status::HELD_INPUT | bit), "{status}");
        inputs.drive_force = rows[299].inputs.drive_force;
        assert!(!repeated.step(&inputs, 0.01).contains(Status::HELD_INPUT));
        assert_eq!(outputs(&held, &inputs).slope, outputs(&repeated, &inputs).slope);
    }
    // Before any valid command there is none.
    let mut fresh = warm(Kind::Basic, &rows, 0);
    let inputs = Inputs { drive_force: f64::NAN, drive_moment: f64::NAN, ..Inputs::default() };
    assert!(fresh.step(&inputs, 0.01).contains(Status::NEVER_SET));
    all_finite(&outputs(&fresh, &inputs));
}

#[test]
fn bad_channels_are_left_out_and_the_others_used() {
    let rows = rows();
    type Set = fn(&mut Inputs, f64);
    let set: [(&str, Set); 6] = [
        ("encoder_left", |i, v| i.encoder_left = v),
        ("encoder_right", |i, v| i.encoder_right = v),
        ("gyro_pitch", |i, v| i.gyro_pitch = v),
        ("accel_x", |i, v| i.accel_x = v),
        ("accel_y", |i, v| i.accel_y = v),
        ("accel_z", |i, v| i.accel_z = v),
    ];
    for kind in KINDS {
        for (channel, set) in set {
            let missing = |value: f64| {
                let mut estimator = warm(kind, &rows, 300);
                let mut inputs = rows[300].inputs.clone();
                set(&mut inputs, value);
                let status = estimator.step(&inputs, 0.01);
                (status, estimator)
            };
            let (status, without) = missing(f64::NAN);
            assert!(status.contains(Status::MISSING), "{kind:?} {channel}: {status}");
            let result = outputs(&without, &rows[300].inputs);
            all_finite(&result);
            let all = if kind == Kind::AccelerationInput { 5 } else { 6 };
            let lost = match channel {
                "accel_x" if kind == Kind::AccelerationInput => 0,
                // the upward accelerometer shows no tilt alone
                "gyro_pitch" => 2,
                _ => 1,
            };
            assert_eq!(result.diagnostics.nis_channels, all - lost, "{kind:?} {channel}");
            let cases: &[(f64, Status)] = if channel.starts_with("encoder") {
                &[(f64::INFINITY, Status::INFINITE), (1e6, Status::IMPLAUSIBLE)]
            } else {
                &[(f64::NEG_INFINITY, Status::INFINITE), (39.3, Status::IMPLAUSIBLE)]
            };
            for (value, bit) in cases {
                let (status, estimator) = missing(*value);
                assert!(status.contains(*bit), "{kind:?} {channel} {value}: {status}");
                let same = outputs(&estimator, &rows[300].inputs);
                assert_eq!(same.slope.value, result.slope.value, "{kind:?} {channel} {value}");
                assert_eq!(same.speed.value, result.speed.value);
            }
        }
    }
}

#[test]
fn without_any_sample_only_time_passes() {
    let rows = rows();
    for kind in KINDS {
        let mut estimator = warm(kind, &rows, 300);
        let known = outputs(&estimator, &rows[299].inputs);
        let nothing = unmeasured(&rows[299].inputs);
        let mut last = known.clone();
        for k in 0..300 {
            let mut ahead = Outputs::default();
            estimator.outputs(&nothing, 0.01, &mut ahead);
            let status = estimator.step(&nothing, 0.01);
            assert!(status.contains(Status::NO_MEASUREMENT | Status::MISSING));
            last = outputs(&estimator, &nothing);
            all_finite(&last);
            // The mean is what the outputs between samples had announced.
            if k == 0 && kind != Kind::AccelerationInput {
                assert_eq!(
                    (last.speed.value, last.slope.value, last.distance.value),
                    (ahead.speed.value, ahead.slope.value, ahead.distance.value)
                );
            }
        }
        assert!(last.slope.std > known.slope.std && last.distance.std > known.distance.std);
        assert!(
            !last.diagnostics.healthy && last.diagnostics.nis == 0.0 && last.diagnostics.nis_channels == 0,
            "{kind:?}"
        );
    }
}

/// The update alone leaves mean and covariance as they are, and counts no row.
#[test]
fn an_update_without_rows_does_nothing() {
    use wheelstate::estimator::wheelchair::{Basic, ekf, ekf::ChairEkf};
    use wheelstate::filter::gaussian::Gaussian;
    use wheelstate::model::wheelchair::{Command, Output, State};
    let p = parameters(Kind::Basic);
    let observer = ChairEkf { chair: p.chair(), noise: p.noise(), limits: p.limits(), gate: p.gate(), form: Basic };
    let mut filter = Gaussian::independent(State::repeat(0.1), &State::repeat(0.1));
    let before = filter;
    let drive = ekf::Drive::reported(Command::zeros(), false);
    let update = observer.correct(&mut filter, &mut [0; 6], &Output::repeat(f64::NAN).into(), &drive).unwrap();
    assert!(update.nis == 0.0 && update.dof == 0);
    assert_eq!(filter, before);
}

/// A whole turn in the encoders' heading changes nothing in the filter.
#[test]
fn a_turn_of_the_heading_is_no_innovation() {
    use wheelstate::estimator::wheelchair::{Basic, ekf, ekf::ChairEkf};
    use wheelstate::filter::gaussian::Gaussian;
    use wheelstate::model::wheelchair::{Command, Output, State, output};
    let p = parameters(Kind::Basic);
    let observer = ChairEkf { chair: p.chair(), noise: p.noise(), limits: p.limits(), gate: p.gate(), form: Basic };
    let x = State::from([0.1, 3.1, 0.5, 0.2, 0.05, 0.0]);
    let drive = ekf::Drive::reported(Command::new(30.0, 1.0), false);
    let mut results = vec![];
    for turns in [0.0, 1.0, -3.0] {
        let mut filter = Gaussian::independent(x, &State::repeat(0.03));
        let mut y: Output =
            output(&observer.chair, &State::from([0.11, 3.13, 0.52, 0.2, 0.06, 0.0]), &drive.command, false);
        y[1] += turns * std::f64::consts::TAU;
        observer.correct(&mut filter, &mut [0; 6], &y.into(), &drive).unwrap();
        results.push(filter.mean);
    }
    for other in &results[1..] {
        assert!((results[0] - other).amax() < 1e-12);
    }
}

/// A constant error of 5 m/s^2 to the left: ten rejections, one sample let through, and so on.
#[test]
fn the_gate_lets_every_eleventh_outlier_through() {
    let rows = rows();
    let mut p = parameters(Kind::Basic);
    p.filter.gate = 6.0;
    let mut estimator = Wheelchair::new(&p).unwrap();
    for row in &rows[..300] {
        assert!(!estimator.step(&row.inputs, 0.01).contains(Status::GATED));
    }
    let rejected = rows[300..315].iter().filter(|row| {
        let mut inputs = row.inputs.clone();
        inputs.accel_y += 5.0;
        estimator.step(&inputs, 0.01).contains(Status::GATED)
    });
    assert_eq!(rejected.count(), 14);
}

/// One wheel's encoder is still a measurement: travel and heading are known in their combination.
#[test]
fn one_wheel_alone_still_measures() {
    let rows = rows();
    // The right wheel travels s + T/2 (alpha - alpha_0) exactly, whatever its parts are, the left one s - T/2 of it.
    for half_track in [0.27, -0.27] {
        let mut one = warm(Kind::Basic, &rows, 200);
        let mut none = one.clone();
        for row in &rows[200..300] {
            let mut inputs = row.inputs.clone();
            let (first, last) = match half_track > 0.0 {
                true => (&mut inputs.encoder_left, &mut inputs.encoder_right),
                false => (&mut inputs.encoder_right, &mut inputs.encoder_left),
            };
            *first = f64::NAN;
            let kept = std::mem::replace(last, f64::NAN);
            none.step(&inputs, 0.01);
            *(if half_track > 0.0 { &mut inputs.encoder_right } else { &mut inputs.encoder_left }) = kept;
            one.step(&inputs, 0.01);
        }
        let (one, none, truth) = (outputs(&one, &rows[299].inputs), outputs(&none, &rows[299].inputs), rows[299].truth);
        assert!((one.speed.value - truth.speed).abs() < 0.03, "{} {}", one.speed.value, truth.speed);
        assert!(one.speed.std < 0.7 * none.speed.std);
        let wheel = |o: &Outputs| o.distance.value + half_track * o.heading.value;
        let pitch_travel = 0.305 * truth.pitch;
        assert!((wheel(&one) - truth.distance - half_track * truth.heading - pitch_travel).abs() < 0.004);
    }
}

/// Within the bands that tell rest from motion a chair may have begun to move, however sure the filter was of its rest.
#[test]
fn after_a_standstill_speed_and_yaw_rate_may_be_what_the_bands_have_hidden() {
    let p = parameters(Kind::Bias);
    let mut estimator = Wheelchair::new(&p).unwrap();
    let mut inputs = Inputs {
        encoder_left: 0.0,
        encoder_right: 0.0,
        gyro_pitch: 0.0,
        accel_x: 0.0,
        accel_y: 0.0,
        accel_z: 9.80665,
        drive_force: 0.0,
        drive_moment: 0.0,
    };
    let mut status = Status::OK;
    for _ in 0..200 {
        status = estimator.step(&inputs, 0.01);
    }
    assert!(status.contains(Status::STANDSTILL));
    let before = outputs(&estimator, &inputs);
    // a push that the wheels do not show
    (inputs.encoder_left, inputs.encoder_right, inputs.accel_x) = (f64::NAN, f64::NAN, 1.0);
    assert!(!estimator.step(&inputs, 0.01).contains(Status::STANDSTILL));
    let after = outputs(&estimator, &inputs);
    let (speed, yaw_rate) = (p.standstill.distance_band / 0.05, p.standstill.heading_band / 0.05);
    assert!(before.speed.std < 0.5 * speed && after.speed.std > 0.8 * speed, "{:?} {:?}", before.speed, after.speed);
    let [before, after] = [before, after].map(|outputs| outputs.yaw_rate.std);
    assert!(before < 0.5 * yaw_rate && after > 0.8 * yaw_rate, "{before} {after} of {yaw_rate} rad/s");
}

/// A chair at rest elsewhere weighs what gravity makes of it.
#[test]
fn gravity_is_what_the_parameter_says() {
    let run = |gravity: f64| {
        let mut p = parameters(Kind::Bias);
        p.gravity = gravity;
        let mut estimator = Wheelchair::new(&p).unwrap();
        let inputs = Inputs {
            encoder_left: 0.0,
            encoder_right: 0.0,
            gyro_pitch: 0.0,
            accel_x: 0.0,
            accel_y: 0.0,
            accel_z: 9.6,
            drive_force: 0.0,
            drive_moment: 0.0,
        };
        for _ in 0..200 {
            estimator.step(&inputs, 0.01);
        }
        outputs(&estimator, &inputs).accel_z_bias.value
    };
    assert!(run(9.6).abs() < 0.01, "{}", run(9.6));
    assert!((run(9.8) + 0.2).abs() < 0.05, "{}", run(9.8));
}

/// Counters that begin anywhere, and counters that restart on the way.
#[test]
fn encoders_may_count_from_anywhere() {
    let rows = rows();
    let run = |offset: [f64; 2], reset_at: usize, zero: Zero| {
        let mut p = parameters(Kind::Bias);
        p.encoder.zero = zero;
        let mut estimator = Wheelchair::new(&p).unwrap();
        let mut seen = Status::OK;
        for (k, row) in rows.iter().enumerate().take(600) {
            let mut inputs = row.inputs.clone();
            if k < reset_at {
                inputs.encoder_left += offset[0];
                inputs.encoder_right += offset[1];
            }
            seen |= estimator.step(&inputs, 0.01);
        }
        (outputs(&estimator, &rows[599].inputs), seen)
    };
    let truth = rows[599].truth;
    let (plain, seen) = run([0.0, 0.0], 0, Zero::Auto);
    assert!(!seen.contains(Status::RESTARTED) && (plain.slope.value - truth.slope).abs() < 0.008);
    let (shifted, seen) = run([137.0, -52.0], 600, Zero::Auto);
    assert!(!seen.contains(Status::RESTARTED));
    assert!((shifted.slope.value - truth.slope).abs() < 0.008 && (shifted.heading.value - truth.heading).abs() < 0.03);
    let (restarted, seen) = run([137.0, -52.0], 400, Zero::Auto);
    assert!(seen.contains(Status::RESTARTED | Status::IMPLAUSIBLE));
    assert!((restarted.speed.value - truth.speed).abs() < 0.03, "{} {}", restarted.speed.value, truth.speed);
    assert!((restarted.slope.value - truth.slope).abs() < 0.012, "{} {}", restarted.slope.value, truth.slope);
    assert!((restarted.heading.value - truth.heading).abs() < 0.06, "{} {}", restarted.heading.value, truth.heading);
    let (absolute, _) = run([0.2, 0.2], 600, Zero::Absolute);
    assert!((absolute.distance.value - plain.distance.value - 0.2 * 0.305).abs() < 0.01);
    let (first, _) = run([0.02, 0.02], 600, Zero::FirstSample);
    assert!((first.distance.value - plain.distance.value).abs() < 0.01);
}

/// Restoring a state and repeating the inputs repeats the bytes; foreign or broken states are refused.
#[test]
fn states_are_stored_and_restored() {
    let rows = rows();
    for kind in KINDS {
        let mut estimator = warm(kind, &rows, 250);
        let stored = serde_json::to_value(estimator.state()).unwrap();
        let mut other = Wheelchair::new(&parameters(kind)).unwrap();
        other.restore(&serde_json::from_value(stored).unwrap()).unwrap();
        for row in &rows[250..] {
            assert_eq!(estimator.step(&row.inputs, 0.01), other.step(&row.inputs, 0.01));
        }
        assert_eq!(outputs(&estimator, &rows[0].inputs).to_vec(), outputs(&other, &rows[0].inputs).to_vec());
        assert_eq!(*estimator.state(), *other.state());

        let foreign = if kind == Kind::Basic { Kind::Bias } else { Kind::Basic };
        let mut stranger = Wheelchair::new(&parameters(foreign)).unwrap();
        let before = stranger.state().clone();
        assert!(stranger.restore(estimator.state()).is_err());
        assert_eq!(*stranger.state(), before);

        let mut broken = estimator.state().clone();
        match &mut broken.machine.belief {
            wheelstate::estimator::wheelchair::ChairBelief::Basic(filter) => filter.mean[0] = f64::NAN,
            wheelstate::estimator::wheelchair::ChairBelief::Biased(filter) => filter.covariance[(0, 0)] = -1.0,
            wheelstate::estimator::wheelchair::ChairBelief::Gravity(filter) => {
                filter.covariance[(0, 0)] = f64::INFINITY
            }
        }
        assert!(estimator.restore(&broken).is_err());
    }
}

#[test]
fn tunable_parameters_keep_the_state() {
    let rows = rows();
    let mut estimator = warm(Kind::Bias, &rows, 300);
    let before = estimator.state().clone();
    let mut p = parameters(Kind::Bias);
    p.filter.gate = 5.0;
    estimator.retune(&p).unwrap();
    assert_eq!(*estimator.state(), before);
    p.filter.gate = -5.0;
    assert_eq!(estimator.retune(&p).unwrap_err().name, "filter.gate");
}

/// Both forms of the same pose are one; the canonical one has no negative slope.
#[test]
fn canonical_outputs_describe_the_same_pose() {
    let rows = rows();
    let mut p = parameters(Kind::Basic);
    p.initial.heading -= std::f64::consts::PI; // uphill is where the estimator thinks downhill is
    let mut plain = Wheelchair::new(&p).unwrap();
    p.filter.canonical_slope = true;
    let mut canonical = Wheelchair::new(&p).unwrap();
    for row in &rows[..400] {
        plain.step(&row.inputs, 0.01);
        canonical.step(&row.inputs, 0.01);
    }
    let (a, b, truth) = (outputs(&plain, &rows[399].inputs), outputs(&canonical, &rows[399].inputs), rows[399].truth);
    assert!(a.slope.value < -0.07 && b.slope.value == -a.slope.value && b.slope_rate.value == -a.slope_rate.value);
    assert_close("heading", b.heading.value, a.heading.value + std::f64::consts::PI, 1e-12, 0.0);
    assert!((b.heading.value - truth.heading).abs() < 0.01 && (b.pitch.value - truth.pitch).abs() < 0.01);
    assert_eq!(a.pitch, b.pitch);
}

/// Garbage in every channel for a while, then good samples: finite throughout, and right again.
#[test]
fn garbage_is_survived() {
    let rows = rows();
    for kind in KINDS {
        let mut normal = Normal::new(9);
        let mut estimator = warm(kind, &rows, 100);
        let poison = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e9, 0.0, -39.0, 8.0];
        for _ in 0..2000 {
            let mut pick = || poison[(normal.uniform().abs() * poison.len() as f64) as usize % poison.len()];
            let inputs = Inputs {
                encoder_left: pick(),
                encoder_right: pick(),
                gyro_pitch: pick(),
                accel_x: pick(),
                accel_y: pick(),
                accel_z: pick(),
                drive_force: pick(),
                drive_moment: pick(),
            };
            estimator.step(&inputs, 0.01);
            all_finite(&outputs(&estimator, &inputs));
        }
        for row in &rows[100..900] {
            estimator.step(&row.inputs, 0.01);
        }
        let (end, truth) = (outputs(&estimator, &rows[899].inputs), rows[899].truth);
        assert!(
            (end.speed.value - truth.speed).abs() < 0.1,
            "{kind:?}: speed {} instead of {}",
            end.speed.value,
            truth.speed
        );
    }
}
