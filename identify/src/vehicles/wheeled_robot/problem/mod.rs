//! Tyre parameters and rolling resistance of a four-wheeled robot or car.
//!
//! Measured axle forces ([`mod@axles`]) are compared with the Magic Formula at the measured slip angles and
//! wheel loads, per axle with the unknowns `(ln K0, C, ln mu0, E)`, by sequential convex programming: one
//! convex program with Huber rows, priors and a box-shaped trust region per step. Load laws, nominal loads and
//! the vehicle are known parameters.
//!
//! Friction, shape and curvature show only where the tyre bends: they count as identified only if the slip
//! angles reach beyond `2/B`, near the peak, and their standard errors are small. Else they keep their
//! known values ("prior only") and the rest is fitted again with them.
//!
//! No tyre pulls more than friction times load. Where an axle does, its known friction is contradicted and is fitted
//! too, wherever the slip angles end: a friction that is too small bends the curve too early and makes the stiffness
//! too large.
//!
//! The filter considers the errors of stiffness and friction (`tire.*.stiffness_std`, `friction_std`): those of the fit,
//! with what the same tyre differs by from one drive to another.

pub mod axles;

use crate::assess::Limits;
use crate::log::{Log, LogError};
use crate::problem::{FitError, Fitted, Judgement, Offset, Prediction, Problem, Session, Target, Task};
use crate::progress::Progress;
use crate::result::Trace;
use crate::solve::{
    Loss, Regression, Rows, Scale, Smooth, SmoothGroup, Solution, SolveError, Trust, TrustNorm, Unknown, refine,
};
use axles::{Axles, Instant, axles};
use std::f64::consts::{LN_2, LN_10};
use wheelstate::Variables;
use wheelstate::estimator::wheeled_robot::Parameters;
use wheelstate::model::tire::{Tire, Tires};
use wheelstate::model::wheeled_robot::{GRAVITY, WheeledRobot};

/// The problem.
pub const PROBLEM: Problem = Problem { targets, outliers: &[], estimate, validate };

const AXLES: [&str; 2] = ["front", "rear"];
const TIRE: [&str; 4] = ["stiffness", "shape", "friction", "curvature"];
const ROLLING: &str = "rolling.coefficient";
/// Ranges of the unknowns `(ln K0, C, ln mu0, E)`: K0 from 10 to 1e7 N/rad, mu0 from 0.05 to 2.
const RANGES: [(f64, f64); 4] = [(LN_10, 7.0 * LN_10), (1.0, 2.2), (-LN_2 - LN_10, LN_2), (-5.0, 0.95)];
/// What the regression of the rolling coefficient may find, so that a value below its range shows itself.
const ROLLING_RANGE: (f64, f64) = (-0.2, 0.5);
/// Standard deviations of the priors of `C` and `E`.
const PRIOR_STD: [f64; 4] = [f64::INFINITY, 0.3, f64::INFINITY, 1.0];
/// Largest standard error of an identified parameter, relative; of the curvature absolute.
const RELATIVE: f64 = 0.1;
const CURVATURE: f64 = 0.4;
/// Largest standard error of an identified parameter, relative, with all that is considered: sensors, known values.
const LARGEST_ERROR: f64 = 0.2;
/// Errors of the parameters that the filter considers, relative, and what stiffness and friction differ by from one drive
/// to another with temperature, pressure, wear and road (one standard deviation).
const WIDTHS: [(usize, &str, f64); 2] = [(0, "stiffness_std", 0.15), (2, "friction_std", 0.1)];
/// Share of the instants in which an axle must pull more than friction times load to contradict the friction: noise and
/// bumps do in some.
const BEYOND: f64 = 0.01;
/// Slope of ground that is taken as level, rad: without an accelerometer it is part of the rolling resistance.
const FLOOR_SLOPE: f64 = 0.005;
/// Fewer instants than this say nothing about a tyre.
const LEAST_INSTANTS: usize = 30;

fn name(axle: usize, parameter: usize) -> String {
    format!("tire.{}.{}", AXLES[axle], TIRE[parameter])
}

