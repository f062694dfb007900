//! Wheel loader: rolling radii, rolling resistance, slip stiffness and centre of gravity.
//!
//! Three stages, each a convex program:
//!
//! 0. *Radii* from coasting samples, where a wheel does not slip: `v = r w`, Huber.
//! 1. *Rolling resistance* from the impulse balance over half a second, Huber:
//!    `sum dt [(T_f - B_f)/r_f + (T_r - B_r)/r_r - F_x - m g sin alpha] - [m dv + sum I_i dw_i/r_i]
//!    = f sum dt (m g cos alpha + F_z)`.
//! 2. *`theta = (K, K lambda, K h)`* from `T_i - I_i v'/r_i = r_i sigma_i g_i . theta`, linear in theta, each
//!    row times the speed, so that the noisy slip speed `r w - v = v sigma` enters without a quotient.
//!
//! In stage 2 the slip is measured with noise several times its own size. Least squares then halves
//! `K` and drives `h` to its bound, however long the log is. The rows are therefore solved by
//! instrumental variables: the slip that the torque would cause stands in for the measured one.
//! An error of a radius adds a constant to the slip; it is estimated along, `eta_i = K d ln r_i`, with
//! what stage 0 knows as its prior, so that the height's interval contains the radii's.

mod sample;

use crate::assess::Limits;
use crate::log::Log;
use crate::problem::{FitError, Fitted, Judgement, Known, Prediction, Problem, Session, Target, Task};
use crate::result::Trace;
use crate::solve::{Affine, Constraint, Regression, Rows, Unknown};
use sample::{Machine, Run};
use wheelstate::Variables;
use wheelstate::estimator::wheel_loader::Parameters;
use wheelstate::model::wheel_loader::{GRAVITY, Loader};

/// The problem.
pub const PROBLEM: Problem = Problem { targets, estimate, validate };

const RADII: [&str; 2] = ["loader.wheel_radius_front", "loader.wheel_radius_rear"];
const ROLLING: &str = "rolling.coefficient";
const STIFFNESS: &str = "initial.slip_stiffness";
const RATIO: &str = "initial.cg_ratio";
const HEIGHT: &str = "initial.cg_height";
/// Knowledge of the unknowns for the estimator: their standard errors.
const WIDTHS: [(&str, &str); 3] =
    [(STIFFNESS, "initial.slip_stiffness_std"), (RATIO, "initial.cg_ratio_std"), (HEIGHT, "initial.cg_height_std")];

/// Axle torque below which a wheel coasts, N.m; the time that a coast takes to settle, and the least time of coasting
/// that says something, s.
const COAST_TORQUE: f64 = 40.0;
const COAST_SETTLE: f64 = 0.2;
const LEAST_COASTING: f64 = 0.5;
/// Length of a window of the impulse balance, and of a cluster of the moments, as long as tyres bounce, s.
const WINDOW: f64 = 0.5;
const CLUSTER: f64 = 0.25;
/// Windows of the impulse balance per cluster.
const CLUSTER_WINDOWS: u32 = 4;
/// Slowest speed, m/s, and largest slip of the samples of stage 2.
const SLOWEST: f64 = 0.8;
const LARGEST_SLIP: f64 = 0.15;
/// Linearisations of the radii's columns in stage 2.
const PASSES: usize = 3;
/// Relative standard deviation of a radius that is not to move.
const FIXED: f64 = 1e-7;
/// Given radii are kept if the log moves none of them by more than so many standard errors.
const KEEP: f64 = 2.0;
/// Relative standard error beyond which an unknown counts as unobservable.
const UNOBSERVABLE: f64 = 0.25;
/// Largest relative standard error of an identified unknown with all that is considered. The estimator starts from the
/// unknown with this standard deviation and improves on it.
const LARGEST_ERROR: f64 = 0.5;

