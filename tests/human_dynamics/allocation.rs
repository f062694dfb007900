//! After construction neither the whole-body solver nor the seated estimator allocates.

use super::cases::case;
use crate::counting::allocations;
use wheelstate::Estimator;
use wheelstate::estimator::human_dynamics::whole_body::Posture;
use wheelstate::estimator::human_dynamics::{HumanDynamics, Outputs, Parameters};

#[test]
fn steps_do_not_allocate() {
    // stiff and missing cases go through the orthogonal method too
    for name in ["human48_LeftFoot_fixed_L3", "seated12_moving_missing", "seated12_moving_stiff", "chain3_fixed_L1"] {
        let mut case = case(name);
        let all = case.samples.clone();
        let before = allocations();
        for k in 0..50 {
            case.q[0] += 0.01;
            case.samples[k % all.len()] = if k % 3 == 0 { f64::NAN } else { f64::INFINITY };
            let posture = Posture { q: &case.q, qd: &case.qd, base_rate: case.base_rate };
            let _ = case.body.step(&posture, &case.samples, k % 2 == 0);
            let _ = case.body.innovations(|_| true);
            case.samples[k % all.len()] = all[k % all.len()];
        }
        assert_eq!(allocations(), before, "{name}");
    }
    for differentiate in [false, true] {
        let mut parameters = Parameters { differentiate, ..Parameters::default() };
        parameters.r#use.imu = true;
        let mut estimator = HumanDynamics::new(&parameters).unwrap();
        let mut saved = estimator.state().clone();
        let mut outputs = Outputs::default();
        let before = allocations();
        for k in 0..60 {
            let mut inputs = super::cases::sitting();
            inputs.q[1] = 0.1 * (0.1 * f64::from(k)).sin();
            match k % 10 {
                3 => inputs.q[2] = f64::NAN,
                5 => inputs.imu[0][1] = f64::INFINITY,
                7 => inputs.base_accel[0] = f64::NAN,
                _ => {}
            }
            estimator.step(&inputs, if k == 40 { 0.2 } else { 0.01 });
            estimator.step(&inputs, f64::NAN);
            estimator.outputs(&inputs, 0.003, &mut outputs);
            if k == 30 {
                saved.clone_from(estimator.state());
            }
        }
        estimator.restore(&saved).unwrap();
        assert_eq!(allocations(), before, "differentiate {differentiate}");
    }
}
