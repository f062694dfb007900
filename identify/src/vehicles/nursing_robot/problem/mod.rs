//! The nursing robot with a seated person, and road vehicles.
//!
//! # What is fitted from which channels
//!
//! | parameter | needs | how |
//! |---|---|---|
//! | `human.*_pitch` | `tilt` | weak-form pitch rows; with `--refine` output error of speed and tilt |
//! | `human.rest_pitch_std` (`--only`) | `tilt` | standard error of `human.rest_pitch`, and that nobody sits down twice alike |
//! | `human.*_pitch_std`, `mass.rolling_uncertainty` | as their parameters | relative standard errors, and what one ride differs by from another |
//! | `human.*_pitch` | only wheels | rows from the wheels only to start, then output error of the speed; `rest_pitch` stays unknown (a kept lean makes no force) |
//! | `human.*_roll` | `roll` | weak-form roll rows; roll does not act on the wheels |
//! | `rolling.coefficient`, `robot.drive_efficiency` | the person's weight as `human.nominal_mass` | weak-form force balance |
//! | `robot.mass` or `human.nominal_mass`, with `rolling.coefficient` (`--only`) | the other mass, `robot.drive_efficiency` | the same rows with the mass unknown |
//! | `aero.drag_area` (`--only`, with `robot.mass` and `rolling.coefficient`) | fast and slow driving | the same rows with the drag unknown |
//!
//! A mass fitted alone (`--only robot.mass`) takes the rolling coefficient as known; its interval considers
//! that the coefficient may be 20 % off (one standard deviation).
//!
//! The pitch and force rows follow the planar equations. Roll while turning adds to them
//! ([`Windows::turning`](rows::Windows)). With the measured roll this and the noise in the regressors make the
//! bias that widens the intervals and that `--correct` subtracts; without a `roll` channel a passive person's
//! roll is a guess that only widens.
//!
//! The person's mass, size and swaying share, the robot and the air drag are known parameters. With an
//! `accel_x` channel the mass fits use the specific force, so slopes cancel (unless
//! `mass.use_accelerometer` is set to false); a constant accelerometer bias is then part of
//! `rolling.coefficient` (0.01 m/s2 make 0.001), in the fit as in the online estimator. What it differs by from the change of
//! the speed, in the mean over a log, is a bias or a slope: the interval contains that much.

pub(super) mod lateness;
mod noise;
pub mod refine;
pub mod rows;
pub mod signals;
pub(super) mod sources;
pub mod sway;
mod validate;

use crate::assess::Limits;
use crate::log::Log;
use crate::problem::noise::noise_of;
use crate::problem::weak_form::ModulatingFunction;
use crate::problem::{FitError, Fitted, Judgement, Known, Offset, Problem, Session, Target, Task};
use crate::progress::Progress;
use crate::solve::{Regression, Rows, Unknown};
use noise::Sensors;
use refine::{Segment, Setup};
use rows::{Body, Drive, GRAVITY, Windows};
use sources::{Look, Sources, Windowed};
use std::ops::Range;
use sway::Passive;
use wheelstate::Variables;
use wheelstate::estimator::nursing_robot::Parameters;

/// The problem.
pub const PROBLEM: Problem = Problem { targets, outliers: &[], estimate, validate: validate::validate };

const PITCH: [&str; 3] = ["human.stiffness_pitch", "human.damping_pitch", "human.rest_pitch"];
const REST_STD: &str = "human.rest_pitch_std";
/// Relative errors that the estimator counts, and what their parameters differ by from one ride to the next, as a person is tense
/// or at ease and tyres are cold or warm (one standard deviation).
const WIDTHS: [(&str, &str, f64); 3] = [
    (PITCH[0], "human.stiffness_pitch_std", 0.1),
    (PITCH[1], "human.damping_pitch_std", 0.2),
    (ROLLING, ROLLING_STD, 0.1),
];
const ROLL: [&str; 3] = ["human.stiffness_roll", "human.damping_roll", "human.rest_roll"];
const ROLLING: &str = "rolling.coefficient";
const ROLLING_STD: &str = "mass.rolling_uncertainty";
const EFFICIENCY: &str = "robot.drive_efficiency";
const ROBOT_MASS: &str = "robot.mass";
const HUMAN_MASS: &str = "human.nominal_mass";
const DRAG: &str = "aero.drag_area";

