//! Wheel loader: rolling radii, rolling resistance, slip stiffness and centre of gravity.
//!
//! Three stages, each a convex program:
//!
//! 0. *Radii* from coasting samples, where a wheel does not slip: `v = r w`, Huber.
//! 1. *Rolling resistance* from the impulse balance over half a second, Huber:
//!    `sum dt [(T_f - B_f)/r_f + (T_r - B_r)/r_r - F_x - m g sin alpha] - [m dv + sum I_i dw_i/r_i]
//!    = f sum dt (m g cos alpha + F_z)`. Driven one way, an error of the slope looks like rolling resistance; driven both ways, the
//!    error of each log's slope is fitted along, and taken off for stage 2.
//! 2. *`theta = (K, K lambda, K h)`* from `T_i - I_i v'/r_i = r_i sigma_i g_i . theta`, linear in theta, each
//!    row times the speed, so that the noisy slip speed `r w - v = v sigma` enters without a quotient.
//!
//! In stage 2 the slip is measured with noise several times its own size. Least squares then halves
//! `K` and drives `h` to its bound, however long the log is. The rows are therefore solved by
//! instrumental variables: the slip that the torque would cause stands in for the measured one.
//! An error of a radius adds a constant to the slip; it is estimated along, `eta_i = K d ln r_i`, with
//! what stage 0 knows as its prior, so that the height's interval contains the radii's.
//!
//! A speed that is late by `tau` adds `-tau v'` to the slip, which is `v a/(g K)`: ten milliseconds are as much as the
//! whole slip at 2 m/s. And only the ratio of a radius to the gain of the speed shows in it. Stage 2 is therefore solved
//! with both open first: each log's `K tau` with the delay that a good sensor may have as its prior
//! (`--sensor speed.delay_std`), which a delay that the log shows to be larger widens, and the radii as given with the
//! gain's standard deviation. Where that shows a delay, it is the answer. Where it shows none, the answer is that without a
//! delay and with the radii of stage 0, which is more accurate if there is none, but its standard errors hold any delay
//! that would not have shown. Where it does not determine the delay, delay and gain are considered as for any other sensor.
//!
//! The wheel speeds of the two axles may have clocks of their own, too. The front one later than the rear one by `tau_fr`
//! is the speed later by `tau - tau_fr/2` against the front wheels and by `tau + tau_fr/2` against the rear ones: it shifts
//! slip from one axle to the other, and with it the ratio, by 0.09 for 10 ms. `tau_fr` is open as well, with the delay that is
//! declared for the wheel speeds as its prior, and settled in the same way: the slip grows with the speed and a delay does
//! not, so that a log with torque at several speeds tells them apart. Where the log does not determine `tau_fr`, the
//! delay of each wheel speed is considered.

mod rolling;
mod sample;
mod slip;

pub use slip::slip_regression;

use crate::assess::Limits;
use crate::log::Log;
use crate::problem::{FitError, Fitted, Judgement, Offset, Prediction, Problem, Session, Target, Task};
use crate::result::Trace;
use crate::solve::Solution;
use nalgebra::DVector;
use rolling::{coasting_radius, impulse_balance};
use sample::{Balance, Machine, Run, SHARE_APART};
use slip::{FIXED, Radii, SHARED, Slip};
use std::iter::zip;
use wheelstate::Variables;
use wheelstate::estimator::wheel_loader::Parameters;

/// The problem.
pub const PROBLEM: Problem = Problem { targets, outliers: &SPIKED, estimate, validate };

/// A spike of a torque stands on both sides of a row of stage 2 and in its instrument.
const SPIKED: [&str; 5] = ["torque_front", "torque_rear", WHEEL_SPEEDS[0], WHEEL_SPEEDS[1], "speed"];

const WHEEL_SPEEDS: [&str; 2] = ["wheel_speed_front", "wheel_speed_rear"];

const RADII: [&str; 2] = ["loader.wheel_radius_front", "loader.wheel_radius_rear"];
const ROLLING: &str = "rolling.coefficient";
const STIFFNESS: &str = "initial.slip_stiffness";
const RATIO: &str = "initial.cg_ratio";
const HEIGHT: &str = "initial.cg_height";
/// Knowledge of the unknowns for the estimator: their standard errors.
const WIDTHS: [(&str, &str); 3] =
    [(STIFFNESS, "initial.slip_stiffness_std"), (RATIO, "initial.cg_ratio_std"), (HEIGHT, "initial.cg_height_std")];

