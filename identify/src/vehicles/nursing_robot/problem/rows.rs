//! Weak-form rows of the nursing robot: pitch, roll, longitudinal, and from the wheels only.
//!
//! Notation of the robot with a seated person: `v` speed, `w` yaw rate, `phi_y` pitch, `phi_x` roll, `b = mu m_h h` first
//! moment and `J = mu m_h (h^2 + rho^2)` moment of inertia of the swaying upper body about the hip,
//! `F' = (tau_l + tau_r) / r`. The planar equations (Yang et al., eq. 29-32 with their signs and units
//! corrected; erratum: the source prints an anti-damped, anti-sprung pendulum and a torque as force)
//!
//! ```text
//! Mt v' + b (phi_y'' cos phi_y - phi_y'^2 sin phi_y - w^2 sin phi_y) = eta F' - f M g tanh(v / v_s)
//! J phi_y'' + b cos phi_y v' - J w^2 sin phi_y cos phi_y - b g sin phi_y + c (phi_y)' + k (phi_y - phi_y0) = 0
//! ```
//!
//! are multiplied with a modulating function and integrated by parts; no signal is differentiated. The pitch rate, which
//! enters as a second-order term only, is the measured one or the slope of an 11-point quadratic.

use crate::log::Series;
use crate::problem::angles::Angles;
use crate::problem::weak_form::ModulatingFunction;
use crate::progress::Progress;
use crate::solve::Rows;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;
pub use wheelstate::model::nursing_robot::GRAVITY;

/// What is known of robot and person.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Robot without person, kg.
    pub robot_mass: f64,
    /// Equivalent mass of rotating parts, kg.
    pub rotating_mass: f64,
    /// The person, kg.
    pub human_mass: f64,
    /// Swaying share of the person times the height of its centre of mass above the hip, m.
    pub lever: f64,
    /// First moment of the swaying part, kg.m.
    pub b: f64,
    /// Moment of inertia of the swaying part about the hip, kg.m2.
    pub j: f64,
    /// Drive efficiency.
    pub efficiency: f64,
    /// Speed over which rolling resistance changes sign, m/s.
    pub smoothing_speed: f64,
    /// Density of the air, kg/m3.
    pub air_density: f64,
    /// `CdA`, m2.
    pub drag_area: f64,
}

impl Body {
    /// `M`: everything that is accelerated, without the rotating mass, kg.
    pub fn total_mass(&self) -> f64 {
        self.robot_mass + self.human_mass
    }

    /// `Mt = M + m_rot`.
    pub fn effective_mass(&self) -> f64 {
        self.total_mass() + self.rotating_mass
    }
}

/// Signals on a uniform time base; NaN is missing. A channel the log lacks is an empty vector.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Time between two samples, s.
    pub period: f64,
    /// Time of the first sample, s.
    pub start: f64,
    /// `F'`, N.
    pub force: Vec<f64>,
    /// Speed, m/s.
    pub speed: Series,
    /// Yaw rate, rad/s; zeros if the log has none.
    pub yaw_rate: Series,
    /// Pitch, rad.
    pub pitch: Series,
    /// Pitch rate, measured or from the pitch, rad/s; zeros without pitch.
    pub pitch_rate: Series,
    /// Roll, rad.
    pub roll: Series,
    /// Roll rate, measured or from the roll, rad/s.
    pub roll_rate: Series,
    /// Roll and its rate while turning, measured or that of a passive person, rad and rad/s; empty where they are not known.
    pub turning: [Series; 2],
    /// Longitudinal specific force, m/s2.
    pub accel: Series,
}

