//! Stages 0 and 1: rolling radii while coasting, and rolling resistance.

use super::WINDOW;
use super::sample::{Machine, Run};
use crate::problem::{FitError, Session};
use crate::solve::{Regression, Rows, Unknown};
use wheelstate::model::wheel_loader::Loader;

/// Axle torque below which a wheel coasts, N.m; the time that a coast takes to settle, and the least time of coasting
/// that says something, s.
const COAST_TORQUE: f64 = 40.0;
const COAST_SETTLE: f64 = 0.2;
const LEAST_COASTING: f64 = 0.5;
/// Windows of the impulse balance per cluster.
const CLUSTER_WINDOWS: u32 = 4;

/// Stage 0: the radius of an axle and its standard error, or nothing if the machine never coasts.
pub(super) fn coasting_radius(
    logs: &[Run],
    machine: &Machine,
    axle: usize,
    session: &mut Session,
) -> Result<Option<(f64, f64)>, FitError> {
    let mut rows = Rows::new("coasting", "m/s", 1);
    let mut first = 0;
    let mut time = 0.0;
    for run in logs {
        let mut since = 0;
        for (k, sample) in run.samples.iter().enumerate() {
            let forces = [sample.drive.force_x, sample.drive.force_z];
            let coasts = sample.torque.iter().all(|torque| torque.abs() < COAST_TORQUE)
                && forces.iter().all(|force| force.abs() < 100.0);
            since = if coasts { since + 1 } else { 0 };
            let settled = since > run.steps(COAST_SETTLE) && sample.speed > 1.0;
            if settled && rows.push(&[sample.wheel[axle]], sample.speed, first + run.cluster(k)) {
                time += run.period;
            }
        }
        first += run.cluster(run.samples.len()) + 1;
    }
    if time < LEAST_COASTING - 1e-9 {
        return Ok(None);
    }
    let given = machine.radius[axle];
    let prior = given * machine.radius_std;
    let regression = Regression {
        name: "coasting".to_owned(),
        unknowns: vec![Unknown::within("r", 0.5 * given, 2.0 * given).with_prior(given, prior)],
        groups: vec![rows],
        constraints: Vec::new(),
    };
    let Some(fit) = session.solve(&regression, &[])? else { return Ok(None) };
    let solution = session.solution(fit);
    Ok(Some((solution.theta[0], solution.std(0))))
}

/// Stage 1: impulse balance over windows, unknowns `f` and, if they are wanted, the error of each log's slope, rad.
pub(super) fn impulse_balance(logs: &[Run], machine: &Machine, slopes: bool) -> Regression {
    let (radius, Loader { mass, .. }) = (machine.radius, machine.model.loader);
    let inertia = machine.model.loader.axle_inertia();
    let columns = 1 + if slopes { logs.len() } else { 0 };
    let mut rows = Rows::new("impulse", "N.s", columns);
    let mut cluster = 0;
    for (log, run) in logs.iter().enumerate() {
        let steps = run.steps(WINDOW);
        for window in run.samples.windows(steps + 1).step_by(steps) {
            if window.iter().any(|sample| sample.speed.abs() < 0.3) {
                continue;
            }
            let (mut impulse, mut weight, mut upright) = (0.0, 0.0, 0.0);
            for (k, sample) in window.iter().enumerate() {
                let share = if k == 0 || k == steps { 0.5 * run.period } else { run.period };
                let drive: f64 = (0..2).map(|i| sample.torque[i] / radius[i]).sum();
                impulse += share * (drive - sample.drive.force_x - mass * sample.gravity[0]);
                upright += share * mass * sample.gravity[1];
                weight += share * sample.sense * (mass * sample.gravity[1] + sample.drive.force_z);
            }
            let (first, last) = (&window[0], &window[steps]);
            impulse -= mass * (last.speed - first.speed);
            for i in 0..2 {
                impulse -= inertia[i] / radius[i] * (last.wheel[i] - first.wheel[i]);
            }
            let mut row = vec![0.0; columns];
            row[0] = weight;
            // A slope that is too large takes too much off the force.
            row[1..].iter_mut().skip(log).take(1).for_each(|cell| *cell = -upright);
            rows.push(&row, impulse, cluster / CLUSTER_WINDOWS);
            cluster += 1;
        }
    }
    Regression {
        name: "impulse balance".to_owned(),
        unknowns: std::iter::once(Unknown::within("f", 0.0, 0.3))
            .chain((1..columns).map(|_| Unknown::free("error of the slope")))
            .collect(),
        groups: vec![rows],
        constraints: Vec::new(),
    }
}
