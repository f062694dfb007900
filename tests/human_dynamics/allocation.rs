//! After construction the whole-body solver allocates nothing, whichever of its methods a sample needs.

use super::cases::case;
use crate::counting::allocations;
use wheelstate::estimator::human_dynamics::whole_body::Posture;

#[test]
fn no_method_of_the_whole_body_solver_allocates() {
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
}
