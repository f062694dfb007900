//! How late a measured angle of the body is against the motion of the seat that makes it sway.
//!
//! The weak rows hold the angle on all sides, with its noise, and to first order a delay `tau` is a damping there: one that
//! is late by `tau` takes `(k - b g) tau` for damping, and hardly anything else. Against a simulation it shows: with the
//! equation divided by the inertia,
//!
//! ```text
//! phi'' + d phi' + w2 (phi - phi_0) = q a + e,   measured: phi(t - tau), phi'(t - tau')
//! ```
//!
//! where `q = b/J`, the seat's acceleration `a` and the part `e` that turning adds come from the logs of speed, yaw rate and the
//! other angle, `d`, `w2`, `tau`, `tau'` and constants of angle and rate are free, and `q` is known as well as lengths are. All signals
//! pass one symmetric window before: it delays none, and no noise of the inputs is left at frequencies of which the sway has
//! nothing. Output error by Gauss and Newton (Ljung, System Identification, ch. 10.2), with the standard error of the sums over
//! blocks of the log (ibid., 9.6, for noise of any colour; Newey and West 1987 with blocks for lags).

use super::rows::{Body, GRAVITY, Signals};
use super::{PITCH, ROLL, signals};
use crate::check::window::Filter;
use crate::check::{self, Delay};
use crate::log::{Log, Series};
use crate::problem::outliers::hampel;
use crate::problem::quality;
use nalgebra::{SMatrix, SVector};
use std::f64::consts::SQRT_2;
use std::ops::Range;
use wheelstate::filter::discretise::{runge_kutta, substeps};

/// Channels of which the sway and what makes it are worked out.
const MOTION: [&str; 6] = ["speed", "yaw_rate", "tilt", "tilt_rate", "roll", "roll_rate"];
/// Time between two instants, s.
const STEP: f64 = 0.03;
/// Longest log that is looked at whole, and the parts of a longer one, in instants.
const ENOUGH: usize = 20_000;
const PARTS: usize = 4;
/// Time after which a sway that is not known is forgotten, in its time constants.
const FORGOTTEN: f64 = 4.0;
/// Damping ratio to start from; the lowest of which the start of a part is taken to be forgotten.
const RATIO: f64 = 0.3;
/// Longest delay that is looked for, s.
const REACH: f64 = 0.3;
/// Blocks whose errors are independent of each other, s, and their least number.
const BLOCK: f64 = 2.0;
const BLOCKS: usize = 12;
/// Standard deviation of `b/J`, relative: lengths are known to 2 %.
const LENGTHS: f64 = 0.03;
/// Share of the variance that the sway must explain.
const EXPLAINED: f64 = 0.5;
/// Standard errors from which a late roll may be a late yaw rate; rounds to find how late that is, and what may be left, s.
const DOUBTFUL: f64 = 1.0;
const ROUNDS: usize = 10;
const CLOSE: f64 = 1e-3;
/// Standard deviations, of the estimate and of the delays declared, beyond which it contradicts them: 95 % are within.
const CONTRADICTS: f64 = 1.96;
/// Iterations, and the change of the delay below which they have ended, s.
const ITERATIONS: usize = 30;
const SETTLED: f64 = 1e-4;

/// Unknowns: `w2`, `d`, `q`, how late angle and rate are, and their constants.
const N: usize = 7;
type Vector = SVector<f64, N>;
type Matrix = SMatrix<f64, N, N>;
/// Angle and rate, and what one more of `w2`, `d` and `q` makes of them.
type State = SMatrix<f64, 2, 4>;

