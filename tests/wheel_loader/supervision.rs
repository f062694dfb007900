//! The loader's estimator where data are bad or say nothing.

use crate::support::{assert_close, vector_table};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheel_loader::*;
use wheelstate::plant::road::Road;
use wheelstate::plant::wheel_loader::{Action, Machine, Plant};
use wheelstate::{Estimator, Status};

/// A drive on a flat road: `torque(t, v)` acts on both axles; sensors are noisy.
fn drive(seconds: f64, speed: f64, seed: u64, torque: impl Fn(f64, f64) -> f64) -> Vec<Inputs> {
    let rolling = 0.55 / (1.0 + 0.03 / 19.0);
    let machine = Machine { wheel_radius: [rolling; 2], ..Machine::default() };
    let mut plant = Plant::new(machine, Road::flat(), speed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut noisy = |value: f64, std: f64| {
        let draw: f64 = StandardNormal.sample(&mut random);
        value + std * draw
    };
    (0..(100.0 * seconds) as usize)
        .map(|k| {
            let t = 0.01 * k as f64;
            let now = torque(t, plant.speed());
            let [front, rear] = plant.wheel_speeds();
            let inputs = Inputs {
                torque_front: noisy(now, 10.0),
                torque_rear: noisy(now, 10.0),
                slope: noisy(0.0, 0.003),
                speed: noisy(plant.speed(), 0.02),
                wheel_speed_front: noisy(front, 0.02),
                wheel_speed_rear: noisy(rear, 0.02),
                ..Inputs::default()
            };
            for i in 0..10 {
                let torque = torque(t + 1e-3 * f64::from(i), plant.speed());
                plant.advance(&Action { torque: [torque; 2], ..Action::default() }, 1e-3);
            }
            inputs
        })
        .collect()
}

/// Torque that holds a speed of about 2.5 m/s but changes all the time.
fn lively(t: f64, v: f64) -> f64 {
    380.0 + 900.0 * (0.9 * t).sin() + 800.0 * (2.5 - v)
}

fn begun(parameters: &Parameters) -> WheelLoader {
    WheelLoader::new(parameters).unwrap()
}

fn out(estimator: &WheelLoader, inputs: &Inputs) -> Outputs {
    let mut out = Outputs::default();
    estimator.outputs(inputs, 0.0, &mut out);
    out
}

/// Runs all samples and checks that no output is ever NaN or infinite.
fn run(estimator: &mut WheelLoader, inputs: &[Inputs]) -> Vec<Outputs> {
    inputs
        .iter()
        .map(|inputs| {
            estimator.step(inputs, 0.01);
            let out = out(estimator, inputs);
            finite(&out);
            out
        })
        .collect()
}

fn finite(out: &Outputs) {
    use wheelstate::Variables;
    let values = out.to_vec();
    assert!(values.iter().all(|value| value.is_finite()), "{out:?}");
}

fn unknowns(out: &Outputs) -> [f64; 6] {
    [out.slip_stiffness, out.cg_height, out.cg_ratio, out.slip_stiffness_std, out.cg_height_std, out.cg_ratio_std]
}

#[test]
fn standstill_changes_nothing() {
    let mut estimator = begun(&Parameters::default());
    let before = unknowns(&out(&estimator, &Inputs::default()));
    for out in run(&mut estimator, &drive(60.0, 0.0, 1, |_, _| 0.0)) {
        assert!(out.hold && out.status.contains(Status::HOLD));
        for (now, before) in unknowns(&out).iter().zip(before) {
            assert_close("held", *now, before, 1e-10, 0.0);
        }
        assert!((out.load_ratio - 0.45).abs() < 0.02, "the load ratio of a standing machine is its static one");
    }
}

#[test]
fn coasting_moves_the_unknowns_only_within_their_std() {
    let mut estimator = begun(&Parameters::default());
    let before = unknowns(&out(&estimator, &Inputs::default()));
    let outs = run(&mut estimator, &drive(10.0, 5.0, 2, |_, _| 0.0));
    let after = unknowns(&outs[outs.len() - 1]);
    for i in 0..3 {
        assert!((after[i] - before[i]).abs() < after[3 + i], "{before:?} {after:?}");
    }
    // Coasting is what the radii are known from.
    let last = &outs[outs.len() - 1];
    assert!(
        last.wheel_radius_front_std < 0.9 * 0.55 * Start::default().wheel_radius_std,
        "{}",
        last.wheel_radius_front_std
    );
}

#[test]
fn torque_without_slip_is_called_inconsistent_and_forgotten() {
    for (seed, noise) in [(3, 0.0), (4, 0.02)] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noisy = |value: f64| {
            let draw: f64 = StandardNormal.sample(&mut random);
            value + noise * draw
        };
        let mut contradiction = |k: usize| {
            let v = 2.0 + 0.001 * k as f64;
            Inputs {
                torque_front: 1000.0,
                torque_rear: 1000.0,
                speed: noisy(v),
                wheel_speed_front: noisy(v / 0.55),
                wheel_speed_rear: noisy(v / 0.55),
                ..Inputs::default()
            }
        };
        let mut estimator = begun(&Parameters::default());
        let start = unknowns(&out(&estimator, &Inputs::default()));
        let samples: Vec<Inputs> = (0..1200).map(&mut contradiction).collect();
        let outs = run(&mut estimator, &samples);
        let raised = outs.iter().position(|out| out.slip_inconsistent).expect("never noticed");
        println!("noise {noise}: noticed after {:.2} s", 0.01 * raised as f64);
        assert!((500..=900).contains(&raised), "{raised}");
        for out in &outs[raised..] {
            assert!(out.hold && out.slip_inconsistent && !out.healthy);
            assert!(out.status.contains(Status::SLIP | Status::HOLD));
            for (now, start) in unknowns(out).iter().zip(start) {
                assert_close("what contradictory data taught", *now, start, 1e-9, 0.0);
            }
        }
        // Sound data clear the flag.
        let outs = run(&mut estimator, &drive(40.0, 2.5, 5, lively));
        let last = &outs[outs.len() - 1];
        assert!(!last.slip_inconsistent && !last.hold && (last.cg_ratio - 0.45).abs() < 2.0 * last.cg_ratio_std);
    }
}