/// Standard deviation of an accelerometer's constant bias, m/s2: what calibrated sensors keep.
const ACCELEROMETER_BIAS: f64 = 0.01;

/// How differently a person sits from one ride to the next, standard deviation in rad: an assumption.
const SEATING: f64 = 0.015;

/// Slope of a floor that is taken as level, rad: buildings keep 5 mm in a metre. It is part of the rolling coefficient.
const FLOOR_SLOPE: f64 = 0.005;
/// Largest standard error of a rolling coefficient: what it is used for is the force on a floor as level as that.
const ROLLING_LIMIT: f64 = 0.01;

/// Windows that overlap where only differences between fits are looked for.
const COARSE_OVERLAP: usize = 3;

fn targets(_: &[Log]) -> Vec<Target> {
    let declared = Parameters::declare();
    let usual = PITCH.iter().chain(&ROLL).chain(&[ROLLING, EFFICIENCY]).map(|name| (*name, true));
    let others = [ROBOT_MASS, HUMAN_MASS, REST_STD, DRAG].map(|name| (name, false));
    let widths = WIDTHS.map(|(_, name, _)| Target::declared(&declared, name, true).optional());
    usual.chain(others).map(|(name, usual)| Target::declared(&declared, name, usual)).chain(widths).collect()
}

/// Length of the windows in seconds, and the power of the modulating function: of the sway, and without a tilt sensor.
const SWAY: (f64, i32) = (1.2, 4);
const WHEELS_ONLY: (f64, i32) = (2.0, 6);

fn modulating_function(period: f64, (seconds, power): (f64, i32)) -> ModulatingFunction {
    ModulatingFunction::polynomial(ModulatingFunction::steps(seconds, period), period, power)
}

pub(super) fn passive(known: &Known) -> Passive {
    Passive {
        stiffness: known.get(PITCH[0]),
        damping: known.get(PITCH[1]),
        rolling: known.get(ROLLING),
        rest: known.get(PITCH[2]),
    }
}

/// Hip of the roll; rolling resistance is the same.
pub(super) fn side(known: &Known) -> Passive {
    Passive { stiffness: known.get(ROLL[0]), damping: known.get(ROLL[1]), rest: known.get(ROLL[2]), ..passive(known) }
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    // What roll adds while turning is part of biases only.
    let mut logs = Sources::new(task, session.weighs_noise())?;
    let body = signals::body(task.known);
    if task.wants(ROBOT_MASS) || task.wants(HUMAN_MASS) || task.wants(DRAG) {
        check_mass_request(task)?;
    }
    let seated = body.j > 0.0;
    let mut hip = passive(task.known);
    let tilt = logs.some_has(|log| log.tilt);
    let refining = task.refine || !tilt;
    // Shares of the work: pitch up to the first, output error to the second, roll to the third.
    let [first, second, third] = if refining { [0.1, 0.8, 0.9] } else { [0.4, 0.4, 0.7] };
    let part = |from: f64, to: f64| task.progress.part(from..to);
    let wants = |names: &[&str]| seated && !task.wanted_of(names).is_empty();
    let sought = [wants(&PITCH) && tilt, wants(&ROLL) && logs.some_has(|log| log.roll)];
    let [pitch_rows, roll_rows] = joint_rows(&logs, &body, sought, &part(0.0, first), session.weighs_noise())?;
    if wants(&PITCH) {
        let found =
            if tilt { pitch(pitch_rows, session)? } else { wheels_only(&logs, &body, &part(0.0, first), session)? };
        hip = found.unwrap_or(hip);
        if refining {
            session.progress = part(first, second);
            hip = output_error(task, &logs, &body, &hip, tilt, session)?;
        }
    }
    if wants(&ROLL) {
        roll(roll_rows, sought[1], session)?;
    }
    for name in PITCH.iter().chain(&ROLL).filter(|_| !seated) {
        session.give_up(name, "human.nominal_mass or human.swaying_fraction is 0, so nothing sways");
    }
    logs.sway_by(&body, &hip);
    if task.wants(ROBOT_MASS) || task.wants(HUMAN_MASS) {
        mass(task, &logs, &body, &part(third, 1.0), session)
    } else if task.wants(ROLLING) || task.wants(EFFICIENCY) {
        force_balance(task, &logs, &body, &part(third, 1.0), session)
    } else {
        let mut slopes = Slopes::new(task);
        logs.each(Look::Drive, &Progress::none(), |log, _| slopes.add(log))?;
        slopes.tell(session);
        Ok(())
    }
}