/// How late tilt and roll are, where that contradicts what is declared of the sensors: both sides may be late.
pub fn delays(signals: &check::Signals) -> Vec<Delay> {
    let known = signals.known;
    let body = signals::body(known);
    let stride = ((STEP / signals.period).round() as usize).max(1);
    let parts: Vec<Signals> =
        parts(signals.log(), stride).iter().filter_map(|log| signals::signals(log, known).ok()).collect();
    let of = |angle: fn(&Signals) -> &Series, joint: &dyn Fn(&Signals) -> Joint, stiffness: &str| {
        let w2 = (known.get(stiffness) - body.b * GRAVITY) / body.j;
        let parts = parts.iter().filter(|part| !angle(part).is_empty());
        let parts: Vec<Part> = parts.map(|part| Part::new(&joint(part), part.period, stride)).collect();
        if parts.is_empty() || !(w2.is_finite() && w2 > 0.0) { None } else { lateness(&parts, &body, w2) }
    };
    let channels = |names: &[&str]| -> Vec<String> {
        names.iter().filter(|name| signals.has(name)).map(|name| (*name).to_owned()).collect()
    };
    let pitch = of(|part| &part.pitch, &pitch, PITCH[0]).map(|found| Delay {
        late: channels(found.late(&["tilt", "tilt_rate"])),
        against: channels(&["speed"]),
        delay: found.delay,
        std: found.std,
        what: "the sway that the acceleration makes; the fit takes a delay for damping",
    });
    let with_yaw = |late: f64| of(|part| &part.roll, &|part| roll(part, late), ROLL[0]);
    let roll = with_yaw(0.0).map(|found| {
        let angle = channels(found.late(&["roll", "roll_rate"]));
        let what = "the sway that turning makes; the fit takes a delay for damping";
        // The yaw rate stands beside the pitch, too: if it is the late one, a late roll explains only a part.
        let yaw = if found.delay.abs() > DOUBTFUL * found.std { late_yaw_rate(found, &with_yaw) } else { None };
        match yaw.filter(|yaw| yaw.cost < found.cost) {
            Some(Lateness { delay, std, .. }) => {
                Delay { late: channels(&["yaw_rate"]), against: angle, delay, std, what }
            }
            None => {
                let Lateness { delay, std, .. } = found;
                Delay { late: angle, against: channels(&["speed", "yaw_rate"]), delay, std, what }
            }
        }
    });
    let declared = quality("roll", "rad").map_or(0.0, |quality| quality.delay) * SQRT_2;
    let contradicts = |found: &Delay| found.delay.abs() > CONTRADICTS * found.std.hypot(declared);
    [pitch, roll].into_iter().flatten().filter(contradicts).collect()
}

/// How late the yaw rate is: with it taken earlier by that, the roll is in time. From how late the roll is with it as it is.
fn late_yaw_rate(roll: Lateness, with_yaw: &dyn Fn(f64) -> Option<Lateness>) -> Option<Lateness> {
    let (mut delay, mut found) = (0.0, roll);
    for _ in 0..ROUNDS {
        delay -= found.delay;
        if delay.abs() > REACH {
            return None;
        }
        found = with_yaw(delay)?;
        if found.delay.abs() < CLOSE {
            return Some(Lateness { delay, ..found });
        }
    }
    None
}

/// The log, or parts of a long one, without the outliers that would last in a simulation.
fn parts(log: &Log, stride: usize) -> Vec<Log> {
    let (length, enough) = (log.len(), ENOUGH * stride);
    let ranges: Vec<Range<usize>> = if length <= enough {
        std::iter::once(0..length).collect()
    } else {
        let (part, rest) = (enough / PARTS, length - enough / PARTS);
        (0..PARTS).map(|k| k * rest / (PARTS - 1)).map(|first| first..first + part).collect()
    };
    let clean = |range: Range<usize>| {
        let mut part = log.slice(range, |_| true);
        let period = part.period();
        for channel in part.channels.iter_mut().filter(|channel| MOTION.contains(&channel.name.as_str())) {
            hampel(&mut channel.values, period);
        }
        part
    };
    ranges.into_iter().map(clean).collect()
}

