//! Wheelchair with its user: masses, resistances and the accelerometer's biases.
//!
//! Force and moment balance in weak form, in one convex program with physical consistency:
//! `M, D, Fc, IP, B, tauc, ML >= 0`, `ML <= L M` for a lever of at most [`LONGEST_LEVER`], and
//! `Ic = IP - ML^2 / M >= 0` as the second-order cone `(IP + M, 2 ML, IP - M)`. Outliers are removed
//! sample by sample before the windows, see [`outliers`](crate::problem::outliers).
//!
//! Wheel radius, encoder geometry, accelerometer position and the wheels' spin inertia are known
//! parameters. What is weak by nature: drag, yaw drag and yaw friction are small shares of the force; a
//! log in which the chair only rolls one way cannot tell rolling resistance from a biased accelerometer.

pub mod rows;
pub mod signals;
mod validate;

use crate::assess::Limits;
use crate::log::Log;
use crate::problem::{FitError, Judgement, Problem, Session, Target, Task};
use crate::solve::{Affine, Constraint, Regression, Unknown};
use rows::{B, C1, C2, D, FC, IP, M, ML, TAUC, Windows};
use wheelstate::Variables;
use wheelstate::estimator::wheelchair::Parameters;

/// The problem.
pub const PROBLEM: Problem = Problem { targets, outliers: &SPIKED, estimate, validate: validate::validate };

/// A window of a second is nothing but outliers of its channels where one sample in a hundred is one.
const SPIKED: [&str; 6] = ["accel_x", "accel_y", "encoder_left", "encoder_right", "drive_force", "drive_moment"];

/// Longest plausible lever from the driven axle to the centre of mass, m.
pub const LONGEST_LEVER: f64 = 1.0;

const NAMES: [&str; 9] = [
    "chair.mass",
    "chair.yaw_inertia",
    "chair.com_ahead",
    "chair.drag",
    "chair.yaw_drag",
    "chair.yaw_friction",
    "rolling.coefficient",
    ACCEL_X_BIAS,
    ACCEL_Y_BIAS,
];
const ACCEL_X_BIAS: &str = "initial.accel_x_bias";
const ACCEL_Y_BIAS: &str = "initial.accel_y_bias";

/// Condition number of the scaled regressors beyond which nothing is believed.
const CONDITION: f64 = 1e6;

fn targets(_: &[Log]) -> Vec<Target> {
    let declared = Parameters::declare();
    let target = |name: &&str| Target::declared(&declared, name, true);
    NAMES
        .iter()
        .map(|name| if *name == "chair.com_ahead" { target(name).within(0.0, LONGEST_LEVER) } else { target(name) })
        .collect()
}

fn windows(task: &Task) -> Result<Vec<Windows>, FitError> {
    let chair = signals::chair(task.known);
    task.logs.iter().map(|log| Ok(Windows::new(signals::signals(log, &chair)?))).collect()
}

fn regression(groups: Vec<crate::solve::Rows>) -> Regression {
    let positive = |name: &str| Unknown::within(name, 0.0, f64::INFINITY);
    Regression {
        name: "force and moment".to_owned(),
        unknowns: vec![
            positive("M"),
            positive("D"),
            positive("Fc"),
            positive("ML"),
            positive("IP"),
            positive("B"),
            positive("tauc"),
            Unknown::free("c1"),
            Unknown::free("c2"),
        ],
        groups,
        constraints: vec![
            Constraint::NonNegative(Affine::new(&[(M, LONGEST_LEVER), (ML, -1.0)], 0.0)),
            Constraint::SecondOrder(vec![
                Affine::new(&[(IP, 1.0), (M, 1.0)], 0.0),
                Affine::new(&[(ML, 2.0)], 0.0),
                Affine::new(&[(IP, 1.0), (M, -1.0)], 0.0),
            ]),
        ],
    }
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let chair = signals::chair(task.known);
    let logs = windows(task)?;
    let Some(fit) = session.solve(&regression(rows::groups(&logs, &chair)), &NAMES)? else { return Ok(()) };
    let limits = Limits { condition_number: CONDITION, ..Limits::default() };
    let usual = Judgement { limits, ..Judgement::default() };
    let gravity = chair.gravity;
    session.estimate_judged("chair.mass", fit, usual, |x| x[M]);
    session.estimate_judged("chair.yaw_inertia", fit, usual, |x| x[IP] - x[ML] * x[ML] / x[M]);
    session.estimate_judged("chair.com_ahead", fit, usual, |x| x[ML] / x[M]);
    session.estimate_judged("chair.drag", fit, usual, |x| x[D]);
    session.estimate_judged("chair.yaw_drag", fit, usual, |x| x[B]);
    session.estimate_judged("chair.yaw_friction", fit, usual, |x| x[TAUC]);
    // The cosine of a slope that a chair can climb is 1 to within 1 %.
    session.estimate_judged("rolling.coefficient", fit, usual, move |x| x[FC] / (x[M] * gravity));
    // A bias may well be zero: it is judged by its absolute error.
    let bias = Judgement { limits: Limits { absolute_error: Some(0.05), ..limits }, ..Judgement::default() };
    session.estimate_judged(ACCEL_X_BIAS, fit, bias, |x| -x[C1] / x[M]);
    session.estimate_judged(ACCEL_Y_BIAS, fit, bias, |x| -x[C2] / x[ML]);
    Ok(())
}
