//! Prediction of the held-out part: drive force, pitch and roll moments, and the simulated pitch.

use super::rows::{self, Body, Windows};
use super::signals::{self, Has};
use super::sources::{Look, Sources, Windowed};
use super::sway::{self, Passive};
use super::{passive, use_accelerometer};
use crate::assess::validation::Parts;
use crate::problem::{Prediction, Task};
use crate::progress::Progress;
use crate::result::Trace;

pub(super) fn validate(task: &Task) -> Vec<Prediction> {
    let Ok(mut logs) = Sources::new(task, false) else { return Vec::new() };
    let body = signals::body(task.known);
    let hip = passive(task.known);
    logs.sway_by(&body, &hip);
    let accelerometer =
        (task.wants(super::ROBOT_MASS) || task.wants(super::HUMAN_MASS)) && use_accelerometer(task, &logs);
    let (mut all, mut parts) = (Vec::new(), Vec::new());
    let done = logs.each(Look::All, task.progress, |log, progress| {
        progress.reach(0.0);
        let found = predictions(task, log, logs.has(log), (&body, &hip), accelerometer);
        let (place, count) = log.block.place;
        if count == 1 {
            all.extend(found);
            return;
        }
        gather(&mut parts, found, if task.brief { count } else { 0 });
        if place + 1 == count {
            all.extend(parts.drain(..).map(Parts::finish));
        }
    });
    if done.is_ok() { all } else { Vec::new() }
}
/// The predictions of a log, or of a block of it.
fn predictions(
    task: &Task,
    log: &Windowed,
    has: &Has,
    (body, hip): (&Body, &Passive),
    accelerometer: bool,
) -> Vec<Prediction> {
    let source = task.logs[log.block.log].source.as_str();
    let mut all = Vec::new();
    if has.tilt && body.j > 0.0 && !task.wanted_of(&super::PITCH).is_empty() {
        all.extend(moment("pitch moment", source, log, body, hip, rows::pitch_rows));
        all.extend(simulated_pitch(source, log, body, hip));
    }
    if has.roll && body.j > 0.0 && !task.wanted_of(&super::ROLL).is_empty() {
        all.extend(moment("roll moment", source, log, body, &super::side(task.known), rows::roll_rows));
    }
    all.extend(force(source, log, body, hip, accelerometer));
    all
}

/// Adds the predictions of a block to those of the blocks of its log before it; of so many blocks, or of 0 if all values are
/// to be kept.
fn gather(parts: &mut Vec<Parts>, found: Vec<Prediction>, blocks: usize) {
    for prediction in found {
        match parts.iter_mut().find(|part| part.is_of(&prediction)) {
            Some(part) => part.add(&prediction.trace),
            None => parts.push(Parts::new(prediction, blocks)),
        }
    }
}

/// An empty trace with room for so many values.
fn trace(name: &str, unit: &str, log: &str, room: usize) -> Trace {
    Trace {
        name: name.to_owned(),
        unit: unit.to_owned(),
        log: log.to_owned(),
        time: Vec::with_capacity(room),
        measured: Vec::with_capacity(room),
        predicted: Vec::with_capacity(room),
    }
}

fn prediction(trace: Trace, independent: usize) -> Option<Prediction> {
    (trace.time.len() > 10).then_some(Prediction::new(trace, independent))
}

/// Window means of the drive force, measured and as the force balance predicts it, N.
fn force(source: &str, log: &Windowed, body: &Body, hip: &Passive, accelerometer: bool) -> Option<Prediction> {
    let windows = log.sway(Progress::none());
    let starts: Vec<usize> = windows.starts().collect();
    let mut trace = trace("drive force", "N", source, starts.len());
    let integrals = rows::longitudinal(&windows, body, accelerometer, body.drag_area != 0.0, &starts);
    for (start, l) in starts.into_iter().zip(integrals) {
        let balance = body.total_mass() * (l.inertial + hip.rolling * l.rolling)
            + body.human_mass * l.sway
            + body.rotating_mass * l.speed_rate
            + body.drag_area * l.drag;
        if (balance + l.force).is_finite() {
            trace.time.push(windows.middle(start));
            trace.measured.push(body.efficiency * l.force / l.one);
            trace.predicted.push(balance / l.one);
        }
    }
    prediction(trace, rows::OVERLAP)
}

/// Window means of the moment that spring and damper must give, N.m.
fn moment(
    name: &str,
    source: &str,
    log: &Windowed,
    body: &Body,
    joint: &Passive,
    rows: impl Fn(&Windows, &Body, &[usize]) -> Vec<rows::JointRow>,
) -> Option<Prediction> {
    let windows = log.sway(Progress::none());
    let one = windows.psi.integral(0, 0, |_| 1.0);
    let starts: Vec<usize> = windows.starts().collect();
    let mut trace = trace(name, "N.m", source, starts.len());
    for ((a, needed), start) in rows(&windows, body, &starts).into_iter().zip(starts) {
        let given = joint.stiffness * a[0] + joint.damping * a[1] + joint.stiffness * joint.rest * a[2];
        if (given + needed).is_finite() {
            trace.time.push(windows.middle(start));
            trace.measured.push(needed / one);
            trace.predicted.push(given / one);
        }
    }
    prediction(trace, rows::OVERLAP)
}

/// Pitch simulated open loop over pieces of 10 s from the logged force, compared with the measured one.
fn simulated_pitch(source: &str, log: &Windowed, body: &Body, hip: &Passive) -> Option<Prediction> {
    // What the last windows of a block reach to is simulated in the next one.
    let own =
        (log.block.own < log.block.samples.len()).then(|| log.signals.cut(0..log.block.own.min(log.signals.len())));
    let signals = own.as_ref().unwrap_or(&log.signals);
    let samples = |seconds: f64| (seconds / signals.period).round() as usize;
    let mut ranges = sway::segments(signals, samples(4.0), samples(10.0), usize::MAX);
    ranges.retain(|range| {
        let at = range.start;
        range.len() > 1 && [&signals.speed, &signals.pitch, &signals.pitch_rate].iter().all(|of| !of[at].is_nan())
    });
    let mut trace = trace("tilt", "rad", source, 0);
    trace.predicted = sway::pitches(signals, &ranges, body, hip);
    for column in [&mut trace.time, &mut trace.measured] {
        column.reserve_exact(trace.predicted.len());
    }
    for range in ranges {
        trace.measured.extend_from_slice(&signals.pitch[range.clone()]);
        trace.time.extend(range.map(|i| signals.start + signals.period * i as f64));
    }
    prediction(trace, 1)
}