/// Length of a window of the impulse balance, and of a cluster of the moments, as long as tyres bounce, s.
const WINDOW: f64 = 0.5;
const CLUSTER: f64 = 0.25;
/// Slope of ground that is taken as level, rad.
const FLOOR_SLOPE: f64 = 0.005;
/// Why a rolling coefficient is not identified although noise leaves it well known.
const ONE_WAY: &str = "the machine drives one way, where an error of the slope looks the same: drive both ways, or say how \
                       well the slope is known (--sensor slope.bias_std)";
/// Samples of which one enters stage 2 where only differences between fits are looked for.
const COARSE: usize = 3;
/// Given radii are kept if the log moves none of them by more than so many standard errors.
const KEEP: f64 = 2.0;
/// Largest standard error of a delay that the log determines, as a share of what is known beforehand.
const DETERMINED: f64 = 0.5;
/// Standard errors from which on a log shows a delay.
const SHOWS: f64 = 1.5;
/// What tyres make of the delay of the speed and of that between the wheel speeds, standard deviations, s: their slip lags
/// behind the torque by the relaxation length, 0.3 to 0.7 m, which poses as 0.5 to 1 ms and 1.4 to 3.3 ms (the built-in plant
/// without noise).
const LAGS: [f64; 2] = [0.001, 0.002];
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
            // Coasting shows the radii, changing acceleration the height, driving both ways the rolling resistance.
            let plain = [STIFFNESS, RATIO].contains(&name);
            if plain { target } else { target.optional() }
        })
        .collect()
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let mut machine = Machine::new(task.known, task.logs.len());
    let mut logs = task.logs.iter().map(|log| Run::new(log, &machine)).collect::<Result<Vec<_>, _>>()?;
    let given = machine.clone();
    let mut radii = Radii { given: given.radius, std: [FIXED; 2] };
    for (axle, name) in RADII.into_iter().enumerate() {
        if task.wants(name) {
            radii.std[axle] = machine.radius_std;
            if let Some((radius, std)) = coasting_radius(&logs, &machine, axle, session)? {
                (radii.given[axle], radii.std[axle]) = (radius, std / radius);
                machine.radius[axle] = radius;
            } else {
                session.note(format!("no coasting samples: {name} stays within its initial.wheel_radius_std"));
            }
        }
    }
    if task.wants(ROLLING) {
        rolling_resistance(task, &mut logs, &mut machine, session)?;
    }
    if ![STIFFNESS, RATIO, HEIGHT].iter().chain(&RADII).any(|name| task.wants(name)) {
        return Ok(());
    }
    let names: Vec<&str> = [STIFFNESS, RATIO, HEIGHT].into_iter().chain(WIDTHS.iter().map(|(_, w)| *w)).collect();
    let stage = Slip { logs: &logs, names: &names, stride: if task.coarse { COARSE } else { 1 } };
    let open = with_delay(task, &stage, machine.clone(), given.radius, session)?;
    let fit = match open {
        Some(open) if task.coarse || open.shown => {
            let lags = open.lag_std(&session.solution(open.fit).theta);
            let Open { fit, machine, .. } = open;
            let [stiffness, ratio, height, front, rear] = lags;
            record(fit, [stiffness, ratio, height], session);
            settle_radii(task, &stage, machine, &given, fit, [front, rear], session)?;
            Some(fit)
        }
        Some(open) => {
            let [stiffness, ratio, height, ..] = open.lag_std(&session.solution(open.fit).theta);
            record(open.fit, [stiffness, ratio, height], session);
            let names = [STIFFNESS, RATIO, HEIGHT];
            let stds = names.map(|name| session.std_error(name).unwrap_or(0.0));
            let fit = without_delay(task, &stage, machine, &given, &radii, session)?;
            // Any delay that would not show may be there, as well as the noise that the open fit has.
            let wider = 1.0_f64.hypot(SHOWS / 3.0_f64.sqrt());
            names.into_iter().zip(stds).for_each(|(name, std)| session.widen(name, wider * std));
            if !task.coarse {
                session.note(
                    "no delay shows between the wheel speeds and the speed; the intervals contain what would not have shown: if \
                     they have one clock, --sensor wheel_speed.delay_std=0 and --sensor speed.delay_std=0 say so",
                );
            }
            fit
        }
        None => without_delay(task, &stage, machine, &given, &radii, session)?,
    };
    let Some(fit) = fit else { return Ok(()) };
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