/// The signals of one joint: sums of samples and of time derivatives of samples.
struct Joint {
    angle: Vec<(Series, usize)>,
    rate: Vec<(Series, usize)>,
    /// `a`, m/s2.
    seat: Vec<(Series, usize)>,
    /// `e`, rad/s2; empty for none.
    turning: Vec<(Series, usize)>,
}

/// The pitch: the robot's acceleration makes it sway.
fn pitch(s: &Signals) -> Joint {
    let of = |value: &dyn Fn(usize) -> f64| -> Series { (0..s.len()).map(|i| -value(i)).collect() };
    let turning =
        if s.turning[0].is_empty() { vec![] } else { vec![(of(&|i| s.turned(i)[0]), 1), (of(&|i| s.turned(i)[1]), 0)] };
    Joint {
        angle: vec![(s.pitch.clone(), 0)],
        rate: vec![(s.pitch_rate.clone(), 0)],
        seat: vec![(of(&|i| s.speed[i]), 1)],
        turning,
    }
}

/// The roll: turning makes it sway, `a = w v`, and with the pitch `J d(w sin phi_y)/dt + J w phi_y'`, as in the roll rows. The
/// yaw rate is taken to be late by so much.
fn roll(s: &Signals, yaw_late: f64) -> Joint {
    let yaw_rate = |i: usize| {
        let at = (i as f64 + yaw_late / s.period).clamp(0.0, (s.len() - 1) as f64);
        let (before, share) = (at.floor() as usize, at.fract());
        let after = if share > 0.0 { before + 1 } else { before };
        (1.0 - share) * s.yaw_rate[before] + share * s.yaw_rate[after]
    };
    let of = |value: &dyn Fn(usize) -> f64| -> Series { (0..s.len()).map(value).collect() };
    let turning = if s.pitch.is_empty() {
        vec![]
    } else {
        vec![(of(&|i| yaw_rate(i) * s.pitch[i].sin()), 1), (of(&|i| yaw_rate(i) * s.pitch_rate[i]), 0)]
    };
    Joint {
        angle: vec![(s.roll.clone(), 0)],
        rate: vec![(s.roll_rate.clone(), 0)],
        seat: vec![(of(&|i| yaw_rate(i) * s.speed[i]), 0)],
        turning,
    }
}

/// How late an angle is.
#[derive(Clone, Copy, Debug)]
struct Lateness {
    /// s
    delay: f64,
    /// How late its rate is, s.
    of_rate: f64,
    /// Standard error of the angle's delay, s.
    std: f64,
    /// What the simulation leaves of angle and rate: sum of the logarithms of the root mean squares.
    cost: f64,
}

impl Lateness {
    /// The angle, and its rate if that is late, too.
    fn late<'a>(&self, channels: &'a [&'a str; 2]) -> &'a [&'a str] {
        let too = (self.of_rate - self.delay).abs() < 0.5 * self.delay.abs();
        if too { channels } else { &channels[..1] }
    }
}

/// What a part of a log holds at every instant.
struct Part {
    step: f64,
    angle: Vec<f64>,
    rate: Vec<f64>,
    seat: Vec<f64>,
    turning: Vec<f64>,
}

impl Part {
    fn new(joint: &Joint, period: f64, stride: usize) -> Self {
        let through = |parts: &Vec<(Series, usize)>| {
            let filter = Filter::new(parts, period, stride);
            let mut values = vec![0.0; filter.len()];
            filter.fill(0, &mut values);
            values
        };
        let seat = through(&joint.seat);
        let turning = if joint.turning.is_empty() { vec![0.0; seat.len()] } else { through(&joint.turning) };
        let step = period * stride as f64;
        Self { step, angle: through(&joint.angle), rate: through(&joint.rate), seat, turning }
    }

