//! Simulation of the planar robot with a swaying person, and its refinement by output error.
//!
//! ```text
//! [ Mt       b cos phi ] [ v'     ]   [ F - f M g tanh(v/v_s) + b (w^2 + phi'^2) sin phi           ]
//! [ b cos phi        J ] [ phi''  ] = [ b g sin phi - k (phi - phi_0) - c phi' + J w^2 sin cos phi ]
//! ```
//!
//! One Runge-Kutta step per sample, force between two samples their mean, yaw rate held.

use super::rows::{Body, GRAVITY, Signals};
use nalgebra::Vector3;
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

fn rate(body: &Body, passive: &Passive, x: &State, force: f64, yaw_rate: f64, aside: f64) -> State {
    let [v, phi, phi_dot] = *x;
    let (sin, cos) = phi.sin_cos();
    let (mt, w2) = (body.effective_mass(), yaw_rate * yaw_rate);
    let resist = passive.rolling * body.total_mass() * GRAVITY * (v / body.smoothing_speed).tanh()
        + 0.5 * body.air_density * body.drag_area * v * v.abs();
    let r1 = force - resist + body.b * ((w2 + phi_dot * phi_dot) * sin - aside);
    if body.j == 0.0 {
        return [r1 / mt, 0.0, 0.0];
    }
    let r2 = body.b * GRAVITY * sin - passive.stiffness * (phi - passive.rest) - passive.damping * phi_dot
        + body.j * (w2 * sin * cos - aside);
    let coupling = body.b * cos;
    let det = mt * body.j - coupling * coupling;
    [(body.j * r1 - coupling * r2) / det, phi_dot, (mt * r2 - coupling * r1) / det]
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
    let h = signals.period;
    let mut x = start;
    each(range.start, &x);
    for i in range.start + 1..range.end {
        let force = 0.5 * body.efficiency * (signals.force[i - 1] + signals.force[i]);
        let (w, aside) = (signals.yaw_rate[i], aside(i));
        let derivative = |x: &Vector3<f64>| Vector3::from(rate(body, passive, &(*x).into(), force, w, aside));
        x = runge_kutta(&Vector3::from(x), h, derivative).into();
        each(i, &x);
    }
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