/// How much larger the specific force is in the mean of each log than the change of the speed says: a slope, or a biased
/// accelerometer.
struct Slopes<'a> {
    task: &'a Task<'a>,
    /// Of the windows of a log so far, with the numbers of their clusters.
    values: Vec<(u32, f64)>,
    found: Vec<Offset>,
}

impl<'a> Slopes<'a> {
    fn new(task: &'a Task) -> Self {
        Self { task, values: Vec::new(), found: Vec::new() }
    }

    /// Adds a log, or a block of it. What differs between two fits is no news of the sensors.
    fn add(&mut self, log: &Windowed) {
        if self.task.coarse {
            return;
        }
        let windows = log.sway(Progress::none());
        let before = self.values.len();
        let of = |(k, slope)| (((before + k) / windows.cluster) as u32, slope);
        self.values.extend(slopes(&windows).into_iter().enumerate().map(of));
        let (place, count) = log.block.place;
        if place + 1 == count {
            let offset = Offset::of_clusters(&self.values, "accel_x", "m/s2", "the change of the speed says");
            let source = &self.task.logs[log.block.log].source;
            self.found.extend(offset.map(|offset| Offset { log: source.clone(), ..offset }));
            self.values.clear();
        }
    }

    fn tell(self, session: &mut Session) {
        self.found.into_iter().for_each(|offset| session.offset(offset));
    }
}

/// The same of each window; of none if there is no specific force.
fn slopes(windows: &Windows) -> Vec<f64> {
    let s = windows.signals;
    if s.accel.is_empty() {
        return Vec::new();
    }
    let starts: Vec<usize> = windows.starts().collect();
    let (accels, speeds) = (s.accel.as_slice(), s.speed.as_slice());
    let terms = |samples: Range<usize>| samples.map(|i| [accels[i], speeds[i]]).collect();
    rows::each(windows, &starts, terms, |terms, at| {
        let of = |[psi, slope, _]: [f64; 3], [accel, speed]: &[f64; 2]| [psi * accel, slope * speed, psi];
        let [accel, speed, one] = terms.integrals(windows.psi, at, of);
        (accel + speed) / one
    })
}

fn check_mass_request(task: &Task) -> Result<(), FitError> {
    let refuse = |why: &str| Err(FitError::Request(format!("--only: {why}")));
    if task.wants(ROBOT_MASS) && task.wants(HUMAN_MASS) {
        return refuse("robot.mass and human.nominal_mass cannot both be fitted: only their sum accelerates");
    }
    if task.wants(DRAG) && !(task.wants(ROBOT_MASS) && task.wants(ROLLING)) {
        return refuse("aero.drag_area is fitted together with robot.mass and rolling.coefficient");
    }
    if task.wants(EFFICIENCY) {
        return refuse("robot.drive_efficiency cannot be fitted together with a mass: it scales with it");
    }
    Ok(())
}