impl Signals {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.speed.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.speed.is_empty()
    }

    /// Some of the samples, which it shares but for the force.
    pub fn cut(&self, samples: Range<usize>) -> Self {
        let part = |of: &Series| if of.is_empty() { Series::default() } else { of.part(samples.clone()) };
        Self {
            period: self.period,
            start: self.start + self.period * samples.start as f64,
            force: self.force[samples.clone()].to_vec(),
            speed: part(&self.speed),
            yaw_rate: part(&self.yaw_rate),
            pitch: part(&self.pitch),
            pitch_rate: part(&self.pitch_rate),
            roll: part(&self.roll),
            roll_rate: part(&self.roll_rate),
            turning: [part(&self.turning[0]), part(&self.turning[1])],
            accel: part(&self.accel),
        }
    }

    /// `w sin phi_x` and `w phi_x'` of a sample while turning, rad/s and rad/s2.
    pub fn turned(&self, i: usize) -> [f64; 2] {
        let (w, [roll, rate]) = (self.yaw_rate[i], &self.turning);
        [w * roll[i].sin(), w * rate[i]]
    }

    /// Mean of `d(w sin phi_x)/dt + w phi_x'` over the step to sample `i`, rad/s2; 0 where unknown, see
    /// [`Windows::turning`].
    pub fn aside(&self, i: usize) -> f64 {
        if self.turning[0].is_empty() {
            return 0.0;
        }
        let ([lean, rate], [lean_before, rate_before]) = (self.turned(i), self.turned(i - 1));
        let mean = (lean - lean_before) / self.period + 0.5 * (rate + rate_before);
        if mean.is_finite() { mean } else { 0.0 }
    }
}

/// Windows of one length and stride over signals.
pub struct Windows<'a> {
    /// The signals.
    pub signals: &'a Signals,
    /// The modulating function of a window.
    pub psi: &'a ModulatingFunction,
    /// Samples from one window to the next.
    pub stride: usize,
    /// Consecutive rows whose disturbances may be correlated: at least the windows that overlap.
    pub cluster: usize,
    /// Where to tell how far the work over these windows is.
    pub progress: Progress,
}

impl Windows<'_> {
    /// First samples of the windows.
    pub fn starts(&self) -> impl Iterator<Item = usize> {
        self.psi.starts(self.signals.len(), self.stride)
    }

    /// Middle of a window, s.
    pub fn middle(&self, start: usize) -> f64 {
        self.signals.start + self.signals.period * (start as f64 + 0.5 * (self.psi.len() - 1) as f64)
    }

    /// `int psi (d(w sin phi_x)/dt + w phi_x')` of the windows that start at these samples: to leading order what a
    /// body that leans aside while the robot turns adds to the planar equations, times `b` in the
    /// longitudinal and times `J` in the pitch equation (Yang et al. leave it out). 0 where unknown.
    pub fn turning(&self, starts: &[usize]) -> Vec<f64> {
        let (w, [roll, rate]) = (self.signals.yaw_rate.as_slice(), &self.signals.turning);
        let (roll, rate) = (roll.as_slice(), rate.as_slice());
        if roll.is_empty() {
            return vec![0.0; starts.len()];
        }
        let terms = |samples: Range<usize>| {
            let lean = Angles::of(&roll[samples.clone()]);
            samples.zip(lean.iter()).map(|(i, (sin, _))| [w[i] * rate[i], w[i] * sin]).collect()
        };
        each(self, starts, terms, |terms, at| {
            let [rate, lean] = terms.integrals(self.psi, at, |psi, [rate, lean]| [psi[0] * rate, psi[1] * lean]);
            rate - lean
        })
    }

    fn int(&self, order: usize, start: usize, x: impl Fn(usize) -> f64) -> f64 {
        self.psi.integral(order, start, x)
    }
}

/// Windows between two steps of the progress bar.
const CHUNK: usize = 8192;

/// Windows that overlap.
pub const OVERLAP: usize = 12;

/// Windows that are worked out together: enough of them that hardly a sample is looked at more than once.
const PART: usize = 128;

/// What the rows of an equation are integrals of, sample by sample: windows overlap, and sines are dear.
pub(super) struct Terms<const N: usize> {
    first: usize,
    samples: Vec<[f64; N]>,
}