#[test]
fn slip_against_the_torque_is_inconsistent_too() {
    let mut samples = drive(15.0, 2.5, 6, lively);
    for inputs in &mut samples {
        inputs.torque_front = -inputs.torque_front;
        inputs.torque_rear = -inputs.torque_rear;
    }
    let mut estimator = begun(&Parameters::default());
    assert!(run(&mut estimator, &samples).iter().any(|out| out.slip_inconsistent));
}

#[test]
fn a_spinning_wheel_holds_while_it_spins() {
    let mut samples = drive(12.0, 2.5, 7, lively);
    for inputs in &mut samples[400..500] {
        inputs.wheel_speed_front *= 1.4;
    }
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    let before = unknowns(&outs[399]);
    for out in &outs[400..500] {
        assert!(out.hold && out.status.contains(Status::SLIP));
        for (now, before) in unknowns(out).iter().zip(before) {
            assert_close("held", *now, before, 1e-10, 0.0);
        }
    }
    assert!(outs[700..].iter().all(|out| !out.hold));
    assert!((outs[1199].cg_ratio - 0.45).abs() < 0.05);
}

#[test]
fn dropped_samples_are_bridged_and_long_gaps_hold() {
    let clean = drive(20.0, 2.5, 8, lively);
    let mut samples = clean.clone();
    for (k, inputs) in samples.iter_mut().enumerate() {
        match k {
            300..330 => inputs.wheel_speed_front = f64::NAN,
            500..530 | 1000..1100 => {
                (inputs.speed, inputs.wheel_speed_front, inputs.wheel_speed_rear) = (f64::NAN, f64::INFINITY, f64::NAN);
            }
            _ => {}
        }
    }
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    assert!(outs[310].status.contains(Status::MISSING) && !outs[310].hold);
    assert!(outs[510].status.contains(Status::NO_MEASUREMENT | Status::INFINITE) && !outs[510].hold);
    assert!(!outs[1045].hold && outs[1060].hold && !outs[1060].healthy, "50 samples are bridged, not more");
    assert_close("prediction", outs[529].speed_estimate, clean[529].speed, 0.0, 0.3);
    assert!(!outs[1400].hold, "estimation goes on");
    assert!((outs[1999].cg_ratio - 0.45).abs() < 3.0 * outs[1999].cg_ratio_std);
}