fn targets(_: &[Log]) -> Vec<Target> {
    let declared = Parameters::declare();
    let tire = |axle: usize| {
        let declared = &declared;
        (0..4).map(move |parameter| {
            let target = Target::declared(declared, &name(axle, parameter), true);
            let (low, high) = RANGES[parameter];
            let exponential = parameter == 0 || parameter == 2;
            let target = if exponential { target.within(low.exp(), high.exp()) } else { target.within(low, high) };
            if parameter == 0 { target } else { target.optional().contested() }
        })
    };
    let rolling = Target::declared(&declared, ROLLING, true).within(0.0, ROLLING_RANGE.1).optional();
    let width =
        |axle: &str| WIDTHS.map(|(_, w, _)| Target::declared(&declared, &format!("tire.{axle}.{w}"), true).optional());
    tire(0).chain(tire(1)).chain(AXLES.into_iter().flat_map(width)).chain([rolling]).collect()
}

fn read(task: &Task) -> Result<(Parameters, Vec<Axles>), LogError> {
    let p = task.known.parameters::<Parameters>();
    let logs = task.logs.iter().map(|log| axles(log, &p)).collect::<Result<_, _>>()?;
    Ok((p, logs))
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let (p, logs) = read(task)?;
    let mut pair = [p.tire.front, p.tire.rear];
    for axle in 0..2 {
        let names: Vec<String> = (0..4).map(|parameter| name(axle, parameter)).collect();
        if names.iter().any(|name| task.wants(name)) {
            task.progress.check()?;
            session.progress = task.progress.piece(axle, 2);
            pair[axle] = tire(&p, &logs, axle, &pair, session)?;
        }
    }
    let mut sources: Vec<&str> = logs.iter().map(|log| log.forces_from).collect();
    sources.dedup();
    for (log, source) in logs.iter().zip(task.logs) {
        log.beyond.iter().for_each(|offset| session.offset(Offset { log: source.source.clone(), ..offset.clone() }));
    }
    session.note(format!("longitudinal wheel forces from {}", sources.join("; and from ")));
    if task.wants(ROLLING) {
        rolling(task, &logs, session)?;
    }
    Ok(())
}

/// A tyre with other values of the unknowns.
fn with(tire: &Tire, theta: &[f64; 4]) -> Tire {
    // the slope of friction keeps its proportion to the friction
    let friction = theta[2].exp();
    let friction_slope = tire.friction_slope * friction / tire.friction;
    Tire { stiffness: theta[0].exp(), shape: theta[1], friction, friction_slope, curvature: theta[3], ..*tire }
}

/// Lateral force of an axle, N.
fn axle_force(tires: &Tires, instant: &Instant, axle: usize, combined: bool) -> f64 {
    instant.explained(&tires.lateral_forces(instant.slip, instant.load, instant.longitudinal, combined))[axle]
}

fn unknowns(tire: &Tire) -> [f64; 4] {
    [tire.stiffness.ln(), tire.shape, tire.friction.ln(), tire.curvature]
}

