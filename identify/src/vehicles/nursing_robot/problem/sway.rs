//! Simulation of the planar robot with a swaying person, and its refinement by output error.
//!
//! ```text
//! [ Mt       b cos phi ] [ v'     ]   [ F - f M g tanh(v/v_s) + b (w^2 + phi'^2) sin phi           ]
//! [ b cos phi        J ] [ phi''  ] = [ b g sin phi - k (phi - phi_0) - c phi' + J w^2 sin cos phi ]
//! ```
//!
//! One Runge-Kutta step per sample, force between two samples their mean, yaw rate held.

use super::rows::{Body, GRAVITY, Signals};
use crate::problem::angles;
use multiversion::multiversion;
use nalgebra::SMatrix;
use std::ops::Range;
use wheelstate::filter::discretise::runge_kutta;

/// Hip and floor.
#[derive(Clone, Copy, Debug)]
pub struct Passive {
    /// Stiffness, N.m/rad.
    pub stiffness: f64,
    /// Damping, N.m.s/rad.
    pub damping: f64,
    /// Rolling resistance.
    pub rolling: f64,
    /// Rest angle, rad.
    pub rest: f64,
}

/// Speed, pitch and pitch rate.
pub type State = [f64; 3];

/// States of several simulations, a row each.
type States<const N: usize> = SMatrix<f64, N, 3>;

/// What moves each of several simulations over a step: force, yaw rate and what roll while turning adds.
#[derive(Clone, Copy)]
struct Inputs<const N: usize> {
    force: [f64; N],
    yaw_rate: [f64; N],
    aside: [f64; N],
}

#[inline(always)]
fn rate<const N: usize>(body: &Body, passive: &Passive, x: &States<N>, inputs: &Inputs<N>) -> States<N> {
    let [speeds, pitches, pitch_rates] = &x.data.0;
    let (sines, cosines) = angles::few(pitches);
    let senses = speeds.map(|v| sense(v / body.smoothing_speed));
    let mt = body.effective_mass();
    let mut rates = [[0.0; N]; 3];
    for k in 0..N {
        let (v, phi, phi_dot, sin, cos) = (speeds[k], pitches[k], pitch_rates[k], sines[k], cosines[k]);
        let (aside, w2) = (inputs.aside[k], inputs.yaw_rate[k] * inputs.yaw_rate[k]);
        let resist = passive.rolling * body.total_mass() * GRAVITY * senses[k]
            + 0.5 * body.air_density * body.drag_area * v * v.abs();
        let r1 = inputs.force[k] - resist + body.b * ((w2 + phi_dot * phi_dot) * sin - aside);
        let r2 = body.b * GRAVITY * sin - passive.stiffness * (phi - passive.rest) - passive.damping * phi_dot
            + body.j * (w2 * sin * cos - aside);
        let coupling = body.b * cos;
        let det = mt * body.j - coupling * coupling;
        rates[0][k] = (body.j * r1 - coupling * r2) / det;
        rates[1][k] = phi_dot;
        rates[2][k] = (mt * r2 - coupling * r1) / det;
        if body.j == 0.0 {
            (rates[0][k], rates[1][k], rates[2][k]) = (r1 / mt, 0.0, 0.0);
        }
    }
    rates.into()
}

/// `tanh`, which is 1 but for less than the last digit well before 22.
#[inline(always)]
fn sense(x: f64) -> f64 {
    if x.abs() > 22.0 { 1.0_f64.copysign(x) } else { x.tanh() }
}

/// One step of several simulations side by side.
#[multiversion(targets("x86_64+avx+avx2"))]
fn advance<const N: usize>(body: &Body, passive: &Passive, x: &States<N>, h: f64, inputs: &Inputs<N>) -> States<N> {
    runge_kutta(x, h, |x| rate(body, passive, x, inputs))
}

/// Simulates the samples of a range from a state at its first one; calls `each` with every sample
/// and its state, the first included. `aside` is what roll while turning adds over the step to a sample
/// ([`Signals::aside`]); 0 for the planar model.
pub fn simulate(
    signals: &Signals,
    range: Range<usize>,
    body: &Body,
    passive: &Passive,
    start: State,
    aside: impl Fn(usize) -> f64,
    mut each: impl FnMut(usize, &State),
) {
    let mut x = start;
    each(range.start, &x);
    for i in range.start + 1..range.end {
        let force = 0.5 * body.efficiency * (signals.force[i - 1] + signals.force[i]);
        let inputs = Inputs { force: [force], yaw_rate: [signals.yaw_rate[i]], aside: [aside(i)] };
        x = advance(body, passive, &States::<1>::from(x), signals.period, &inputs).into();
        each(i, &x);
    }
}

/// Simulations that are worked out side by side.
const LANES: usize = 8;

