//! Errors are as large as the estimator says, and what nobody observes is not claimed to be known.

use super::model::plant;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters, SwayModel};
use wheelstate::plant::nursing_robot::{Command, NursingRobotPlant, STEP};
use wheelstate::variable::Estimate;

/// With tilt and tilt rate, so that the whole sway is observed.
fn with_tilt() -> Parameters {
    let mut p = Parameters::default();
    p.sway.use_tilt = true;
    p.sway.use_tilt_rate = true;
    p
}

/// A drive to and fro about 0.8 m/s of 20 s, sampled with the noise that the parameters declare; what the estimator
/// says every second after 10 s, beside the truth.
fn driven(p: &Parameters, seed: u64) -> Vec<(Outputs, NursingRobotPlant)> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        std * draw
    };
    let (std, mut plant, mut estimator) = (&p.sway.measurement_std, plant(), NursingRobot::new(p).unwrap());
    let (mut seen, mut outputs) = (Vec::new(), Outputs::default());
    for k in 0..2000 {
        let t = 0.01 * f64::from(k);
        let inputs = Inputs {
            torque_left: plant.torque[0],
            torque_right: plant.torque[1],
            speed: plant.motion.drive[0] + noise(std.speed),
            yaw_rate: plant.motion.drive[1],
            tilt: plant.motion.sway[1] + noise(std.tilt),
            tilt_rate: plant.motion.sway_rate[1] + noise(std.tilt_rate),
            ..Inputs::default()
        };
        estimator.step(&inputs, 0.01);
        if k >= 1000 && k % 100 == 0 {
            estimator.outputs(&inputs, 0.0, &mut outputs);
            seen.push((outputs.clone(), plant.clone()));
        }
        let command = Command::Speed { speed: 0.8 + 0.4 * (1.3 * t).sin(), yaw_rate: 0.0, force: 0.0 };
        (0..(0.01 / STEP).round() as usize).for_each(|_| plant.advance(&command, [0.0; 2]));
    }
    seen
}

/// Mean square of error over standard deviation, and the share of errors within two of them.
fn score(samples: &[(Estimate, f64)]) -> (f64, f64) {
    let scaled: Vec<f64> = samples.iter().map(|(estimate, truth)| (estimate.value - truth) / estimate.std).collect();
    let count = scaled.len() as f64;
    (scaled.iter().map(|e| e * e).sum::<f64>() / count, scaled.iter().filter(|e| e.abs() <= 2.0).count() as f64 / count)
}

#[test]
fn errors_of_mass_and_sway_are_as_large_as_their_standard_deviations() {
    let mut p = with_tilt();
    // The plant's sensors are mounted as they should be.
    (p.sway.tilt_bias_std, p.sway.tilt_rate_bias_std, p.sway.tilt_delay_std) = (0.0, 0.0, 0.0);
    (p.sway.speed_scale_std, p.sway.speed_delay_std) = (0.0, 0.0);
    let runs: Vec<_> = (0..12).flat_map(|seed| driven(&p, seed)).collect();
    let of = |pick: &dyn Fn(&Outputs, &NursingRobotPlant) -> (Estimate, f64)| {
        score(&runs.iter().map(|(outputs, plant)| pick(outputs, plant)).collect::<Vec<_>>())
    };
    let mass = of(&|out, plant| (out.load_mass, plant.person.mass));
    let speed = of(&|out, plant| (out.speed_estimate, plant.motion.drive[0]));
    let pitch = of(&|out, plant| (out.body_pitch, plant.motion.sway[1]));
    let rate = of(&|out, plant| (out.body_pitch_rate, plant.motion.sway_rate[1]));
    let force = of(&|out, plant| (out.sway_force, plant.forces([0.0; 2]).sway_force));
    println!("NEES and share: mass {mass:?}, speed {speed:?}, pitch {pitch:?}, rate {rate:?}, force {force:?}");
    for (name, (nees, within)) in [("speed", speed), ("pitch", pitch), ("pitch rate", rate), ("sway force", force)] {
        assert!(nees < 1.6 && (nees > 0.4 || name == "sway force"), "{name}: NEES {nees}");
        assert!(within > 0.88, "{name}: {within} of the errors are within two standard deviations");
    }
    // its errors are systematic, the same in every run: each is to lie within what is said
    assert!(mass.1 > 0.95, "mass: {} of the errors are within two standard deviations", mass.1);
}