#[test]
fn a_bad_drive_input_is_replaced_for_fifty_samples_then_held() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        let mut samples = drive(15.0, 2.5, 9, lively);
        for inputs in &mut samples[600..700] {
            inputs.torque_front = bad;
        }
        samples[900].slope = bad;
        samples[901].spading_force_z = bad;
        let mut estimator = begun(&Parameters::default());
        let outs = run(&mut estimator, &samples);
        assert!(outs[620].status.contains(Status::HELD_INPUT) && !outs[620].hold);
        assert!(outs[660].hold && !outs[660].healthy);
        assert_eq!(outs[660].status.contains(Status::INFINITE), bad.is_infinite());
        assert_eq!(outs[660].status.contains(Status::IMPLAUSIBLE), bad == 1e300);
        assert!(!outs[800].hold && outs[900].status.contains(Status::HELD_INPUT) && !outs[902].hold);
        assert!((outs[1499].cg_ratio - 0.45).abs() < 3.0 * outs[1499].cg_ratio_std);
    }
}

#[test]
fn a_jump_of_all_sensors_is_rejected_then_followed_and_teaches_nothing() {
    let mut samples = drive(12.0, 2.5, 10, lively);
    for inputs in &mut samples[600..] {
        inputs.speed += 1.0;
        inputs.wheel_speed_front += 1.0 / 0.55;
        inputs.wheel_speed_rear += 1.0 / 0.55;
    }
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    let rejected = outs[600..].iter().take_while(|out| out.status.contains(Status::GATED)).count();
    assert!(rejected <= 20, "{rejected}");
    assert!(outs[600].status.contains(Status::GATED) && outs[600 + rejected].status.contains(Status::RESTARTED));
    assert_close("speed", outs[680].speed_estimate, samples[680].speed, 0.0, 0.1);
    let (before, after) = (&outs[599], &outs[1199]);
    assert!((after.cg_ratio - before.cg_ratio).abs() < 2.0 * before.cg_ratio_std, "{before:?} {after:?}");
}

#[test]
fn one_outlier_is_rejected() {
    let mut samples = drive(8.0, 2.5, 11, lively);
    samples[500].wheel_speed_rear += 0.5;
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &samples);
    assert!(outs[500].status.contains(Status::GATED) && !outs[501].status.contains(Status::GATED));
}

#[test]
fn parameters_are_refused_before_the_first_sample() {
    use wheelstate::Variables;
    for (name, value) in [
        ("loader.mass", 0.0),
        ("loader.mass", -1.0),
        ("loader.wheelbase", 0.0),
        ("loader.wheel_radius_front", 0.0),
        ("loader.axle_inertia_rear", -3.0),
        ("rolling.coefficient", -0.01),
        ("filter.measurement_std.speed", 0.0),
        ("filter.substeps", 0.0),
        ("start.cg_ratio", 0.95),
        ("start.cg_height", 0.2),
        ("start.slip_stiffness", 100.0),
        ("sample_period", 0.0),
        ("sample_period", f64::NAN),
    ] {
        let mut p = Parameters::default();
        let error = p.set(name, value).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
    let mut p = Parameters::default();
    p.loader.mass = f64::NAN;
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("loader.mass"));
    let mut p = Parameters::default();
    (p.filter.alpha, p.filter.beta) = (2.0, 3.9);
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("filter.beta"));
    let mut p = Parameters::default();
    p.hold.resume_speed = 0.1;
    assert!(WheelLoader::new(&p).unwrap_err().to_string().contains("hold.resume_speed"));
}