/// Stage 1: the rolling resistance, and, where the machine drives both ways, the error of each log's slope, which is taken off.
fn rolling_resistance(
    task: &Task,
    logs: &mut [Run],
    machine: &mut Machine,
    session: &mut Session,
) -> Result<(), FitError> {
    let Some(alone) = session.solve(&impulse_balance(logs, machine, false), &[ROLLING])? else { return Ok(()) };
    let measured = task.logs.iter().any(|log| log.channel("slope").is_some());
    let known = if measured { task.quality("slope").bias } else { FLOOR_SLOPE };
    let assumed = !task.exact && !task.sensors.iter().any(|(key, _)| key == "slope.bias_std");
    let open = session.solve(&impulse_balance(logs, machine, true), &[])?;
    let open = open.filter(|fit| session.solution(*fit).std(0) < known);
    let both_ways = session.decide("the machine drives both ways", open.is_some());
    let fit = match open.filter(|_| both_ways) {
        Some(fit) => {
            session.estimate(ROLLING, fit, |x| x[0]);
            for (index, (run, log)) in logs.iter_mut().zip(task.logs).enumerate() {
                let solution = session.solution(fit);
                let (value, std_error) = (solution.theta[1 + index], solution.std(1 + index));
                run.tilt(-value);
                let (channel, against) = ("slope".to_owned(), "driving both ways says".to_owned());
                let offset = Offset { log: log.source.clone(), channel, unit: "rad", against, value, std_error };
                session.offset(offset);
            }
            fit
        }
        None => {
            // One way a wrong slope is a wrong resistance: as far as that is from the given one, the slope may be wrong,
            // unless the user says how well it is known.
            let (found, given) = (session.solution(alone), task.known.get(ROLLING));
            let (value, std_error) = (given - found.theta[0], found.std(0));
            for log in task.logs.iter().filter(|_| measured && assumed) {
                let against = "the given rolling resistance says".to_owned();
                let (log, channel) = (log.source.clone(), "slope".to_owned());
                session.offset(Offset { log, channel, unit: "rad", against, value, std_error });
            }
            let systematic_std = if measured || task.exact { 0.0 } else { FLOOR_SLOPE };
            let judgement = Judgement { systematic_std, doubt: assumed.then_some(ONE_WAY), ..Judgement::default() };
            session.estimate_judged(ROLLING, alone, judgement, |x| x[0]);
            alone
        }
    };
    machine.rolling = session.solution(fit).theta[0];
    Ok(())
}

/// Stage 2 with the delays and the gain of the speed open.
struct Open {
    fit: Fitted,
    /// About what it is linearised.
    machine: Machine,
    /// Whether a log shows a delay.
    shown: bool,
    /// By how much the lag of the tyres' slip moves the shared unknowns, as one kind of delay and as the other.
    lags: [[f64; SHARED]; 2],
}

impl Open {
    /// Standard deviations that the lag of the slip leaves in `(K, lambda, h, d ln r_f, d ln r_r)` at these unknowns.
    fn lag_std(&self, theta: &[f64]) -> [f64; SHARED] {
        let of = |moved: &[f64; SHARED], index: usize| match index {
            0 => moved[0],
            _ => (moved[index] - moved[0] * theta[index] / theta[0]) / theta[0],
        };
        std::array::from_fn(|index| of(&self.lags[0], index).hypot(of(&self.lags[1], index)))
    }
}