/// The pitch at each sample of each range of two samples or more, one range after the other, simulated by the planar model
/// from what was measured at the first one.
pub fn pitches(signals: &Signals, ranges: &[Range<usize>], body: &Body, passive: &Passive) -> Vec<f64> {
    let mut all = Vec::with_capacity(ranges.iter().map(ExactSizeIterator::len).sum());
    for ranges in ranges.chunks(LANES) {
        // Where there are fewer ranges than lanes the last one is simulated again; what is beyond the end of one is not used.
        let lanes: [&Range<usize>; LANES] = std::array::from_fn(|k| &ranges[k.min(ranges.len() - 1)]);
        let mut places = [0; LANES];
        for (k, range) in ranges.iter().enumerate() {
            places[k] = all.len();
            all.resize(all.len() + range.len(), 0.0);
        }
        let start = |of: &[f64]| lanes.map(|range| of[range.start]);
        let mut x: States<LANES> = [start(&signals.speed), start(&signals.pitch), start(&signals.pitch_rate)].into();
        let longest = ranges.iter().map(ExactSizeIterator::len).max().unwrap_or(0);
        for step in 0..longest {
            if step > 0 {
                let at = lanes.map(|range| (range.start + step).min(range.end - 1));
                let force = at.map(|i| 0.5 * body.efficiency * (signals.force[i - 1] + signals.force[i]));
                let inputs = Inputs { force, yaw_rate: at.map(|i| signals.yaw_rate[i]), aside: [0.0; LANES] };
                x = advance(body, passive, &x, signals.period, &inputs);
            }
            for (k, _) in ranges.iter().enumerate().filter(|(_, range)| step < range.len()) {
                all[places[k] + step] = x[(k, 1)];
            }
        }
    }
    all
}

/// Pitch of a person without tilt sensor, from the measured speed alone: the linear response
/// `J phi'' + c phi' + (k - b g) (phi - rest') = -b v'` with the acceleration held between samples.
/// Missing speeds count as unaccelerated.
pub fn pitch_from_speed(signals: &Signals, body: &Body, passive: &Passive) -> Vec<f64> {
    let v = &signals.speed;
    swing(signals, body, passive, |i| v[i - 1] - v[i]).0
}

/// Roll and roll rate of a person without roll sensor, from the measured speed and yaw rate: the linear
/// response `J phi'' + c phi' + (k - b g) (phi - rest') = b w v`. Missing samples count as straight drive.
pub fn roll_from_turning(signals: &Signals, body: &Body, passive: Passive) -> (Vec<f64>, Vec<f64>) {
    swing(signals, body, &passive, |i| signals.yaw_rate[i] * signals.speed[i] * signals.period)
}

/// Angle and rate of a passive upper body whose seat gains the speed `-kick(i)` over the step to sample `i`.
fn swing(signals: &Signals, body: &Body, passive: &Passive, kick: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
    let h = signals.period;
    let n = signals.len();
    let spring = passive.stiffness - body.b * GRAVITY;
    let (mut angle, mut rate) = (vec![0.0; n], vec![0.0; n]);
    if body.j == 0.0 || spring <= 0.0 {
        return (angle, rate);
    }
    let substeps = (h * (spring / body.j).sqrt() / 0.1).ceil().max(1.0);
    let dt = h / substeps;
    let (mut phi, mut phi_dot) = (0.0, 0.0);
    for i in 1..n {
        let kick = kick(i);
        // The gain of speed acts as an impulse on the rate; the rest is a free, damped swing.
        phi_dot += body.b / body.j * if kick.is_nan() { 0.0 } else { kick };
        for _ in 0..substeps as usize {
            phi_dot -= dt * (passive.damping * phi_dot + spring * phi) / body.j;
            phi += dt * phi_dot;
        }
        (angle[i], rate[i]) = (phi, phi_dot);
    }
    (angle, rate)
}

/// Ranges of samples that can be simulated: no missing force, speed or yaw rate, at least `shortest`
/// samples, cut into pieces of at most `longest`, at most `most` of them, spread over the log.
pub fn segments(signals: &Signals, shortest: usize, longest: usize, most: usize) -> Vec<Range<usize>> {
    let usable =
        |i: usize| signals.force[i].is_finite() && signals.speed[i].is_finite() && signals.yaw_rate[i].is_finite();
    let mut all = Vec::new();
    let mut i = 0;
    while i < signals.len() {
        let start = i;
        while i < signals.len() && usable(i) && i - start < longest {
            i += 1;
        }
        if i - start >= shortest {
            all.push(start..i);
        }
        if i == start {
            i += 1;
        }
    }
    if all.len() <= most {
        return all;
    }
    (0..most).map(|k| all[k * all.len() / most].clone()).collect()
}
