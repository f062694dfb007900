//! After construction the wheelchair's estimator never allocates.

use crate::counting::allocations;
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::{Inputs, Kind, Outputs, Parameters, Wheelchair};

#[test]
fn steps_outputs_and_states_do_not_allocate() {
    for kind in [Kind::Basic, Kind::Bias, Kind::AccelerationInput, Kind::GravityVector] {
        let mut parameters = Parameters::default();
        parameters.filter.kind = kind;
        parameters.filter.gate = 6.0;
        let mut estimator = Wheelchair::new(&parameters).unwrap();
        let mut saved = estimator.state().clone();
        let mut outputs = Outputs::default();
        let before = allocations();
        for k in 0..1000 {
            let t = 0.01 * f64::from(k);
            let mut inputs = Inputs {
                encoder_left: 0.4 * t * t,
                encoder_right: 0.4 * t * t,
                drive_force: if k > 100 { 40.0 } else { 0.0 },
                ..Inputs::default()
            };
            if k < 100 {
                (inputs.encoder_left, inputs.encoder_right) = (0.0, 0.0); // stands still
            }
            match k % 50 {
                7 => inputs.encoder_left = f64::NAN,
                8 => inputs.accel_y = f64::INFINITY,
                9 => inputs.encoder_right = 1e9,
                10 => inputs.drive_force = f64::NAN,
                11 => inputs.accel_z = 39.3,
                _ => {}
            }
            estimator.step(&inputs, if k % 100 == 99 { 0.5 } else { 0.01 });
            estimator.step(&inputs, f64::NAN);
            estimator.outputs(&inputs, 0.013, &mut outputs);
            if k == 500 {
                saved.clone_from(estimator.state());
            }
            if k == 600 {
                assert!(estimator.restore(&saved).is_ok());
            }
        }
        assert_eq!(allocations() - before, 0, "{kind:?}");
        assert!(outputs.speed.value.is_finite());
    }
}