#[test]
fn bad_steps_change_nothing_and_long_ones_are_subdivided() {
    let samples = drive(6.0, 2.5, 12, lively);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples);
    let before = estimator.state().clone();
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let status = estimator.step(&samples[599], dt);
        assert!(status.contains(Status::BAD_STEP | Status::SKIPPED), "{dt}");
        assert_eq!(estimator.state().belief(), before.belief(), "{dt}");
    }
    // A gap of seconds: the motion begins anew, the unknowns stay.
    let mut gap = estimator.clone();
    let status = gap.step(&samples[599], 5.0);
    assert!(status.contains(Status::BAD_STEP | Status::RESTARTED));
    let (a, b) = (out(&gap, &samples[599]), out(&estimator, &samples[599]));
    assert_eq!((a.cg_ratio, a.cg_ratio_std), (b.cg_ratio, b.cg_ratio_std));
    // A log at 12.5 Hz: 80 ms steps.
    let mut slow = begun(&Parameters { sample_period: 0.08, ..Parameters::default() });
    let samples = drive(60.0, 2.5, 13, lively);
    for inputs in samples.iter().step_by(8) {
        assert!(!slow.step(inputs, 0.08).contains(Status::BAD_STEP));
        finite(&out(&slow, inputs));
    }
    let last = out(&slow, &samples[0]);
    assert!((last.cg_ratio - 0.45).abs() < 3.0 * last.cg_ratio_std, "{last:?}");
}

#[test]
fn long_cruising_does_not_collapse_the_covariance() {
    let mut estimator = begun(&Parameters::default());
    let outs = run(&mut estimator, &drive(200.0, 2.0, 14, |_, v| 380.0 + 500.0 * (2.0 - v)));
    let last = &outs[outs.len() - 1];
    println!("{:?}", unknowns(last));
    assert!(last.cg_height_std > 0.12, "cruising says nothing about the height");
    assert!(!last.cg_height_observable && last.status.contains(Status::UNOBSERVABLE));
    assert!(last.cg_ratio_std > 0.01 && (last.cg_ratio - 0.45).abs() < 2.0 * last.cg_ratio_std);
}

#[test]
fn lively_driving_reveals_the_height() {
    let p =
        Parameters { start: Start { cg_height: 1.1, cg_height_std: 0.2, ..Start::default() }, ..Parameters::default() };
    let mut estimator = begun(&p);
    let outs = run(&mut estimator, &drive(240.0, 2.5, 15, |t, v| lively(t, v) + 1500.0 * (1.3 * t).sin()));
    let last = &outs[outs.len() - 1];
    println!("{:?}", unknowns(last));
    assert!(last.cg_height_observable && !last.status.contains(Status::UNOBSERVABLE));
    assert!((last.cg_height - 0.95).abs() < 2.5 * last.cg_height_std, "{last:?}");
    assert!(last.healthy);
}

#[test]
fn array_and_andrews_agree_at_every_step() {
    for file in ["plantlog_bumpy_C", "plantlog_accbrake_A"] {
        let table = vector_table(&format!("wheel_loader/{file}.csv"));
        let mut p = Parameters::default();
        let mut array = begun(&p);
        p.filter.form = Form::Andrews;
        let mut andrews = begun(&p);
        for row in &table.rows {
            let inputs = Inputs {
                torque_front: row[1],
                torque_rear: row[2],
                slope: row[5],
                spading_force_x: row[6],
                spading_force_z: row[7],
                speed: row[8],
                wheel_speed_front: row[9],
                wheel_speed_rear: row[10],
                ..Inputs::default()
            };
            array.step(&inputs, 0.01);
            andrews.step(&inputs, 0.01);
            let (a, b) = (array.state().belief(), andrews.state().belief());
            assert!((a.mean - b.mean).amax() < 1e-9 && (a.factor - b.factor).amax() < 1e-9);
        }
    }
}