/// Stage 2 with the delays and the gain of the speed open; none if the logs do not determine the speed's delay.
fn with_delay(
    task: &Task,
    stage: &Slip,
    machine: Machine,
    given: [f64; 2],
    session: &mut Session,
) -> Result<Option<Open>, FitError> {
    let (sensor, clocks) = (task.quality("speed"), WHEEL_SPEEDS.map(|channel| task.quality(channel).delay));
    if sensor.delay <= 0.0 {
        return Ok(None);
    }
    let radius_std = |axle: usize| if task.wants(RADII[axle]) { machine.radius_std } else { 0.0 };
    let radii = Radii { given, std: [0, 1].map(|axle| radius_std(axle).hypot(sensor.gain).max(FIXED)) };
    let start = Machine { late_std: sensor.delay, apart_std: clocks[0].hypot(clocks[1]), ..machine };
    let logs = task.logs.len();
    // Of each log's delays of one kind, with the standard deviation that is known beforehand: whether they are determined.
    let determined = |solution: &Solution, first: usize, std: f64| {
        (first..first + logs).all(|index| solution.std(index) < DETERMINED * std * solution.theta[0])
    };
    let mut machine = start.clone();
    let Some(mut fit) = stage.fit(&mut machine, &radii, None, session)? else { return Ok(None) };
    let told = start.apart_std > 0.0 && determined(session.solution(fit), SHARED + logs, start.apart_std);
    let apart = session.decide_for_parts("the delay between the wheel speeds is determined", told);
    if !apart && start.apart_std > 0.0 {
        machine = Machine { apart_std: 0.0, ..start };
        let Some(without) = stage.fit(&mut machine, &radii, None, session)? else { return Ok(None) };
        fit = without;
    }
    let solution = session.solution(fit);
    let stiff = solution.std(0) < UNOBSERVABLE * solution.theta[0];
    let told = stiff && determined(solution, SHARED, sensor.delay);
    let late: Vec<f64> = machine.late.iter().chain(&machine.apart).copied().collect();
    let open = if apart { 2 * logs } else { logs };
    let shows = |(index, late): (usize, &f64)| {
        late.abs() > SHOWS * (solution.std(SHARED + index) / solution.theta[0]).hypot(LAGS[index / logs])
    };
    let shown = late.iter().enumerate().take(open).any(shows);
    let lags = moved_by_lags(solution, logs, open);
    let about: Vec<f64> = zip(&late, &solution.theta[SHARED..]).map(|(late, x)| late - x / solution.theta[0]).collect();
    let shown = session.decide_for_parts("a delay shows", shown);
    if !session.decide_for_parts("the delay of the speed is determined", told) {
        return Ok(None);
    }
    for (index, log) in task.logs.iter().enumerate() {
        let of = |index: usize| {
            let about = about[index];
            move |x: &[f64]| about + x[SHARED + index] / x[0]
        };
        session.delay(&log.source, "speed", "wheel speeds", fit, of(index));
        if apart {
            session.delay(&log.source, WHEEL_SPEEDS[0], WHEEL_SPEEDS[1], fit, of(logs + index));
        }
    }
    Ok(Some(Open { fit, machine, shown, lags }))
}

/// By how much the shared unknowns are off where the lag of the slip is taken for a delay: the first `open` unknowns after
/// the shared ones, of so many logs each kind, drag the others along as their covariance says, `C_p,tau C_tau^-1 d tau`.
fn moved_by_lags(solution: &Solution, logs: usize, open: usize) -> [[f64; SHARED]; 2] {
    let covariance = &solution.covariance;
    let of_delays = covariance.view((SHARED, SHARED), (open, open)).into_owned();
    let Some(inverse) = of_delays.try_inverse() else { return [[0.0; SHARED]; 2] };
    let with = covariance.view((0, SHARED), (SHARED, open)) * inverse;
    [0, 1].map(|kind| {
        let lag = |index: usize| if index / logs == kind { LAGS[kind] * solution.theta[0] } else { 0.0 };
        let moved = &with * DVector::from_fn(open, |index, _| lag(index));
        std::array::from_fn(|index| moved[index])
    })
}