/// Fits the tyres of an axle, those of the other one being as in `pair`.
fn tire(
    p: &Parameters,
    logs: &[Axles],
    axle: usize,
    pair: &[Tire; 2],
    session: &mut Session,
) -> Result<Tire, FitError> {
    let instants: Vec<(usize, &Instant)> =
        logs.iter().enumerate().flat_map(|(i, log)| log.instants.iter().map(move |instant| (i, instant))).collect();
    if instants.len() < LEAST_INSTANTS {
        for parameter in 0..4 {
            session.give_up(&name(axle, parameter), "the logs hold too few moving samples with all channels");
        }
        return Ok(pair[axle]);
    }
    let prior = pair[axle];
    let (loss, progress) = (session.loss(), session.progress.clone());
    let profiled: [bool; 4] = std::array::from_fn(|i| session.profiles(&name(axle, i)));
    let solve = |free: [bool; 4], profiled| solve(p, &instants, axle, pair, free, profiled, loss, &progress);
    let all = solve([true; 4], [false; 4])?;
    let theta: [f64; 4] = std::array::from_fn(|i| all.theta[i]);
    let fitted = with(&prior, &theta);
    let (bend, reach) = reach(p, &fitted, &instants, axle);
    let beyond = beyond_friction(&prior, &instants, axle);
    let mut decide = |what: &str, now: bool| session.decide(&format!("{} {what}", AXLES[axle]), now);
    let contradicted = decide("friction is contradicted", beyond > BEYOND);
    let near_peak = decide("tyres reach their peak", reach > 2.0 / bend && all.std(2) < RELATIVE);
    let shape = decide("shape is seen", near_peak && all.std(1) < RELATIVE * theta[1] && !all.at_bound[1]);
    let curvature = decide("curvature is seen", near_peak && all.std(3) < CURVATURE && !all.at_bound[3]);
    let free = [true, shape, near_peak || contradicted, curvature];
    let with_all = [all.theta[0].exp(), all.theta[2].exp()];
    let fit = if free == [true; 4] && profiled == [false; 4] { all } else { solve(free, profiled)? };
    // what the known values of the others pull the stiffness by
    let kept = (0..4).filter(|i| free[*i]).position(|i| i == 2);
    let pull = [0, 1].map(|i| {
        let place = if i == 0 { Some(0) } else { kept };
        place.map_or(0.0, |place| (fit.theta[place].exp() - with_all[i]).abs())
    });
    if contradicted {
        session.warn(format!(
            "{} = {} is contradicted: in {:.1} % of the instants the axle pulls more than friction times load; it is \
             fitted instead",
            name(axle, 2),
            prior.friction,
            100.0 * beyond
        ));
    }
    let mut end = unknowns(&prior);
    (0..4).filter(|i| free[*i]).zip(&fit.theta).for_each(|(i, value)| end[i] = *value);
    let fit = session.keep(fit);
    record(axle, free, fit, flattening(logs, axle), pull, session);
    widths(axle, fit, session);
    for parameter in (1..4).filter(|parameter| !free[*parameter]) {
        let reason = if near_peak {
            "prior only: the slip angles do not distinguish it from the other parameters".to_owned()
        } else {
            format!(
                "prior only: slip angles up to {reach:.3} rad do not reach the tyre's peak (beyond {:.3} rad)",
                2.0 / bend
            )
        };
        session.give_up(&name(axle, parameter), &reason);
    }
    Ok(with(&prior, &end))
}

/// Share of the instants in which an axle pulls more than its tyres' friction times load.
fn beyond_friction(tire: &Tire, instants: &[(usize, &Instant)], axle: usize) -> f64 {
    let beyond = |instant: &Instant| {
        let peak: f64 = [2 * axle, 2 * axle + 1].map(|wheel| tire.coefficients(instant.load[wheel]).d).iter().sum();
        instant.axle_force[axle].abs() > peak
    };
    instants.iter().filter(|(_, instant)| beyond(instant)).count() as f64 / instants.len() as f64
}

/// The errors that the filter shall consider.
fn widths(axle: usize, fit: Fitted, session: &mut Session) {
    for (parameter, width, other) in WIDTHS {
        let (from, width) = (name(axle, parameter), format!("tire.{}.{width}", AXLES[axle]));
        let Some((value, std)) = session.value(&from).zip(session.std_error(&from)) else {
            session.give_up(&width, &format!("{from} is not fitted"));
            continue;
        };
        session.estimate_judged(&width, fit, Judgement::default(), move |_| (std / value).hypot(other));
    }
}

/// Stiffness factor `B` at the static load, and the slip angle that 2 % of the instants exceed.
fn reach(p: &Parameters, tire: &Tire, instants: &[(usize, &Instant)], axle: usize) -> (f64, f64) {
    let load = WheeledRobot::new(&p.vehicle, &p.tire, p.filter.minimum_speed).loads(0.0, 0.0)[2 * axle];
    let mut angles: Vec<f64> = instants.iter().map(|(_, instant)| instant.slip[2 * axle].abs()).collect();
    angles.sort_by(f64::total_cmp);
    (tire.coefficients(load).b, angles[(angles.len() - 1) * 98 / 100])
}