/// Without a filter the body moves about its relaxed posture, as little known as before the first sample.
#[test]
fn a_body_that_nothing_observes_is_said_to_be_as_little_known_as_it_is() {
    let mut p = Parameters::default();
    p.human.rest_pitch = 0.1;
    p.mass.use_accelerometer = true; // no model of the sway on roads that slope
    let mut outputs = Outputs::default();
    NursingRobot::new(&p).unwrap().outputs(&Inputs::default(), 0.0, &mut outputs);
    let (pitch, initial) = (outputs.body_pitch, &p.initial);
    assert!((pitch.value - 0.1).abs() < 1e-12 && pitch.std >= initial.pitch_std, "{pitch:?}");
    assert!(outputs.body_pitch_rate.std >= initial.pitch_rate_std, "{:?}", outputs.body_pitch_rate);
    assert!(outputs.sway_force.std > 0.0 && outputs.hip_torque.std > 0.0, "{:?}", outputs.sway_force);

    p.human.swaying_fraction = 0.0;
    NursingRobot::new(&p).unwrap().outputs(&Inputs::default(), 0.0, &mut outputs);
    assert_eq!((outputs.body_pitch.value, outputs.body_pitch.std), (0.1, 0.0), "a load that cannot sway");
}

/// What the hip does beside the model makes the sway force less certain, in proportion to its density.
#[test]
fn the_unmodelled_hip_torque_adds_its_variance_to_that_of_the_sway_force() {
    let variance = |density: f64| {
        let mut p = Parameters::default();
        p.sway.process_psd.hip_torque = density;
        let mut outputs = Outputs::default();
        NursingRobot::new(&p).unwrap().outputs(&Inputs::default(), 0.0, &mut outputs);
        outputs.sway_force.std.powi(2)
    };
    let [none, once, thrice] = [0.0, 0.37, 3.0 * 0.37].map(variance);
    assert!(once > none);
    assert!(((thrice - none) / (once - none) - 3.0).abs() < 1e-9, "{none} {once} {thrice}");
}

/// The printed model has no pitch rate that a tilt rate could be compared with.
#[test]
fn a_tilt_rate_counts_where_the_model_has_a_pitch_rate() {
    for (model, counts) in [(SwayModel::Paper, false), (SwayModel::Sound, true)] {
        let mut p = Parameters::default();
        (p.sway.model, p.sway.use_tilt_rate) = (model, true);
        let pitch = |tilt_rate: f64| {
            let mut estimator = NursingRobot::new(&p).unwrap();
            let (mut inputs, mut outputs) = (Inputs::default(), Outputs::default());
            (inputs.torque_left, inputs.torque_right, inputs.yaw_rate) = (0.5, 0.5, 0.0);
            (inputs.speed, inputs.tilt_rate) = (0.5, tilt_rate);
            (0..20).for_each(|_| {
                estimator.step(&inputs, 0.01);
            });
            estimator.outputs(&inputs, 0.0, &mut outputs);
            (outputs.body_pitch, outputs.diagnostics.nis_channels)
        };
        assert_eq!(pitch(0.3) != pitch(0.0), counts, "{model:?}");
    }
}

/// Under a held force the speed goes on as Newton has it.
#[test]
fn the_speed_at_a_horizon_follows_the_force() {
    let mut p = with_tilt();
    p.rolling.coefficient = 0.0;
    p.human.swaying_fraction = 0.05;
    let mut estimator = NursingRobot::new(&p).unwrap();
    let total = p.robot.mass + p.human.nominal_mass + p.robot.rotating_mass();
    let torque = 2.0;
    let force = p.robot.drive_force(torque, torque);
    let mut inputs = Inputs::default();
    for k in 0..400 {
        let speed = 0.5 + force / total * 0.01 * f64::from(k);
        inputs = Inputs {
            torque_left: torque,
            torque_right: torque,
            speed,
            yaw_rate: 0.0,
            tilt: 0.0,
            tilt_rate: 0.0,
            ..inputs
        };
        estimator.step(&inputs, 0.01);
    }
    let at = |horizon: f64| {
        let mut outputs = Outputs::default();
        estimator.outputs(&inputs, horizon, &mut outputs);
        outputs.speed_estimate.value
    };
    let now = at(0.0);
    for horizon in [0.005, 0.03, 0.1] {
        let gain = force / total * horizon;
        assert!((at(horizon) - now - gain).abs() < 0.1 * gain, "{horizon} s: {} m/s, not {gain}", at(horizon) - now);
    }
}
