//! Prediction of the held-out part: drive force and drive moment, as means over windows.

use super::rows::{B, C1, C2, D, FC, IP, M, ML, OVERLAP, Row, TAUC, UNKNOWNS};
use super::{ACCEL_X_BIAS, ACCEL_Y_BIAS, signals, windows};
use crate::problem::{Known, Prediction, Task};
use crate::result::Trace;

pub(super) fn validate(task: &Task) -> Vec<Prediction> {
    let Ok(logs) = windows(task) else { return Vec::new() };
    let (chair, theta) = (signals::chair(task.known), theta(task.known));
    let mut all = Vec::new();
    for (log, source) in logs.iter().zip(task.logs) {
        let one = log.psi.integral(0, 0, |_| 1.0);
        let mut predict = |name: &str, unit: &str, row: &dyn Fn(usize) -> Row| {
            let mut trace =
                Trace { name: name.into(), unit: unit.into(), log: source.source.clone(), ..Trace::default() };
            for start in log.starts() {
                let (row, rhs) = row(start);
                let balance = crate::solve::dot(&row, &theta);
                if (balance + rhs).is_finite() {
                    trace.time.push(log.middle(start));
                    trace.measured.push(rhs / one);
                    trace.predicted.push(balance / one);
                }
            }
            if trace.time.len() > 10 {
                all.push(Prediction::new(trace, OVERLAP));
            }
        };
        predict("drive force", "N", &|start| log.force(&chair, start));
        predict("drive moment", "N.m", &|start| log.moment(&chair, start));
    }
    all
}

/// The unknowns of the rows from the parameters.
fn theta(known: &Known) -> [f64; UNKNOWNS] {
    let get = |name: &str| known.get(name);
    let mut theta = [0.0; UNKNOWNS];
    let (mass, lever) = (get("chair.mass"), get("chair.com_ahead"));
    theta[M] = mass;
    theta[D] = get("chair.drag");
    theta[FC] = get("rolling.coefficient") * mass * get("gravity");
    theta[ML] = mass * lever;
    theta[IP] = get("chair.yaw_inertia") + mass * lever * lever;
    theta[B] = get("chair.yaw_drag");
    theta[TAUC] = get("chair.yaw_friction");
    theta[C1] = -mass * get(ACCEL_X_BIAS);
    theta[C2] = -mass * lever * get(ACCEL_Y_BIAS);
    theta
}