fn targets(_: &[Log]) -> Vec<Target> {
    let declared = Parameters::declare();
    let names = [RADII[0], RADII[1], ROLLING, STIFFNESS, RATIO, HEIGHT];
    names
        .into_iter()
        .chain(WIDTHS.iter().map(|(_, width)| *width))
        .map(|name| {
            let target = Target::declared(&declared, name, true);
            // Coasting shows the radii, changing acceleration the height.
            let plain = [ROLLING, STIFFNESS, RATIO].contains(&name);
            if plain { target } else { target.optional() }
        })
        .collect()
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let mut machine = Machine::new(task.known);
    let logs = task.logs.iter().map(|log| Run::new(log, &machine)).collect::<Result<Vec<_>, _>>()?;
    let mut radius_std = [FIXED; 2];
    for axle in 0..2 {
        if task.wants(RADII[axle]) {
            radius_std[axle] = machine.radius_std;
            if let Some((radius, std)) = coasting_radius(&logs, &machine, axle, session)? {
                machine.radius[axle] = radius;
                radius_std[axle] = std / radius;
            } else {
                session.note(format!("no coasting samples: {} stays within its initial.wheel_radius_std", RADII[axle]));
            }
        }
    }
    if task.wants(ROLLING) {
        let regression = impulse_balance(&logs, &machine);
        if let Some(fit) = session.solve(&regression, &[ROLLING])? {
            session.estimate(ROLLING, fit, |x| x[0]);
            machine.rolling = session.solution(fit).theta[0];
        }
    }
    if ![STIFFNESS, RATIO, HEIGHT].iter().chain(&RADII).any(|name| task.wants(name)) {
        return Ok(());
    }
    let names: Vec<&str> = [STIFFNESS, RATIO, HEIGHT].into_iter().chain(WIDTHS.iter().map(|(_, w)| *w)).collect();
    let given = Machine::new(task.known);
    let Some(fit) = slip_fit(&logs, &mut machine, radius_std, None, &names, session)? else { return Ok(()) };
    record(fit, [0.0; 3], session);
    let (mut fit, mut height_known) = (fit, true);
    if !relatively_known(HEIGHT, session) {
        height_known = false;
        let Some(again) = without_height(task, &logs, machine, &given, radius_std, &names, session)? else {
            return Ok(());
        };
        fit = again;
    }
    let mut kept = height_known;
    for axle in 0..2 {
        if !task.wants(RADII[axle]) {
            kept = false;
            continue;
        }
        let radius = machine.radius[axle];
        session.estimate_judged(RADII[axle], fit, radius_limits(0.0), move |x| radius * (1.0 + x[3 + axle] / x[0]));
        let (value, std) = (session.value(RADII[axle]), session.std_error(RADII[axle]));
        let Some((value, std)) = value.zip(std) else { continue };
        kept &= (value - given.radius[axle]).abs() < KEEP * std;
        if !height_known || std > 0.5 * machine.radius_std * radius {
            kept = false;
            session.retract(RADII[axle], "neither coasting nor changing torque shows it");
        }
    }
    if kept {
        keep_given_radii(&logs, machine, given.radius, &names, session)?;
    }
    for (name, width) in WIDTHS {
        let (Some(value), Some(std)) = (session.value(name), session.std_error(name)) else { continue };
        if std <= UNOBSERVABLE * value.abs() {
            session.estimate_judged(width, fit, judged(0.0), move |_| std);
        } else {
            session.give_up(width, &format!("{name} is not known well enough to start from"));
        }
    }
    Ok(())
}

fn relatively_known(name: &str, session: &Session) -> bool {
    session.value(name).zip(session.std_error(name)).is_some_and(|(value, std)| std <= UNOBSERVABLE * value.abs())
}

/// Solves stage 2 and leaves its answer in the machine for the next linearisation.
fn slip_fit(
    logs: &[Run],
    machine: &mut Machine,
    radius_std: [f64; 2],
    height: Option<(f64, f64)>,
    names: &[&str],
    session: &mut Session,
) -> Result<Option<Fitted>, FitError> {
    let mut fit = None;
    for _ in 0..PASSES {
        fit = session.solve(&slip_balance(logs, machine, radius_std, height, true), names)?;
        let Some(found) = fit else { break };
        let theta = &session.solution(found).theta;
        machine.unknowns = [theta[0], theta[1] / theta[0], theta[2] / theta[0]];
    }
    Ok(fit)
}

/// The radii's columns are strongly correlated with `K` by nature; the intervals say how much it matters.
fn judged(systematic_std: f64) -> Judgement {
    let limits = Limits { relative_error: LARGEST_ERROR, correlation: 1.0, condition_number: 1e6, ..Limits::default() };
    Judgement { limits, systematic_std, ..Judgement::default() }
}

/// A radius matters for the slip: half a per cent is no knowledge.
fn radius_limits(systematic_std: f64) -> Judgement {
    let usual = judged(systematic_std);
    Judgement { limits: Limits { relative_error: 0.005, ..usual.limits }, ..usual }
}

fn record(fit: Fitted, extra_std: [f64; 3], session: &mut Session) {
    session.estimate_judged(STIFFNESS, fit, judged(extra_std[0]), |x| x[0]);
    session.estimate_judged(RATIO, fit, judged(extra_std[1]), |x| x[1] / x[0]);
    session.estimate_judged(HEIGHT, fit, judged(extra_std[2]), |x| x[2] / x[0]);
}