fn regression(name: &str, unknowns: Vec<Unknown>, rows: Rows) -> Regression {
    Regression { name: name.to_owned(), unknowns, groups: vec![rows], constraints: Vec::new() }
}

/// Spring and damper: `[k, c, k phi_0]` to three parameters.
fn passive_joint(session: &mut Session, fit: Fitted, names: [&str; 3]) {
    session.estimate(names[0], fit, |x| x[0]);
    session.estimate(names[1], fit, |x| x[1]);
    session.estimate_judged(names[2], fit, angle(), |x| x[2] / x[0]);
}

/// How far what a solution gave may be from that: by the standard errors, and from ride to ride.
fn widths(session: &mut Session, fit: Fitted, of: &[&str]) {
    for (from, width, other) in WIDTHS.into_iter().filter(|(from, ..)| of.contains(from)) {
        match session.value(from).zip(session.std_error(from)) {
            Some((value, std)) if std < value => session.estimate(width, fit, move |_| (std / value).hypot(other)),
            _ => session.give_up(width, "it goes with the value, which is not identified"),
        }
    }
}

/// The same of the rolling coefficient, without the slope that the floor may have: the estimator takes its floor as level.
fn rolling_width(session: &mut Session, fit: Fitted, of: impl Fn(&[f64]) -> f64 + 'static) {
    session.estimate(ROLLING, fit, of);
    widths(session, fit, &[ROLLING]);
}

/// How far the posture may be from the one that was found: by the standard error of that, and because nobody sits down
/// twice alike.
fn posture(session: &mut Session, fit: Fitted) {
    match session.std_error(PITCH[2]) {
        Some(std) => session.estimate(REST_STD, fit, move |_| std.hypot(SEATING)),
        None => session.give_up(REST_STD, "it goes with human.rest_pitch, which is not identified"),
    }
}

/// An angle may well be zero: it is judged by its absolute error.
fn angle() -> Judgement {
    Judgement { limits: Limits { absolute_error: Some(0.02), ..Limits::default() }, ..Judgement::default() }
}

/// A rolling coefficient holds what slope the floor has, or what bias the accelerometer.
fn level_floor(systematic_std: f64) -> Judgement {
    let limits = Limits { absolute_error: Some(ROLLING_LIMIT), ..Limits::default() };
    Judgement { limits, systematic_std, ..Judgement::default() }
}

fn spring() -> Vec<Unknown> {
    vec![Unknown::within("k", 0.0, 5000.0), Unknown::within("c", 0.0, 500.0), Unknown::free("k phi_0")]
}

/// The rows of the joints that are sought, pitch and roll, and the noise in them if that is weighed.
fn joint_rows(
    logs: &Sources,
    body: &Body,
    [pitch, roll]: [bool; 2],
    progress: &Progress,
    noisy: bool,
) -> Result<[Rows; 2], FitError> {
    let mut rows = ["pitch moment", "roll moment"].map(|name| Rows::new(name, "N.m.s", 3));
    let mut sensors = [Sensors::default(), Sensors::default()];
    if !pitch && !roll {
        return Ok(rows);
    }
    logs.each(Look::Joints, progress, |log, progress| {
        if pitch && !log.signals.pitch.is_empty() {
            rows::pitch(&mut rows[0], &log.sway(progress.part(0.0..0.5)), body);
        }
        if roll && !log.signals.roll.is_empty() {
            rows::roll(&mut rows[1], &log.sway(progress.part(0.5..1.0)), body);
        }
        if noisy && pitch {
            sensors[0].add(log, noise::pitch(log, body));
        }
        if noisy && roll {
            sensors[1].add(log, noise::roll(log, body));
        }
    })?;
    rows.iter_mut().zip(sensors).for_each(|(rows, sensors)| sensors.tell(rows));
    Ok(rows)
}