/// One fit of the unknowns `(ln K0, C, ln mu0, E)` of an axle's tyres to instants, each with the number of its
/// log; `pair` holds the known values. Unknowns that are not free keep these and are left out; the profiles of some of the
/// others may be wanted.
#[allow(clippy::too_many_arguments, reason = "what is fitted, to what and how")]
pub fn solve(
    p: &Parameters,
    instants: &[(usize, &Instant)],
    axle: usize,
    pair: &[Tire; 2],
    free: [bool; 4],
    profiled: [bool; 4],
    loss: Loss,
    progress: &Progress,
) -> Result<Solution, SolveError> {
    let prior = &pair[axle];
    let known = unknowns(prior);
    let kept: Vec<usize> = (0..4).filter(|i| free[*i]).collect();
    let unknown = |i: usize| {
        let (low, high) = RANGES[i];
        let unknown = Unknown::within(TIRE[i], low, high);
        if PRIOR_STD[i].is_finite() { unknown.with_prior(known[i], PRIOR_STD[i]) } else { unknown }
    };
    // one group per log, so that logs with other noise have their own scale
    let count = instants.last().map_or(0, |(log, _)| log + 1);
    let mut places = vec![Vec::new(); count];
    instants.iter().for_each(|(log, instant)| places[*log].push(*instant));
    places.retain(|list| !list.is_empty());
    let residuals = |theta: &[f64]| -> Vec<Vec<f64>> {
        let mut all = known;
        kept.iter().zip(theta).for_each(|(place, value)| all[*place] = *value);
        let tire = with(prior, &all);
        let tires = if axle == 0 { Tires::new(&tire, &pair[1]) } else { Tires::new(&pair[0], &tire) };
        let of = |instant: &&Instant| instant.axle_force[axle] - axle_force(&tires, instant, axle, p.tire.combined);
        places.iter().map(|list| list.iter().map(of).collect()).collect()
    };
    let group = |list: &Vec<&Instant>| {
        let clusters = list.last().map_or(1, |last| last.cluster as usize + 1);
        SmoothGroup {
            name: format!("{} axle", AXLES[axle]),
            unit: "N",
            scale: Scale::Robust,
            cluster_rows: (list.len() / clusters).max(1),
        }
    };
    let groups: Vec<SmoothGroup> = places.iter().map(group).collect();
    let problem = Smooth {
        name: format!("tyres of the {} axle", AXLES[axle]),
        unknowns: kept.iter().map(|i| unknown(*i)).collect(),
        start: kept.iter().map(|i| known[*i]).collect(),
        typical: kept.iter().map(|i| [1.0, 0.3, 1.0, 1.0][*i]).collect(),
        groups,
        residuals: &residuals,
        constraints: Vec::new(),
        trust: Trust { radius: 0.5, largest: 2.0, norm: TrustNorm::Box, accept: 0.1 },
        passes: 3,
        fuller: None,
        correct: false,
        profiled: (0..kept.len()).filter(|place| profiled[kept[*place]]).collect(),
        progress: progress.clone(),
    };
    refine(&problem, loss)
}

/// Relative loss of stiffness by noise in the slip angles: noise power over slip power.
fn flattening(logs: &[Axles], axle: usize) -> f64 {
    let (mut noise, mut slip) = (0.0, 0.0);
    for log in logs {
        for instant in &log.instants {
            noise += (log.lateral_noise / instant.speed).powi(2);
            slip += instant.slip[2 * axle].powi(2);
        }
    }
    if slip > 0.0 { (noise / slip).min(1.0) } else { 0.0 }
}

