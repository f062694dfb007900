//! Prediction of the held-out part: drive force, pitch and roll moments, and the simulated pitch.

use super::rows::{self, Body, Windows};
use super::sway::{self, Passive};
use super::{Windowed, passive, signals, use_accelerometer, windowed};
use crate::problem::{Prediction, Task};
use crate::progress::Progress;
use crate::result::Trace;

pub(super) fn validate(task: &Task) -> Vec<Prediction> {
    let Ok(mut logs) = windowed(task) else { return Vec::new() };
    let body = signals::body(task.known);
    let hip = passive(task.known);
    let accelerometer =
        (task.wants(super::ROBOT_MASS) || task.wants(super::HUMAN_MASS)) && use_accelerometer(task, &logs);
    let mut all = Vec::new();
    let count = logs.len();
    for (index, (log, source)) in logs.iter_mut().zip(task.logs).enumerate() {
        task.progress.reach(index as f64 / count as f64);
        let measured_pitch = !log.signals.pitch.is_empty();
        if measured_pitch && body.j > 0.0 && !task.wanted_of(&super::PITCH).is_empty() {
            all.extend(moment("pitch moment", &source.source, log, &body, &hip, rows::pitch_rows));
            all.extend(simulated_pitch(&source.source, log, &body, &hip));
        }
        if !log.signals.roll.is_empty() && body.j > 0.0 && !task.wanted_of(&super::ROLL).is_empty() {
            all.extend(moment("roll moment", &source.source, log, &body, &super::side(task.known), rows::roll_rows));
        }
        if !measured_pitch && body.j > 0.0 {
            log.signals.pitch = sway::pitch_from_speed(&log.signals, &body, &hip).into();
        }
        all.extend(force(&source.source, log, &body, &hip, accelerometer));
    }
    all
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
    (trace.time.len() > 10).then_some(Prediction { trace, independent })
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
    let signals = &log.signals;
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