/// Stage 2 with the speed in time, and with the height as given if it is not seen.
fn without_delay(
    task: &Task,
    stage: &Slip,
    mut machine: Machine,
    given: &Machine,
    radii: &Radii,
    session: &mut Session,
) -> Result<Option<Fitted>, FitError> {
    let start = machine.clone();
    let Some(fit) = stage.fit(&mut machine, radii, None, session)? else { return Ok(None) };
    record(fit, [0.0; 3], session);
    let known = relatively_known(HEIGHT, session);
    if !session.decide("initial.cg_height is seen", known) {
        return without_height(task, stage, start, given, radii.std, session);
    }
    settle_radii(task, stage, machine, given, fit, [0.0; 2], session)?;
    Ok(Some(fit))
}

/// Records the radii that stage 2 found, with relative standard deviations beside those of its covariance, or keeps the given
/// ones if they agree with them.
fn settle_radii(
    task: &Task,
    stage: &Slip,
    machine: Machine,
    given: &Machine,
    fit: Fitted,
    extra_std: [f64; 2],
    session: &mut Session,
) -> Result<(), FitError> {
    // With another gain of the speed, say, the radii would be others and would not be kept.
    let mut kept = !task.coarse;
    for axle in 0..2 {
        let (radius, solution) = (machine.radius[axle], session.solution(fit));
        let std = radius * (solution.std(3 + axle) / solution.theta[0]).hypot(extra_std[axle]);
        let found = move |x: &[f64]| radius * (1.0 + x[3 + axle] / x[0]);
        kept &= (found(&solution.theta) - given.radius[axle]).abs() < KEEP * std;
        if !task.wants(RADII[axle]) {
            continue;
        }
        session.estimate_judged(RADII[axle], fit, radius_limits(task, radius * extra_std[axle]), found);
        // How the estimates change with a cause is asked for whether or not they are worth something by themselves.
        if !task.coarse && std > 0.5 * machine.radius_std * radius {
            kept = false;
            session.retract(RADII[axle], "neither coasting nor changing torque shows it");
        }
    }
    if kept { keep_given_radii(task, stage, machine, given.radius, session) } else { Ok(()) }
}

fn relatively_known(name: &str, session: &Session) -> bool {
    session.value(name).zip(session.std_error(name)).is_some_and(|(value, std)| std <= UNOBSERVABLE * value.abs())
}

/// The radii's columns are strongly correlated with `K` by nature; the intervals say how much it matters.
fn judged(systematic_std: f64) -> Judgement {
    let limits = Limits { relative_error: LARGEST_ERROR, correlation: 1.0, condition_number: 1e6, ..Limits::default() };
    Judgement { limits, systematic_std, ..Judgement::default() }
}

/// A radius matters for the slip: half a per cent is no knowledge. It is as large as the speed says, whose gain is in its
/// interval and none of the slip's business.
fn radius_limits(task: &Task, systematic_std: f64) -> Judgement {
    let usual = judged(systematic_std);
    let relative_error = 0.005_f64.hypot(1.1 * task.quality("speed").gain);
    Judgement { limits: Limits { relative_error, ..usual.limits }, ..usual }
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
    stage: &Slip,
    start: Machine,
    given: &Machine,
    radius_std: [f64; 2],
    session: &mut Session,
) -> Result<Option<Fitted>, FitError> {
    let height = Some((given.unknowns[2], task.known.get("initial.cg_height_std")));
    let fixed = |machine: &Machine| Radii { given: machine.radius, std: [FIXED; 2] };
    let mut machine = start.clone();
    let Some(fit) = stage.fit(&mut machine, &fixed(&start), height, session)? else { return Ok(None) };
    let (mut variance, mut per_mille) = ([0.0; 2], [0.0; 2]);
    // Where only differences between fits are looked for, nobody asks how certain they are.
    for (axle, std) in radius_std.into_iter().enumerate().filter(|(_, std)| !task.coarse && *std > 0.0) {
        let mut moved = start.clone();
        moved.radius[axle] *= 1.0 + std;
        let radii = fixed(&moved);
        if stage.fit(&mut moved, &radii, height, session)?.is_some() {
            for (sum, (a, b)) in variance.iter_mut().zip(moved.unknowns.iter().zip(machine.unknowns)) {
                *sum += (a - b).powi(2);
            }
            per_mille[axle] = 1e-3 / std * (moved.unknowns[0] - machine.unknowns[0]);
        }
    }
    session.estimate_judged(STIFFNESS, fit, judged(variance[0].sqrt()), |x| x[0]);
    session.estimate_judged(RATIO, fit, judged(variance[1].sqrt()), |x| x[1] / x[0]);
    let solution = session.solution(fit);
    let determined = !solution.at_bound[0] && solution.std(0) < Limits::default().relative_error * solution.theta[0];
    if !task.coarse && determined {
        let [front, rear] = per_mille;
        session.note(format!(
            "determined is the slip: {STIFFNESS} = {:.2} +- {:.2} with the rolling radii as they are, {front:+.2} for each 0.1 % \
             that the front radius is larger and {rear:+.2} for the rear one",
            solution.theta[0],
            solution.std(0)
        ));
    }
    session.retract(
        HEIGHT,
        "accelerating and braking do not show it to a quarter, and initial.cg_ratio relies on the known value",
    );
    RADII.iter().filter(|name| task.wants(name)).for_each(|name| {
        session.retract(name, "neither coasting nor changing torque shows it");
    });
    Ok(Some(fit))
}