fn pitch(rows: Rows, session: &mut Session) -> Result<Option<Passive>, FitError> {
    let fit = session.solve(&regression("pitch", spring(), rows), &PITCH)?;
    let Some(fit) = fit else { return Ok(None) };
    passive_joint(session, fit, PITCH);
    widths(session, fit, &PITCH);
    posture(session, fit);
    let theta = &session.solution(fit).theta;
    let rolling = session.value(ROLLING).unwrap_or(0.015);
    Ok(Some(Passive { stiffness: theta[0], damping: theta[1], rest: theta[2] / theta[0].max(1.0), rolling }))
}

fn roll(rows: Rows, measured: bool, session: &mut Session) -> Result<(), FitError> {
    if !measured {
        let reason = "the logs have no roll channel, and roll does not act on the wheels";
        ROLL.iter().for_each(|name| session.give_up(name, reason));
        return Ok(());
    }
    if let Some(fit) = session.solve(&regression("roll", spring(), rows), &ROLL)? {
        passive_joint(session, fit, ROLL);
    }
    Ok(())
}

/// A start for the output error from force and speed alone.
fn wheels_only(
    logs: &Sources,
    body: &Body,
    progress: &Progress,
    session: &mut Session,
) -> Result<Option<Passive>, FitError> {
    let mut all = Rows::new("wheels only", "N2.s3", 3);
    logs.each(Look::All, progress, |log, progress| {
        let psi = modulating_function(log.signals.period, WHEELS_ONLY);
        rows::wheels_only(&mut all, &log.windows(&psi, progress), body);
    })?;
    let toppling = body.b * GRAVITY;
    let unknowns = vec![
        Unknown::within("c", 0.0, 500.0),
        Unknown::within("k - b g", 0.0, 5000.0 - toppling),
        Unknown::free("(k - b g) f M g"),
    ];
    let Some(fit) = session.solve(&regression("wheels only", unknowns, all), &PITCH)? else { return Ok(None) };
    let theta = &session.solution(fit).theta;
    let rolling = theta[2] / (theta[1].max(1.0) * body.total_mass() * GRAVITY);
    Ok(Some(Passive {
        stiffness: theta[1].max(20.0) + toppling,
        damping: theta[0].clamp(5.0, 400.0),
        rest: 0.0,
        rolling: rolling.clamp(0.0, 0.1),
    }))
}

/// Output error; its estimates replace those of the weak form.
fn output_error(
    task: &Task,
    logs: &Sources,
    body: &Body,
    start: &Passive,
    tilt: bool,
    session: &mut Session,
) -> Result<Passive, FitError> {
    let mut cut = Vec::new();
    logs.each(Look::All, &Progress::none(), |log, _| {
        let samples = |seconds: f64| (seconds / log.signals.period).round() as usize;
        let most = log.block.share((8 / logs.logs()).max(1));
        let ranges = sway::segments(&log.signals, samples(4.0), samples(40.0), most);
        cut.extend(ranges.into_iter().map(|samples| log.signals.cut(samples)));
    })?;
    let segments: Vec<Segment> = cut.iter().map(|signals| Segment { signals, samples: 0..signals.len() }).collect();
    let start = Passive { rest: if tilt { start.rest } else { task.known.get(PITCH[2]) }, ..*start };
    if segments.is_empty() {
        let reason = "no 4 s of speed and torque without gaps to simulate";
        PITCH.iter().filter(|_| !tilt).for_each(|name| session.give_up(name, reason));
        return Ok(start);
    }
    let moves = |segment: &Segment| {
        let speed = &segment.signals.speed[segment.samples.clone()];
        let mean = speed.iter().sum::<f64>() / speed.len() as f64;
        let spread = (speed.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / speed.len() as f64).sqrt();
        spread > 5.0 * noise_of(speed)
    };
    if !tilt && !segments.iter().any(moves) {
        let reason = "the speed hardly changes beyond its noise, so the body does not sway";
        PITCH
            .into_iter()
            .chain(WIDTHS[..2].iter().map(|(_, name, _)| *name))
            .for_each(|name| session.retract(name, reason));
        return Ok(start);
    }
    let setup = Setup {
        speed_std: task.known.get("sway.measurement_std.speed"),
        pitch_std: tilt.then(|| task.known.get("sway.measurement_std.tilt")),
        efficiency: task.wants(EFFICIENCY),
        loss: session.loss(),
        correct: session.corrects() && segments.iter().all(|segment| !segment.signals.roll.is_empty()),
        profiled: PITCH.map(|name| session.profiles(name)),
        progress: &session.progress,
    };
    let refined = refine::refine(&segments, body, &start, &setup)?;
    let fit = session.keep(refined.solution);
    session.estimate(PITCH[0], fit, |x| x[0]);
    session.estimate(PITCH[1], fit, |x| x[1]);
    widths(session, fit, &PITCH);
    if tilt {
        session.estimate_judged(PITCH[2], fit, angle(), |x| x[3]);
        posture(session, fit);
    } else {
        session.give_up(PITCH[2], "the logs have no tilt channel, and wheels do not feel a kept lean");
    }
    Ok(refined.passive)
}

