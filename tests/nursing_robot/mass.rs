//! The mass filter by itself, on loads that do not sway.

use std::f64::consts::TAU;
use wheelstate::estimator::nursing_robot::Parameters;
use wheelstate::estimator::nursing_robot::mass::{MassEstimator, MassSample, MassState};

const DT: f64 = 0.01;

/// A robot on a level floor whose rolling resistance is known, driven to and fro about 1 m/s for 20 s with `load` more
/// kilograms on board than `robot.mass` says.
fn weighed(p: &Parameters, load: f64) -> MassState {
    let (robot, estimator) = (&p.robot, MassEstimator::new(p));
    let mut state = estimator.start();
    for row in 0..2000 {
        let phase = TAU * f64::from(row) * DT / 4.0;
        let (speed, acceleration) = (1.0 + 0.4 * phase.sin(), 0.4 * TAU / 4.0 * phase.cos());
        let total = robot.mass + load;
        let force = (total + robot.rotating_mass()) * acceleration + p.rolling.resistance(total, speed);
        let sample = MassSample { force, speed, specific_force: f64::NAN };
        estimator.step(&mut state, &sample, DT);
    }
    state
}

fn without_sway() -> Parameters {
    let mut p = Parameters::default();
    p.human.swaying_fraction = 0.0;
    p
}

#[test]
fn exact_forces_weigh_a_load_to_half_a_kilogram() {
    let p = without_sway();
    for load in [20.0, 70.0, 140.0] {
        let state = weighed(&p, load);
        assert!(state.rls.valid && !state.implausible());
        assert!((state.rls.estimate - load).abs() < 0.5, "{load}: {}", state.rls.estimate);
    }
}

/// An empty robot may be some kilograms lighter than it was said to be, or a battery heavier than the load that is
/// allowed; what is far beyond a bound is an error of the inputs or parameters, in the same proportion for a robot and
/// a car.
#[test]
fn a_mass_beyond_its_bound_is_implausible_from_a_twentieth_of_the_machine() {
    for mass in [80.0, 160.0, 1300.0] {
        let mut p = without_sway();
        p.robot.mass = mass;
        (p.limit.load_mass, p.limit.slip_residual) = (0.5 * mass, 1e6);
        for (share, implausible) in [(0.0, false), (0.04, false), (0.06, true), (0.2, true)] {
            let below = weighed(&p, -share * mass);
            let above = weighed(&p, p.limit.load_mass + share * mass);
            for (state, bound) in [(below, 0.0), (above, p.limit.load_mass)] {
                assert!((state.rls.estimate - bound).abs() < 3e-3 * mass, "{mass} {share}: {}", state.rls.estimate);
                assert_eq!(state.implausible(), implausible, "{mass} kg, {share} of it beyond {bound}");
            }
        }
    }
}
