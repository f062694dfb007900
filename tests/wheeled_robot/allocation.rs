//! A step of the wheeled robot's estimator allocates nothing.

use crate::counting::allocations;
use wheelstate::Estimator;
use wheelstate::estimator::wheeled_robot::{Inputs, Outputs, Parameters, WheeledRobot};

#[test]
fn steps_and_outputs_allocate_nothing() {
    let mut estimator = WheeledRobot::new(&Parameters::default()).unwrap();
    let mut outputs = Outputs::default();
    let mut inputs = Inputs { wheel_speed_rl: 20.0, wheel_speed_rr: 20.0, ..Inputs::default() };
    let before = allocations();
    for k in 0..500 {
        inputs.steering_angle = 0.1 * (0.05 * f64::from(k)).sin();
        inputs.accel_y = if k % 7 == 0 { f64::NAN } else { 0.5 };
        inputs.gyro_z = if k % 11 == 0 { f64::INFINITY } else { 0.1 };
        let dt = [0.01, 0.3, 0.0, 7.0][usize::from(k % 50 == 0) * (k as usize / 50 % 4)];
        estimator.step(&inputs, dt);
        estimator.outputs(&inputs, 0.004, &mut outputs);
    }
    assert_eq!(allocations() - before, 0);
}