/// At constant torque height and ratio are one unknown, and so are the radii and the slip stiffness:
/// the given height, as uncertain as it is said to be, and the radii as they are leave a ratio that
/// can be used. What the radii's uncertainty does to it is found by moving them.
fn without_height(
    task: &Task,
    logs: &[Run],
    mut machine: Machine,
    given: &Machine,
    radius_std: [f64; 2],
    names: &[&str],
    session: &mut Session,
) -> Result<Option<Fitted>, FitError> {
    machine.unknowns = given.unknowns;
    let prior = Some((given.unknowns[2], task.known.get("initial.cg_height_std")));
    let start = machine;
    let Some(fit) = slip_fit(logs, &mut machine, [FIXED; 2], prior, names, session)? else { return Ok(None) };
    let mut variance = [0.0; 2];
    for (axle, std) in radius_std.into_iter().enumerate() {
        let mut moved = start;
        moved.radius[axle] *= 1.0 + std;
        if slip_fit(logs, &mut moved, [FIXED; 2], prior, names, session)?.is_some() {
            for (sum, (a, b)) in variance.iter_mut().zip(moved.unknowns.iter().zip(machine.unknowns)) {
                *sum += (a - b).powi(2);
            }
        }
    }
    session.estimate_judged(STIFFNESS, fit, judged(variance[0].sqrt()), |x| x[0]);
    session.estimate_judged(RATIO, fit, judged(variance[1].sqrt()), |x| x[1] / x[0]);
    session.note("initial.cg_height is not seen in the log; initial.cg_ratio relies on its given value");
    Ok(Some(fit))
}

/// The log does not contradict the given radii, which were measured better than half a minute of
/// driving can: they stay, and so does the uncertainty that the log alone would leave.
fn keep_given_radii(
    logs: &[Run],
    mut machine: Machine,
    given: [f64; 2],
    names: &[&str],
    session: &mut Session,
) -> Result<(), FitError> {
    let joint = [STIFFNESS, RATIO, HEIGHT].map(|name| session.std_error(name).unwrap_or(f64::NAN));
    let radii = RADII.map(|name| session.std_error(name).unwrap_or(f64::NAN));
    machine.radius = given;
    let Some(fit) = slip_fit(logs, &mut machine, [FIXED; 2], None, names, session)? else { return Ok(()) };
    record(fit, [0.0; 3], session);
    let alone = [STIFFNESS, RATIO, HEIGHT].map(|name| session.std_error(name).unwrap_or(f64::NAN));
    let extra = std::array::from_fn(|i| (joint[i] * joint[i] - alone[i] * alone[i]).max(0.0).sqrt());
    record(fit, extra, session);
    for axle in 0..2 {
        session.estimate_judged(RADII[axle], fit, radius_limits(radii[axle]), move |_| given[axle]);
    }
    session.note("the log agrees with the given rolling radii, which were kept");
    Ok(())
}

