//! Output-error refinement of stiffness, damping, rest angle and rolling resistance.
//!
//! The planar model runs from the logged force and yaw rate; its speed and pitch are compared with the
//! measured ones. Every segment of the logs has its own initial speed, pitch and pitch rate. There is no process
//! noise in the simulation, so a log with coughs or other active movement is better left to the
//! weak-form fit.

use super::rows::{Body, Signals};
use super::sway::{Passive, simulate};
use crate::progress::Progress;
use crate::solve::{Loss, Scale, Smooth, SmoothGroup, Solution, SolveError, Trust, Unknown, refine as minimise};
use std::ops::Range;

/// A part of a log that is simulated.
#[derive(Clone, Debug)]
pub struct Segment<'a> {
    /// The signals of the log.
    pub signals: &'a Signals,
    /// Its samples.
    pub samples: Range<usize>,
}

/// What the refinement compares and how it weighs it.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// Standard deviation of the measured speed, m/s.
    pub speed_std: f64,
    /// Standard deviation of the measured pitch, rad; `None` compares the speed only and keeps the
    /// rest angle, which wheels cannot feel.
    pub pitch_std: Option<f64>,
    /// Whether the drive efficiency is sought too. A speed alone tells a few percent of force
    /// apart from sway only if it is.
    pub efficiency: bool,
    /// The loss.
    pub loss: Loss,
    /// Whether to subtract the bias that roll while turning causes.
    pub correct: bool,
    /// Whether the profiles of stiffness, damping and rest angle are wanted.
    pub profiled: [bool; 3],
    /// Where to tell how far it is.
    pub progress: &'a Progress,
}

/// What was refined.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Stiffness, damping, rolling coefficient, then the rest angle and the drive efficiency if they were
    /// sought, then the initial states of the segments.
    pub solution: Solution,
    /// The passive joint and the floor found.
    pub passive: Passive,
    /// The drive efficiency found or kept.
    pub efficiency: f64,
}

/// Unknowns per segment: `v, phi, phi'` at its first sample.
const INITIAL: usize = 3;

/// Refines from a start.
pub fn refine(segments: &[Segment], body: &Body, start: &Passive, setup: &Setup) -> Result<Refined, SolveError> {
    let mut unknowns =
        vec![Unknown::within("k_y", 0.0, 5000.0), Unknown::within("c_y", 0.0, 500.0), Unknown::within("f", 0.0, 0.1)];
    let mut theta = vec![start.stiffness, start.damping, start.rolling];
    let mut typical = vec![200.0, 20.0, 0.01];
    let mut more = |name: &str, value: f64, range: (f64, f64), size: f64| {
        unknowns.push(Unknown::within(name, range.0, range.1));
        theta.push(value);
        typical.push(size);
        theta.len() - 1
    };
    let rest_index = setup.pitch_std.map(|_| more("phi_y0", start.rest, (-0.5, 0.5), 0.05));
    let efficiency_index = setup.efficiency.then(|| more("eta", body.efficiency, (0.5, 1.5), 0.05));
    let shared = 3 + usize::from(rest_index.is_some()) + usize::from(efficiency_index.is_some());
    for segment in segments {
        let first = segment.samples.start;
        let pitch = segment.signals.pitch.get(first).copied().filter(|p| p.is_finite()).unwrap_or(start.rest);
        for (name, value, reach, size) in
            [("v_0", segment.signals.speed[first], 10.0, 0.05), ("phi_i", pitch, 1.0, 0.1), ("phid_i", 0.0, 5.0, 0.5)]
        {
            more(name, value, (value - reach, value + reach), size);
        }
    }
    let read = |theta: &[f64]| {
        let rest = rest_index.map_or(start.rest, |index| theta[index]);
        let passive = Passive { stiffness: theta[0], damping: theta[1], rolling: theta[2], rest };
        (passive, efficiency_index.map_or(body.efficiency, |index| theta[index]))
    };
    // Half of 100 Hz says as much about a 1 Hz sway at half the price.
    let stride = |signals: &Signals| ((0.02 / signals.period).round() as usize).max(1);
    let compare = |theta: &[f64], turning: bool| -> Vec<Vec<f64>> {
        let (passive, efficiency) = read(theta);
        let body = Body { efficiency, ..*body };
        let (mut of_speed, mut of_pitch) = (Vec::new(), Vec::new());
        for (index, segment) in segments.iter().enumerate() {
            let at = shared + INITIAL * index;
            let initial = [theta[at], theta[at + 1], theta[at + 2]];
            let (signals, first, stride) = (segment.signals, segment.samples.start, stride(segment.signals));
            let aside = |i: usize| if turning { signals.aside(i) } else { 0.0 };
            simulate(signals, segment.samples.clone(), &body, &passive, initial, aside, |i, x| {
                if (i - first) % stride == 0 {
                    of_speed.push(signals.speed[i] - x[0]);
                    if setup.pitch_std.is_some() {
                        of_pitch.push(signals.pitch.get(i).map_or(f64::NAN, |phi| phi - x[1]));
                    }
                }
            });
        }
        if setup.pitch_std.is_some() { vec![of_speed, of_pitch] } else { vec![of_speed] }
    };
    let residuals = |theta: &[f64]| compare(theta, false);
    let with_turning = |theta: &[f64]| compare(theta, true);
    let turns = segments.iter().any(|segment| !segment.signals.turning[0].is_empty());
    let group = |name: &str, unit, std: f64| {
        let period = segments.first().map_or(0.01, |segment| segment.signals.period * stride(segment.signals) as f64);
        let cluster_rows = (1.0 / period).ceil() as usize;
        SmoothGroup { name: name.to_owned(), unit, scale: Scale::Known(std), cluster_rows }
    };
    let mut groups = vec![group("speed", "m/s", setup.speed_std)];
    groups.extend(setup.pitch_std.map(|std| group("tilt", "rad", std)));
    let smooth = Smooth {
        name: "output error".to_owned(),
        unknowns,
        start: theta,
        typical,
        groups,
        residuals: &residuals,
        constraints: Vec::new(),
        trust: Trust::default(),
        passes: 1,
        fuller: turns.then_some(&with_turning),
        correct: setup.correct,
        profiled: [Some(0), Some(1), rest_index]
            .into_iter()
            .zip(setup.profiled)
            .filter_map(|(index, wanted)| index.filter(|_| wanted))
            .collect(),
        progress: setup.progress.clone(),
    };
    let solution = minimise(&smooth, setup.loss)?;
    let (passive, efficiency) = read(&solution.theta);
    Ok(Refined { solution, passive, efficiency })
}