impl<const N: usize> Terms<N> {
    /// Integrals over the window that starts at a sample, of which `of` says what a sample adds to each, given `psi`, `psi'` and
    /// `psi''` and its terms. Side by side they take hardly longer than one of them.
    #[inline]
    pub(super) fn integrals<const M: usize>(
        &self,
        psi: &ModulatingFunction,
        start: usize,
        of: impl Fn([f64; 3], &[f64; N]) -> [f64; M],
    ) -> [f64; M] {
        let [zeroth, first, second, _] = &psi.weights;
        sums([zeroth, first, second], &self.samples[start - self.first..], of)
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn sums<F, const N: usize, const M: usize>(weights: [&[f64]; 3], samples: &[[f64; N]], of: F) -> [f64; M]
where
    F: Fn([f64; 3], &[f64; N]) -> [f64; M],
{
    // An empty sum is -0.
    let mut sums = [-0.0; M];
    for (((psi, slope), bend), terms) in weights[0].iter().zip(weights[1]).zip(weights[2]).zip(samples) {
        let more = of([*psi, *slope, *bend], terms);
        sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    }
    sums
}

/// Something of each window, given by its first sample, from the terms of its samples; in parallel and in order.
pub(super) fn each<const N: usize, T: Clone + Default + Send>(
    windows: &Windows,
    starts: &[usize],
    terms: impl Fn(Range<usize>) -> Vec<[f64; N]> + Sync,
    of: impl Fn(&Terms<N>, usize) -> T + Sync,
) -> Vec<T> {
    let mut all = vec![T::default(); starts.len()];
    all.par_chunks_mut(PART).zip(starts.par_chunks(PART)).for_each(|(some, starts)| {
        let (first, last) = (starts[0], starts[starts.len() - 1]);
        let terms = Terms { first, samples: terms(first..last + windows.psi.len()) };
        some.iter_mut().zip(starts).for_each(|(value, &at)| *value = of(&terms, at));
    });
    all
}

/// Appends one row per window, in order; each log counts its own clusters.
/// `neglected` times [`Windows::turning`] is what the right-hand sides hold beyond the planar equations.
fn fill(rows: &mut Rows, windows: &Windows, neglected: f64, of: impl Fn(&[usize]) -> Vec<Row>) {
    let first_cluster = rows.cluster.last().map_or(0, |last| last + 1);
    let before = rows.len();
    let starts: Vec<usize> = windows.starts().collect();
    rows.reserve(starts.len());
    for (index, some) in starts.chunks(CHUNK).enumerate() {
        windows.progress.reach((index * CHUNK) as f64 / starts.len() as f64);
        // Roll neglects nothing.
        let turning = if neglected == 0.0 { vec![0.0; some.len()] } else { windows.turning(some) };
        for ((a, y), turning) in of(some).into_iter().zip(turning) {
            let neglected = neglected * turning;
            let cluster = first_cluster + ((rows.len() - before) / windows.cluster) as u32;
            rows.guessed |= windows.signals.roll.is_empty();
            if rows.push(&a[..rows.columns], y, cluster) {
                rows.neglected.push(if neglected.is_finite() { neglected } else { 0.0 });
            }
        }
    }
}

/// A row, of which the first entries count, as many as there are unknowns, and its right-hand side.
type Row = ([f64; 3], f64);

/// One row of `[k, c, k phi_0]` and its right-hand side, N.m.s, of the window that starts at a sample.
pub type JointRow = Row;

/// The pitch rows of the windows that start at these samples.
pub fn pitch_rows(windows: &Windows, body: &Body, starts: &[usize]) -> Vec<JointRow> {
    let (s, psi) = (windows.signals, windows.psi);
    let Body { b, j, .. } = *body;
    let [speed, yaw_rate, pitch, pitch_rate] = [&s.speed, &s.yaw_rate, &s.pitch, &s.pitch_rate].map(Series::as_slice);
    let terms = |samples: Range<usize>| {
        let lean = Angles::of(&pitch[samples.clone()]);
        let term = |(i, (sin, cos)): (usize, (f64, f64))| {
            let (v, w, phi) = (speed[i], yaw_rate[i], pitch[i]);
            [phi, v * sin * pitch_rate[i] - GRAVITY * sin, w.powi(2) * sin * cos, v * cos]
        };
        samples.zip(lean.iter()).map(term).collect()
    };
    let one = psi.integral(0, 0, |_| 1.0);
    each(windows, starts, terms, |terms, at| {
        let of = |psi: [f64; 3], [phi, coupling, turning, forward]: &[f64; 4]| {
            let [psi, slope, bend] = psi;
            [psi * phi, psi * coupling, psi * turning, slope * phi, bend * phi, slope * forward]
        };
        let [angle, coupling, turning, rate, bend, forward] = terms.integrals(psi, at, of);
        let inertia = j * bend - b * forward;
        ([angle, -rate, -one], -(inertia + b * coupling - j * turning))
    })
}

/// The roll rows of the windows that start at these samples. Without a pitch channel the body counts as upright.
pub fn roll_rows(windows: &Windows, body: &Body, starts: &[usize]) -> Vec<JointRow> {
    let (s, psi) = (windows.signals, windows.psi);
    let Body { b, j, .. } = *body;
    let [speed, yaw_rate, roll, pitch_rate] = [&s.speed, &s.yaw_rate, &s.roll, &s.pitch_rate].map(Series::as_slice);
    let pitch = s.pitch.as_slice();
    let terms = |samples: Range<usize>| {
        let aside = Angles::of(&roll[samples.clone()]);
        let lean = if pitch.is_empty() { Angles::zero(samples.len()) } else { Angles::of(&pitch[samples.clone()]) };
        let term = |((i, (sin, cos)), (forward, upright)): ((usize, (f64, f64)), (f64, f64))| {
            let (w, roll) = (yaw_rate[i], roll[i]);
            let coupling = j * w * pitch_rate[i] * upright * (1.0 - 2.0 * cos.powi(2))
                - j * w * w * sin * cos * upright.powi(2)
                - b * w * speed[i] * cos
                - b * GRAVITY * sin * upright;
            [roll, coupling, w * forward]
        };
        samples.zip(aside.iter()).zip(lean.iter()).map(term).collect()
    };
    let one = psi.integral(0, 0, |_| 1.0);
    each(windows, starts, terms, |terms, at| {
        let of = |psi: [f64; 3], [roll, coupling, aside]: &[f64; 3]| {
            let [psi, slope, bend] = psi;
            [psi * roll, psi * coupling, slope * roll, bend * roll, slope * aside]
        };
        let [angle, coupling, rate, bend, aside] = terms.integrals(psi, at, of);
        let inertia = j * bend + j * aside;
        ([angle, -rate, -one], -(inertia + coupling))
    })
}

/// Appends the pitch rows of all windows.
pub fn pitch(rows: &mut Rows, windows: &Windows, body: &Body) {
    fill(rows, windows, body.j, |starts| pitch_rows(windows, body, starts));
}

/// Appends the roll rows of all windows.
pub fn roll(rows: &mut Rows, windows: &Windows, body: &Body) {
    fill(rows, windows, 0.0, |starts| roll_rows(windows, body, starts));
}

/// The integrals that the longitudinal rows are made of.
#[derive(Clone, Copy, Debug, Default)]
pub struct Longitudinal {
    /// `int psi F'`, N.s.
    pub force: f64,
    /// `int psi v'` from the speed, m/s.
    pub speed_rate: f64,
    /// `int psi a`: specific force if measured and wanted, else as `speed_rate`, m/s.
    pub inertial: f64,
    /// Sway share per kilogram of person, m/s.
    pub sway: f64,
    /// `g int psi tanh(v / v_s)`, m/s.
    pub rolling: f64,
    /// `rho / 2 int psi v |v|`, N.s/m2: times the drag area it is the drag's impulse.
    pub drag: f64,
    /// `int psi`, s.
    pub one: f64,
}

/// The integrals of the windows that start at these samples; that of the drag only where there is `drag`, else 0.
pub fn longitudinal(
    windows: &Windows,
    body: &Body,
    accelerometer: bool,
    drag: bool,
    starts: &[usize],
) -> Vec<Longitudinal> {
    let (s, psi) = (windows.signals, windows.psi);
    let sways = !s.pitch.is_empty() && body.lever != 0.0;
    let [speed, yaw_rate, pitch, accel] = [&s.speed, &s.yaw_rate, &s.pitch, &s.accel].map(Series::as_slice);
    let terms = |samples: Range<usize>| {
        let lean = if sways { Angles::of(&pitch[samples.clone()]) } else { Angles::zero(samples.len()) };
        let term = |(i, (sin, _)): (usize, (f64, f64))| {
            let v = speed[i];
            [s.force[i], yaw_rate[i].powi(2) * sin, (v / body.smoothing_speed).tanh(), v, sin]
        };
        samples.zip(lean.iter()).map(term).collect()
    };
    let one = psi.integral(0, 0, |_| 1.0);
    let mut all = each(windows, starts, terms, |terms, at| {
        let of = |psi: [f64; 3], [force, turning, rolling, speed, sway]: &[f64; 5]| {
            let [psi, slope, bend] = psi;
            [psi * force, psi * turning, psi * rolling, slope * speed, bend * sway]
        };
        let [force, turning, rolling, speed, bend] = terms.integrals(psi, at, of);
        Longitudinal {
            force,
            speed_rate: -speed,
            inertial: -speed,
            sway: if sways { body.lever * (bend - turning) } else { 0.0 },
            rolling: GRAVITY * rolling,
            drag: 0.0,
            one,
        }
    });
    let plain = |of: &(dyn Fn(usize) -> f64 + Sync)| {
        let terms = |samples: Range<usize>| samples.map(|i| [of(i)]).collect();
        each(windows, starts, terms, |terms, at| {
            terms.integrals(psi, at, |[psi, ..], [term]: &[f64; 1]| [psi * term])[0]
        })
    };
    if accelerometer {
        all.iter_mut().zip(plain(&|i| accel[i])).for_each(|(all, accel)| all.inertial = accel);
    }
    if drag {
        let drags = plain(&|i| speed[i] * speed[i].abs());
        all.iter_mut().zip(drags).for_each(|(all, drag)| all.drag = 0.5 * body.air_density * drag);
    }
    all
}

/// Which longitudinal unknowns are sought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// `[f]`.
    Rolling,
    /// `[f, eta]`.
    RollingEfficiency,
    /// `[f M, m_h]`: the person's mass, or `[f M, m]` with the robot's.
    RollingLoad,
    /// `[f M, m]`.
    RollingRobot,
    /// `[f M, m, CdA]`.
    RollingRobotDrag,
}

impl Drive {
    /// Number of unknowns.
    pub fn unknowns(self) -> usize {
        match self {
            Self::Rolling => 1,
            Self::RollingRobotDrag => 3,
            _ => 2,
        }
    }
}

/// Longitudinal rows, N.s.
pub fn drive(rows: &mut Rows, windows: &Windows, body: &Body, unknowns: Drive, accelerometer: bool) {
    let drag = unknowns == Drive::RollingRobotDrag || body.drag_area != 0.0;
    let row = |l: Longitudinal| {
        let spinning = body.rotating_mass * l.speed_rate;
        let resist = body.drag_area * l.drag + spinning;
        let sway = body.human_mass * l.sway;
        let carried = body.total_mass() * l.inertial + sway + resist;
        match unknowns {
            Drive::Rolling => ([body.total_mass() * l.rolling, 0.0, 0.0], body.efficiency * l.force - carried),
            Drive::RollingEfficiency => ([body.total_mass() * l.rolling, -l.force, 0.0], -carried),
            Drive::RollingLoad => (
                [l.rolling, l.inertial + l.sway, 0.0],
                body.efficiency * l.force - body.robot_mass * l.inertial - resist,
            ),
            Drive::RollingRobot => {
                ([l.rolling, l.inertial, 0.0], body.efficiency * l.force - body.human_mass * l.inertial - sway - resist)
            }
            Drive::RollingRobotDrag => (
                [l.rolling, l.inertial, l.drag],
                body.efficiency * l.force - body.human_mass * l.inertial - sway - spinning,
            ),
        }
    };
    fill(rows, windows, body.b, |starts| {
        longitudinal(windows, body, accelerometer, drag, starts).into_iter().map(row).collect()
    });
}

/// Without a tilt sensor: `[c, k - b g, (k - b g) f M g]` from force and speed alone, for windows of straight forward
/// drive. Pitch is eliminated; with noisy speed the answer is biased and only good to start from.
pub fn wheels_only(rows: &mut Rows, windows: &Windows, body: &Body) {
    let s = windows.signals;
    let mt = body.effective_mass();
    let d = body.j * mt - body.b * body.b;
    let slow = 3.0 * body.smoothing_speed;
    let row = |at: usize| {
        let int = |order, x: &dyn Fn(usize) -> f64| windows.int(order, at, x);
        if !(at..at + windows.psi.len()).all(|i| s.speed[i] > slow) {
            return ([f64::NAN; 3], f64::NAN);
        }
        let force = |i: usize| body.efficiency * s.force[i];
        let speed = |i: usize| s.speed[i];
        let row = [-int(1, &force) - mt * int(2, &speed), int(0, &force) + mt * int(1, &speed), -int(0, &|_| 1.0)];
        (row, -(d * int(3, &speed) + body.j * int(2, &force)))
    };
    fill(rows, windows, 0.0, |starts| starts.par_iter().map(|at| row(*at)).collect());
}

/// Slope of a quadratic fitted to 11 points around each sample; at the ends, to the nearest 11.
pub fn slope(x: &[f64], period: f64) -> Vec<f64> {
    const HALF: usize = 5;
    let n = x.len();
    if n < 2 * HALF + 1 {
        return vec![0.0; n];
    }
    let square: f64 = (1..=HALF).map(|k| 2.0 * (k * k) as f64).sum();
    (0..n)
        .map(|i| {
            let centre = i.clamp(HALF, n - 1 - HALF);
            let first: f64 = (1..=HALF).map(|k| k as f64 * (x[centre + k] - x[centre - k])).sum::<f64>() / square;
            // Second difference of the same quadratic, to leave the centre at the ends.
            let offset = i as f64 - centre as f64;
            let bend = if offset == 0.0 { 0.0 } else { curvature(&x[centre - HALF..=centre + HALF]) };
            (first + 2.0 * bend * offset) / period
        })
        .collect()
}

/// Second-order coefficient of the quadratic fitted to an odd number of points about their middle.
fn curvature(x: &[f64]) -> f64 {
    let half = (x.len() / 2) as f64;
    let n = x.len() as f64;
    let s2: f64 = (0..x.len()).map(|i| (i as f64 - half).powi(2)).sum();
    let s4: f64 = (0..x.len()).map(|i| (i as f64 - half).powi(4)).sum();
    let sum: f64 = x.iter().sum();
    let second: f64 = x.iter().enumerate().map(|(i, value)| (i as f64 - half).powi(2) * value).sum();
    (n * second - s2 * sum) / (n * s4 - s2 * s2)
}
