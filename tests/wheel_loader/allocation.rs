//! No step of the loader's estimator allocates.

use crate::counting::allocations;
use wheelstate::Estimator;
use wheelstate::estimator::wheel_loader::*;

#[test]
fn steps_allocate_nothing() {
    for kind in [Kind::SquareRootUnscented, Kind::Extended] {
        for form in [Form::Array, Form::Andrews] {
            for radii in [Radii::Estimated, Radii::Fixed] {
                let mut p = Parameters::default();
                (p.filter.kind, p.filter.form, p.filter.radii) = (kind, form, radii);
                let mut estimator = WheelLoader::new(&p).unwrap();
                let mut out = Outputs::default();
                let before = allocations();
                for k in 0..500 {
                    let v = 2.0 + 0.3 * (0.02 * f64::from(k)).sin();
                    let missing = k % 7 == 0;
                    let inputs = Inputs {
                        torque_front: 1000.0,
                        torque_rear: if k % 50 == 0 { f64::NAN } else { 1000.0 },
                        speed: if missing { f64::NAN } else { v },
                        wheel_speed_front: 1.004 * v / 0.55,
                        wheel_speed_rear: if k == 300 { 50.0 } else { 1.004 * v / 0.55 },
                        ..Inputs::default()
                    };
                    estimator.step(&inputs, if k == 200 { f64::NAN } else { 0.01 });
                    estimator.outputs(&inputs, 0.005, &mut out);
                }
                assert_eq!(allocations() - before, 0);
            }
        }
    }
}