    /// The sway and what the unknowns do to it, at every instant, and whether its start is forgotten there.
    fn simulate(&self, theta: &Vector, settle: usize) -> (Vec<State>, Vec<bool>) {
        let [w2, d, q] = [theta[0], theta[1], theta[2]];
        let mut x = State::zeros();
        let (mut states, mut known) = (vec![x], vec![false]);
        let mut since = 0;
        let steps = substeps(self.step, 0.3 / w2.max(d * d).sqrt());
        for i in 1..self.seat.len() {
            let mean = |values: &[f64]| 0.5 * (values[i - 1] + values[i]);
            let (seat, turning) = (mean(&self.seat), mean(&self.turning));
            if (seat + turning).is_finite() {
                let slope = |x: &State| {
                    let mut rates = State::zeros();
                    let forces = [q * seat + turning, -x[(0, 0)], -x[(1, 0)], seat];
                    for (j, force) in forces.into_iter().enumerate() {
                        rates[(0, j)] = x[(1, j)];
                        rates[(1, j)] = force - w2 * x[(0, j)] - d * x[(1, j)];
                    }
                    rates
                };
                for _ in 0..steps {
                    x = runge_kutta(&x, self.step / steps as f64, slope);
                }
                since += 1;
            } else {
                (x, since) = (State::zeros(), 0);
            }
            states.push(x);
            known.push(since >= settle);
        }
        (states, known)
    }
}

/// A row of the regression.
struct Row {
    /// Derivatives with respect to the unknowns.
    slope: Vector,
    measured: f64,
    /// What is left of it.
    left: f64,
}

fn between(one: &State, other: &State, share: f64) -> State {
    one * (1.0 - share) + other * share
}

/// The rows of angle and rate at every instant that has them, with the number of its block.
fn rows(part: &Part, theta: &Vector, settle: usize) -> Vec<(usize, [Row; 2])> {
    let (states, known) = part.simulate(theta, settle);
    let mut all = Vec::new();
    for i in 1..states.len() {
        let measured = [part.angle[i], part.rate[i]];
        if !(measured[0] + measured[1]).is_finite() {
            continue;
        }
        let row = |k: usize| {
            let at = i as f64 - theta[3 + k] / part.step;
            if at < 1.0 || at >= (states.len() - 2) as f64 {
                return None;
            }
            let (j, share) = (at.floor() as usize, at.fract());
            if !known[j - 1] || !known[j + 2] {
                return None;
            }
            let x = between(&states[j], &states[j + 1], share);
            let change =
                between(&(states[j + 1] - states[j - 1]), &(states[j + 2] - states[j]), share) / (2.0 * part.step);
            let mut slope = Vector::zeros();
            (0..3).for_each(|column| slope[column] = x[(k, column + 1)]);
            slope[3 + k] = -change[(k, 0)];
            slope[5 + k] = 1.0;
            Some(Row { slope, measured: measured[k], left: measured[k] - x[(k, 0)] - theta[5 + k] })
        };
        let (Some(angle), Some(rate)) = (row(0), row(1)) else { continue };
        let block = (i as f64 * part.step / BLOCK) as usize;
        all.push((block, [angle, rate]));
    }
    all
}

/// How late an angle is, from a first guess of `w2`; none where the sway is not explained.
fn lateness(parts: &[Part], body: &Body, w2: f64) -> Option<Lateness> {
    let step = parts.first()?.step;
    let settle = (FORGOTTEN / (RATIO * w2.sqrt()) / step).ceil() as usize;
    let given = body.b / body.j;
    let prior = (LENGTHS * given).powi(-2);
    let mut theta = Vector::from([w2, 2.0 * RATIO * w2.sqrt(), given, 0.0, 0.0, 0.0, 0.0]);
    let mut scale: Option<[f64; 2]> = None;
    for _ in 0..ITERATIONS {
        let all: Vec<_> = parts.iter().map(|part| rows(part, &theta, settle)).collect();
        let count = all.iter().map(Vec::len).sum::<usize>() as f64;
        let left = |k: usize| {
            let squares = all.iter().flatten().map(|(_, rows)| rows[k].left.powi(2)).sum::<f64>();
            (squares / count).sqrt()
        };
        // Before the constants are there the size of what is left says nothing of the noise.
        let now = [left(0), left(1)];
        let stds = scale.unwrap_or(now);
        if count < N as f64 || !stds.iter().chain(&now).all(|std| std.is_finite() && *std > 0.0) {
            return None;
        }
        let mut information = Matrix::zeros();
        let mut score = Vector::zeros();
        information[(2, 2)] = prior;
        score[2] = -prior * (theta[2] - given);
        let mut blocks: Vec<Vector> = Vec::new();
        for part in &all {
            let mut last = None;
            for (block, rows) in part {
                if last != Some(*block) {
                    blocks.push(Vector::zeros());
                    last = Some(*block);
                }
                for (row, std) in rows.iter().zip(stds) {
                    let weight = std.powi(-2);
                    information.ger(weight, &row.slope, &row.slope, 1.0);
                    if let Some(sum) = blocks.last_mut() {
                        *sum += row.slope * (weight * row.left);
                    }
                }
            }
        }
        blocks.iter().for_each(|sum| score += sum);
        let inverse = information.try_inverse()?;
        let mut change = inverse * score;
        change[0] = change[0].clamp(-0.3 * theta[0], 0.5 * theta[0]);
        change[1] = change[1].clamp(-0.5 * theta[1], theta[1]);
        (3..5).for_each(|k| change[k] = change[k].clamp(-0.1, 0.1));
        theta += change;
        scale = Some(now);
        // Nothing is known of a sway within an instant, and it would take ever more steps to simulate.
        let fastest = theta[0].sqrt().max(theta[1]);
        if theta[3].abs().max(theta[4].abs()) > REACH || fastest * step > 1.0 {
            return None;
        }
        if change[3].abs().max(change[4].abs()) < SETTLED {
            if blocks.len() < BLOCKS || !explains(&all) {
                return None;
            }
            let mut spread = Matrix::zeros();
            blocks.iter().for_each(|sum| spread.ger(1.0, sum, sum, 1.0));
            spread *= blocks.len() as f64 / (blocks.len() - N) as f64;
            spread[(2, 2)] += prior;
            let covariance = inverse * spread * inverse;
            let cost = now.iter().map(|left| left.ln()).sum();
            return Some(Lateness { delay: theta[3], of_rate: theta[4], std: covariance[(3, 3)].sqrt(), cost });
        }
    }
    None
}

/// Whether the simulated sway explains the measured angle.
fn explains(all: &[Vec<(usize, [Row; 2])>]) -> bool {
    let angles = || all.iter().flatten().map(|(_, rows)| &rows[0]);
    let mean = angles().map(|row| row.measured).sum::<f64>() / angles().count() as f64;
    let whole: f64 = angles().map(|row| (row.measured - mean).powi(2)).sum();
    let left: f64 = angles().map(|row| row.left.powi(2)).sum();
    left < (1.0 - EXPLAINED) * whole
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::Known;
    use rand::{RngExt, SeedableRng};
    use wheelstate::Variables;
    use wheelstate::estimator::nursing_robot::Parameters;

    /// To noise that has nothing of the acceleration the most damped sway is the best: the damping doubles at every iteration,
    /// and with it the steps of the simulation, to 1e5 and more at each instant.
    #[test]
    fn the_look_for_a_sway_that_is_not_there_ends() {
        let body = signals::body(&Known::new(Parameters::declare()));
        for seed in 1..20 {
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut noise =
                |size: f64| -> Vec<f64> { (0..1200).map(|_| size * (random.random::<f64>() - 0.5)).collect() };
            let mut seat = noise(1.0);
            (1..seat.len()).for_each(|k| seat[k] += 0.9 * seat[k - 1]);
            let (angle, rate) = (noise(1e-3), noise(1e-3));
            let part = Part { step: STEP, angle, rate, turning: vec![0.0; seat.len()], seat };
            assert!(lateness(&[part], &body, 40.0).is_none());
        }
    }
}