/// The longitudinal rows with the noise in them; tells what slopes they show.
fn drive(
    task: &Task,
    logs: &Sources,
    body: &Body,
    (unknowns, accelerometer): (Drive, bool),
    progress: &Progress,
    session: &mut Session,
) -> Result<Rows, FitError> {
    let mut all = Rows::new("force balance", "N.s", unknowns.unknowns());
    let (mut sensors, mut slopes) = (Sensors::default(), Slopes::new(task));
    logs.each(Look::Drive, progress, |log, progress| {
        rows::drive(&mut all, &log.sway(progress), body, unknowns, accelerometer);
        if session.weighs_noise() {
            sensors.add(log, noise::drive(log, body, unknowns, accelerometer));
        }
        slopes.add(log);
    })?;
    sensors.tell(&mut all);
    slopes.tell(session);
    Ok(all)
}

/// `[f, eta]`, or the one of them that is wanted if the user asked for it alone.
fn force_balance(
    task: &Task,
    logs: &Sources,
    body: &Body,
    progress: &Progress,
    session: &mut Session,
) -> Result<(), FitError> {
    let unknowns = if task.wants(EFFICIENCY) { Drive::RollingEfficiency } else { Drive::Rolling };
    let all = drive(task, logs, body, (unknowns, false), progress, session)?;
    let mut sought = vec![Unknown::within("f", 0.0, 0.1)];
    if unknowns == Drive::RollingEfficiency {
        sought.push(Unknown::within("eta", 0.5, 1.5));
    }
    let Some(fit) = session.solve(&regression("force balance", sought, all), &[ROLLING, EFFICIENCY])? else {
        return Ok(());
    };
    let floor = if task.exact { 0.0 } else { FLOOR_SLOPE };
    let slope = Offset::size(session.offsets().iter()) / GRAVITY;
    rolling_width(session, fit, |x| x[0]);
    session.estimate_judged(ROLLING, fit, level_floor(floor.hypot(slope)), |x| x[0]);
    if unknowns == Drive::RollingEfficiency {
        session.estimate(EFFICIENCY, fit, |x| x[1]);
    }
    Ok(())
}