/// Stage 0: the radius of an axle and its standard error, or nothing if the machine never coasts.
fn coasting_radius(
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

/// Stage 1: impulse balance over windows.
fn impulse_balance(logs: &[Run], machine: &Machine) -> Regression {
    let (radius, Loader { mass, .. }) = (machine.radius, machine.model.loader);
    let inertia = machine.model.loader.axle_inertia();
    let mut rows = Rows::new("impulse", "N.s", 1);
    let mut cluster = 0;
    for run in logs {
        let steps = run.steps(WINDOW);
        for window in run.samples.windows(steps + 1).step_by(steps) {
            if window.iter().any(|sample| sample.speed < 0.3) {
                continue;
            }
            let (mut impulse, mut weight) = (0.0, 0.0);
            for (k, sample) in window.iter().enumerate() {
                let share = if k == 0 || k == steps { 0.5 * run.period } else { run.period };
                let drive: f64 = (0..2).map(|i| sample.torque[i] / radius[i]).sum();
                impulse += share * (drive - sample.drive.force_x - mass * GRAVITY * sample.drive.slope.sin());
                weight += share * machine.sense(sample.speed) * machine.model.weight(&sample.drive);
            }
            let (first, last) = (&window[0], &window[steps]);
            impulse -= mass * (last.speed - first.speed);
            for i in 0..2 {
                impulse -= inertia[i] / radius[i] * (last.wheel[i] - first.wheel[i]);
            }
            rows.push(&[weight], impulse, cluster / CLUSTER_WINDOWS);
            cluster += 1;
        }
    }
    Regression {
        name: "impulse balance".to_owned(),
        unknowns: vec![Unknown::within("f", 0.0, 0.3)],
        groups: vec![rows],
        constraints: Vec::new(),
    }
}

/// Stage 2: torque against slip and load, unknowns `(K, K lambda, K h, eta_f, eta_r)`.
fn slip_balance(
    logs: &[Run],
    machine: &Machine,
    radius_std: [f64; 2],
    height: Option<(f64, f64)>,
    instrumented: bool,
) -> Regression {
    let prior = height;
    let [stiffness, lambda, height] = machine.unknowns;
    let mut rows = Rows::new("slip", "N.m", 5);
    let mut noise = vec![0.0; 36];
    let mut first = 0;
    for run in logs {
        for (k, sample) in run.samples.iter().enumerate() {
            for axle in 0..2 {
                let slipping = sample.slip_speed(machine, axle);
                let speed = sample.smooth;
                if speed <= SLOWEST || slipping.abs() >= LARGEST_SLIP * speed || slipping.is_nan() {
                    continue;
                }
                let g = sample.load_row(machine, axle);
                let radius = machine.radius[axle];
                let load = g[0] + g[1] * lambda + g[2] * height;
                let traction = sample.traction(machine, axle);
                // Times the speed: the noise of the slip speed is the same at every speed.
                let row_of = |slipping: f64| {
                    let mut row = [0.0; 5];
                    for (cell, g) in row.iter_mut().zip(g) {
                        *cell = radius * slipping * g;
                    }
                    row[3 + axle] = speed * radius * load;
                    row
                };
                let row = row_of(slipping);
                let id = first + run.cluster(k + 1);
                if instrumented {
                    let instruments = row_of(speed * traction / (radius * stiffness * load));
                    rows.push_instrumented(&row, speed * traction, &instruments, id);
                } else if rows.push(&row, speed * traction, id) {
                    // What the sensors' noise alone puts into the row.
                    let sensors = machine.noise[0].powi(2) + (radius * machine.noise[1]).powi(2);
                    for (j, k) in (0..9).map(|n| (n / 3, n % 3)) {
                        noise[j * 6 + k] += radius * radius * sensors * g[j] * g[k];
                    }
                }
            }
        }
        first += run.cluster(run.samples.len()) + 1;
    }
    if !instrumented && !rows.is_empty() {
        rows.noise = noise.iter().map(|sum| sum / rows.len() as f64).collect();
    }
    let eta = |axle: usize| {
        let std = stiffness * radius_std[axle];
        Unknown::free(if axle == 0 { "eta_f" } else { "eta_r" }).with_prior(0.0, std)
    };
    let between = |index: usize, low: f64, high: f64| {
        [
            Constraint::NonNegative(Affine::new(&[(index, 1.0), (0, -low)], 0.0)),
            Constraint::NonNegative(Affine::new(&[(index, -1.0), (0, high)], 0.0)),
        ]
    };
    let mut constraints = between(1, 0.1, 0.9).to_vec();
    constraints.extend(between(2, 0.3, 2.5));
    Regression {
        name: "slip and load".to_owned(),
        unknowns: vec![
            Unknown::within("K", 2.0, 80.0),
            Unknown::free("K lambda"),
            match prior {
                Some((mean, std)) => Unknown::free("K h").with_prior(stiffness * mean, stiffness * std),
                None => Unknown::free("K h"),
            },
            eta(0),
            eta(1),
        ],
        groups: vec![rows],
        constraints,
    }
}

/// The regression of stage 2 with the known radii, by instruments or by plain least squares: for
/// comparisons.
pub fn slip_regression(log: &Log, known: &Known, instrumented: bool) -> Result<Regression, FitError> {
    let machine = Machine::new(known);
    Ok(slip_balance(&[Run::new(log, &machine)?], &machine, [FIXED; 2], None, instrumented))
}

/// Predicts the slip speed `r w - v` of each axle, averaged over half a second.
fn validate(task: &Task) -> Vec<Prediction> {
    let machine = Machine::new(task.known);
    let [stiffness, lambda, height] = machine.unknowns;
    let mut predictions = Vec::new();
    for log in task.logs {
        let Ok(run) = Run::new(log, &machine) else { continue };
        let steps = run.steps(WINDOW);
        for (axle, name) in ["slip speed, front axle", "slip speed, rear axle"].iter().enumerate() {
            let mut trace = Trace {
                name: (*name).to_owned(),
                unit: "m/s".to_owned(),
                log: log.source.clone(),
                time: Vec::new(),
                measured: Vec::new(),
                predicted: Vec::new(),
            };
            for (window, times) in run.samples.chunks_exact(steps).zip(log.time.chunks_exact(steps)) {
                let (mut measured, mut predicted) = (0.0, 0.0);
                for sample in window {
                    let g = sample.load_row(&machine, axle);
                    let load = g[0] + g[1] * lambda + g[2] * height;
                    let radius = machine.radius[axle];
                    let sigma = sample.traction(&machine, axle) / (radius * stiffness * load);
                    measured += sample.slip_speed(&machine, axle) / steps as f64;
                    predicted += sigma * sample.speed / steps as f64;
                }
                trace.time.push(times[steps / 2]);
                trace.measured.push(measured);
                trace.predicted.push(predicted);
            }
            predictions.push(Prediction { trace, independent: 1 });
        }
    }
    predictions
}