fn record(axle: usize, free: [bool; 4], fit: Fitted, flattening: f64, pull: [f64; 2], session: &mut Session) {
    let stiffness = session.solution(fit).theta[0].exp();
    // Condition and correlation say little beside priors: standard errors judge.
    let limits = Limits {
        condition_number: f64::INFINITY,
        relative_error: LARGEST_ERROR,
        correlation: 1.1,
        ..Limits::default()
    };
    let judgement = |parameter: usize| {
        let absolute_error = (parameter == 3).then_some(CURVATURE);
        let systematic_std = match parameter {
            0 => pull[0].hypot(flattening * stiffness),
            2 => pull[1],
            _ => 0.0,
        };
        Judgement { limits: Limits { absolute_error, ..limits }, systematic_std, ..Judgement::default() }
    };
    for (place, parameter) in (0..4).filter(|parameter| free[*parameter]).enumerate() {
        let exponential = parameter == 0 || parameter == 2;
        let value = move |theta: &[f64]| if exponential { theta[place].exp() } else { theta[place] };
        session.estimate_judged(&name(axle, parameter), fit, judgement(parameter), value);
    }
}

/// Rolling resistance from the force that torques make and acceleration does not show.
fn rolling(task: &Task, logs: &[Axles], session: &mut Session) -> Result<(), FitError> {
    let mut rows = Rows::new("longitudinal balance", "N", 1);
    let mut first = 0;
    for log in logs {
        let clusters = log.balance.last().map_or(0, |last| last.cluster + 1);
        for balance in &log.balance {
            rows.push(&[balance.weight], balance.missing, first + balance.cluster);
        }
        first += clusters;
    }
    if rows.is_empty() {
        session.give_up(ROLLING, "needs torques and wheel speeds of all driven wheels");
        return Ok(());
    }
    let regression = Regression {
        name: "longitudinal balance".to_owned(),
        unknowns: vec![Unknown::within(ROLLING, ROLLING_RANGE.0, ROLLING_RANGE.1)],
        groups: vec![rows],
        constraints: Vec::new(),
    };
    if let Some(fit) = session.solve(&regression, &[ROLLING])? {
        // zero is a natural value
        let limits = Limits { absolute_error: Some(0.003), ..Limits::default() };
        let offsets = || logs.iter().flat_map(|log| &log.beyond).filter(|offset| offset.channel == "accel_x");
        let felt = offsets().count() == logs.len();
        let bias = task.quality("accel_x").bias.hypot(Offset::size(offsets()));
        let systematic_std = if felt || task.exact { 0.001 } else { FLOOR_SLOPE };
        let judgement = Judgement { limits, systematic_std, ..Judgement::default() };
        session.estimate_judged(ROLLING, fit, judgement, |theta| theta[0]);
        let (value, std) = (session.value(ROLLING), session.std_error(ROLLING));
        let std = std.unwrap_or(0.0).hypot(bias / GRAVITY);
        // Beyond that it stays what it is: below its range, where it contradicts the model.
        let unseen = value.is_some_and(|value| value <= 0.0 && value > -2.0 * std);
        if session.decide("the rolling resistance is too small to be seen", unseen) {
            session.retract(ROLLING, "the resistance is too small to be told from that of a biased accelerometer");
        }
    }
    Ok(())
}

fn validate(task: &Task) -> Vec<Prediction> {
    let Ok((p, logs)) = read(task) else { return Vec::new() };
    let tires = Tires::new(&p.tire.front, &p.tire.rear);
    let mut all = Vec::new();
    for (log, source) in logs.iter().zip(task.logs) {
        for (axle, which) in AXLES.iter().enumerate() {
            if !(0..4).any(|parameter| task.wants(&name(axle, parameter))) || log.instants.len() < LEAST_INSTANTS {
                continue;
            }
            let trace = Trace {
                name: format!("{which} axle lateral force"),
                unit: "N".to_owned(),
                log: source.source.clone(),
                time: log.instants.iter().map(|instant| instant.time).collect(),
                measured: log.instants.iter().map(|instant| instant.axle_force[axle]).collect(),
                predicted: log
                    .instants
                    .iter()
                    .map(|instant| axle_force(&tires, instant, axle, p.tire.combined))
                    .collect(),
            };
            all.push(Prediction::new(trace, 2));
        }
    }
    all
}