/// `[f M, m]` with the robot's or the person's mass unknown.
fn mass(task: &Task, logs: &Sources, body: &Body, progress: &Progress, session: &mut Session) -> Result<(), FitError> {
    let (name, unknowns, other) = if task.wants(DRAG) {
        (ROBOT_MASS, Drive::RollingRobotDrag, body.human_mass)
    } else if task.wants(ROBOT_MASS) {
        (ROBOT_MASS, Drive::RollingRobot, body.human_mass)
    } else {
        (HUMAN_MASS, Drive::RollingLoad, body.robot_mass)
    };
    let accelerometer = use_accelerometer(task, logs);
    let all = drive(task, logs, body, (unknowns, accelerometer), progress, session)?;
    let mut sought = vec![Unknown::within("f M", 0.0, f64::INFINITY), Unknown::within("m", 0.0, 1e5)];
    if unknowns == Drive::RollingRobotDrag {
        sought.push(Unknown::within("CdA", 0.0, 100.0));
    }
    let parameters = [name, ROLLING, DRAG];
    if !task.wants(ROLLING) {
        return mass_alone(name, other, &all, task.known, session);
    }
    let fit = session.solve(&regression("force balance", sought, all), &parameters)?;
    let Some(fit) = fit else { return Ok(()) };
    session.estimate(name, fit, |x| x[1]);
    let systematic_std = match accelerometer {
        _ if task.exact => 0.0,
        true => ACCELEROMETER_BIAS / GRAVITY,
        false => FLOOR_SLOPE,
    };
    rolling_width(session, fit, move |x| x[0] / (x[1] + other));
    session.estimate_judged(ROLLING, fit, level_floor(systematic_std), move |x| x[0] / (x[1] + other));
    if unknowns == Drive::RollingRobotDrag {
        session.estimate(DRAG, fit, |x| x[2]);
    }
    if accelerometer {
        session.note(format!(
            "the specific force accel_x was used, so slopes cancel; a constant bias of the accelerometer is part of \
             {ROLLING} (its interval allows for {ACCELEROMETER_BIAS} m/s2)"
        ));
    }
    Ok(())
}

/// `m` with the rolling coefficient known, whose error is considered in the interval without being estimated.
fn mass_alone(name: &str, other: f64, all: &Rows, known: &Known, session: &mut Session) -> Result<(), FitError> {
    let rolling = known.get(ROLLING);
    // f M = f (m + other): [f M, m | y] becomes [m | y - f other f-regressor].
    let single = |f: f64| {
        let mut rows = Rows::new("force balance", "N.s", 1);
        for i in 0..all.len() {
            let row = all.row(i);
            rows.push(&[row[1] + f * row[0]], all.y[i] - f * other * row[0], all.cluster[i]);
        }
        rows.neglected.clone_from(&all.neglected);
        rows.guessed = all.guessed;
        let into = [[f, 1.0, 0.0], [-f * other, 0.0, 1.0]];
        if let Ok(noise) = <&[f64; 9]>::try_from(all.noise.as_slice()) {
            let entry = |a: &[f64; 3], b: &[f64; 3]| -> f64 { (0..9).map(|k| a[k / 3] * noise[k] * b[k % 3]).sum() };
            rows.noise = vec![
                entry(&into[0], &into[0]),
                entry(&into[0], &into[1]),
                entry(&into[1], &into[0]),
                entry(&into[1], &into[1]),
            ];
        }
        regression("force balance", vec![Unknown::within("m", 0.0, 1e5)], rows)
    };
    let Some(fit) = session.solve(&single(rolling), &[name])? else { return Ok(()) };
    let std = known.get(ROLLING_STD) * rolling;
    session.consider(fit, &single(rolling - std), &single(rolling + std))?;
    session.estimate(name, fit, |x| x[0]);
    session.note(format!(
        "{ROLLING} = {rolling} was taken as known; the interval of {name} allows for an error of {std:.2e} in it \
         (one standard deviation)"
    ));
    Ok(())
}

/// The accelerometer is used if there is one, unless the user says otherwise.
fn use_accelerometer(task: &Task, logs: &Sources) -> bool {
    let asked = task.known.get("mass.use_accelerometer") != 0.0;
    let present = logs.all_have(|log| log.accel);
    present && (asked || !task.known.is_set("mass.use_accelerometer"))
}