/// The log does not contradict the given radii, which were measured better than half a minute of
/// driving can: they stay, and so does the uncertainty that the log alone would leave.
fn keep_given_radii(
    task: &Task,
    stage: &Slip,
    mut machine: Machine,
    given: [f64; 2],
    session: &mut Session,
) -> Result<(), FitError> {
    let joint = [STIFFNESS, RATIO, HEIGHT].map(|name| session.std_error(name).unwrap_or(f64::NAN));
    let radii = RADII.map(|name| session.std_error(name).unwrap_or(f64::NAN));
    machine.radius = given;
    let Some(fit) = stage.fit(&mut machine, &Radii { given, std: [FIXED; 2] }, None, session)? else { return Ok(()) };
    record(fit, [0.0; 3], session);
    let alone = [STIFFNESS, RATIO, HEIGHT].map(|name| session.std_error(name).unwrap_or(f64::NAN));
    let extra = std::array::from_fn(|i| (joint[i] * joint[i] - alone[i] * alone[i]).max(0.0).sqrt());
    record(fit, extra, session);
    for axle in 0..2 {
        session.estimate_judged(RADII[axle], fit, radius_limits(task, radii[axle]), move |_| given[axle]);
    }
    session.note("the log agrees with the given rolling radii, which were kept");
    Ok(())
}

/// Predicts the slip speed `r w - v` of each axle, averaged over half a second.
fn validate(task: &Task) -> Vec<Prediction> {
    let machine = Machine::new(task.known, 0);
    let [stiffness, lambda, height] = machine.unknowns;
    let mut predictions = Vec::new();
    for log in task.logs {
        let Ok(run) = Run::new(log, &machine) else { continue };
        let [late, apart] = ["speed", WHEEL_SPEEDS[0]].map(|channel| task.known.delay(&log.source, channel));
        let steps = run.steps(WINDOW);
        let mut traces = ["slip speed, front axle", "slip speed, rear axle"].map(|name| Trace {
            name: name.to_owned(),
            unit: "m/s".to_owned(),
            log: log.source.clone(),
            ..Trace::default()
        });
        for (index, times) in log.time.chunks_exact(steps).enumerate() {
            let (mut measured, mut predicted) = ([0.0; 2], [0.0; 2]);
            for k in index * steps..(index + 1) * steps {
                let sample = &run.samples[k];
                let Balance { load_row, traction, .. } = sample.balance(&machine);
                for axle in 0..2 {
                    let (g, radius) = (load_row[axle], machine.radius[axle]);
                    let load = g[0] + g[1] * lambda + g[2] * height;
                    let speed = run.speed(k, late + SHARE_APART[axle] * apart);
                    let sigma = traction[axle] / (radius * stiffness * load);
                    measured[axle] += (radius * sample.wheel[axle] - speed) / steps as f64;
                    predicted[axle] += sigma * sample.speed.abs() / steps as f64;
                }
            }
            for (axle, trace) in traces.iter_mut().enumerate() {
                trace.time.push(times[steps / 2]);
                trace.measured.push(measured[axle]);
                trace.predicted.push(predicted[axle]);
            }
        }
        predictions.extend(traces.map(|trace| Prediction::new(trace, 1)));
    }
    predictions
}