#[test]
fn a_stored_state_continues_with_the_same_bytes() {
    let samples = drive(8.0, 2.5, 16, lively);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples[..400]);
    let mut other = begun(&Parameters::default());
    other.restore(estimator.state()).unwrap();
    for inputs in &samples[400..] {
        assert_eq!(estimator.step(inputs, 0.01), other.step(inputs, 0.01));
    }
    assert_eq!(serde_json::to_string(estimator.state()).unwrap(), serde_json::to_string(other.state()).unwrap());
    let mut fixed = Parameters::default();
    fixed.filter.radii = Radii::Fixed;
    assert!(begun(&fixed).restore(estimator.state()).is_err());
}

#[test]
fn outputs_ahead_follow_the_model() {
    let samples = drive(6.0, 2.5, 17, |_, _| 1200.0);
    let mut estimator = begun(&Parameters::default());
    run(&mut estimator, &samples);
    let state = estimator.state().clone();
    let (mut now, mut later) = (Outputs::default(), Outputs::default());
    estimator.outputs(&samples[599], 0.0, &mut now);
    estimator.outputs(&samples[599], 0.1, &mut later);
    let acceleration = (2400.0 / 0.55 - 0.03 * 4700.0 * 9.80665) / (4700.0 + 72.0 / 0.55f64.powi(2));
    assert_close("speed ahead", later.speed_estimate - now.speed_estimate, 0.1 * acceleration, 0.1, 0.0);
    assert_eq!(now.cg_ratio, later.cg_ratio);
    assert_eq!(estimator.state(), &state);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever comes in, what goes out is finite and within the physical limits.
    #[test]
    fn nothing_makes_an_estimate_infinite(
        seed in any::<u64>(), kind in prop::bool::ANY, radii in prop::bool::ANY, wild in 0.0..1.0f64
    ) {
        use rand::RngExt;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut p = Parameters::default();
        p.filter.kind = if kind { Kind::Extended } else { Kind::SquareRootUnscented };
        p.filter.radii = if radii { Radii::Estimated } else { Radii::Fixed };
        let mut estimator = begun(&p);
        let base = Inputs { torque_front: 1000.0, torque_rear: 900.0, speed: 2.0, wheel_speed_front: 3.65, wheel_speed_rear: 3.66, ..Inputs::default() };
        use wheelstate::Variables;
        for _ in 0..300 {
            let mut flat = base.to_vec();
            for value in &mut flat {
                if random.random::<f64>() < wild * 0.3 {
                    *value = match random.random_range(0..6) {
                        0 => f64::NAN,
                        1 => f64::INFINITY,
                        2 => -1e30,
                        3 => 1e7 * (random.random::<f64>() - 0.5),
                        4 => 0.0,
                        _ => 20.0 * (random.random::<f64>() - 0.5),
                    };
                }
            }
            let mut inputs = Inputs::default();
            inputs.read(&flat);
            let dt = match random.random_range(0..20) { 0 => f64::NAN, 1 => 0.3, 2 => 2.0, 3 => 0.0, _ => 0.01 };
            estimator.step(&inputs, dt);
            let mut out = Outputs::default();
            estimator.outputs(&inputs, 0.02 * random.random::<f64>(), &mut out);
            finite(&out);
            prop_assert!((0.1..=0.9).contains(&out.cg_ratio) && (0.3..=2.5).contains(&out.cg_height));
            prop_assert!(out.cg_ratio_std >= 0.0 && (0.0..=1.0).contains(&out.load_ratio));
        }
    }
}
