//! After construction the nursing robot's estimator never allocates.

use crate::counting::allocations;
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Outputs, Parameters, SwayModel};

#[test]
fn steps_outputs_and_states_do_not_allocate() {
    for model in [SwayModel::PaperRaw, SwayModel::Paper, SwayModel::Sound, SwayModel::SoundTorque] {
        let mut parameters = Parameters::default();
        parameters.sway.model = model;
        (parameters.sway.use_tilt, parameters.sway.use_tilt_rate) = (true, true);
        let mut estimator = NursingRobot::new(&parameters).unwrap();
        let mut saved = estimator.state().clone();
        let mut outputs = Outputs::default();
        let before = allocations();
        for k in 0..1000 {
            let t = 0.01 * f64::from(k);
            let mut inputs = Inputs {
                torque_left: 8.0 * t.cos(),
                torque_right: 8.0 * t.cos(),
                speed: (0.7 * t.sin() + 0.7).min(if k > 800 { 0.0 } else { 2.0 }),
                ..Inputs::default()
            };
            match k % 50 {
                7 => inputs.speed = f64::NAN,
                8 => inputs.torque_left = f64::INFINITY,
                9 => inputs.speed = 1e9,
                10 => inputs.tilt = f64::NAN,
                11 => inputs.tilt_rate = 3.0,
                _ => {}
            }
            estimator.step(&inputs, if k % 100 == 99 { 0.5 } else { 0.01 });
            estimator.step(&inputs, f64::NAN);
            estimator.outputs(&inputs, 0.013, &mut outputs);
            if k == 500 {
                saved.clone_from(estimator.state());
            }
        }
        estimator.restore(&saved).unwrap();
        let after = allocations();
        assert_eq!(after - before, 0, "{model:?}");
    }
}
