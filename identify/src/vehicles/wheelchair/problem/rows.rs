//! Weak-form rows of the chair: force along the heading and moment about the axle.
//!
//! The balances contain gravity only through the measured specific force, so the slope need not be known:
//!
//! ```text
//! u_f - mrot v' = M a_xC + D v + Fc sgn v - ML r^2 + c1        a_xC = a_x + dy r' + dx r^2
//! u_r - irot r' = IP r' + B r + tauc sgn r + ML a_yC + c2      a_yC = a_y - dx r' + dy r^2
//! ```
//!
//! with `sgn` the smooth sign of the estimator's model (`rolling.smoothing_speed` and
//! `rolling.smoothing_yaw_rate`), `ML = M l`, `IP = Ic + M l^2`, and the accelerometer's biases in
//! `c1 = -M b_ax`, `c2 = -ML b_ay`. Each is multiplied with a modulating function and integrated by parts; no signal is
//! differentiated but the smoothed ones in `sgn` and `r^2`.
//!
//! A drive command acts from its sample to the next one, as in the estimator, and the accelerations step with it. The
//! encoders show their mean over that time, and the moment beside them is integrated as a held signal: as a sampled one
//! it would be early by half a sample and `IP` too large by half a sample of `B` and `tauc`. The accelerometer shows
//! what acts at its own instant, and so does the force beside it; there the encoders' accelerations are taken to those
//! instants, `sum psi r' - int psi r' dt = (sum psi u_r - int psi u_r dt)/(IP + irot)`, and `v'` by the force alike:
//! what does not step has the same sum and integral to fourth order. That needs the inertias only to first order: those
//! that are known beforehand serve.

use super::signals::Signals;
use crate::problem::noise::{Part, noise_of, tell_noise};
use crate::problem::weak_form::ModulatingFunction;
use crate::solve::Rows;
use wheelstate::model::wheelchair::Chair;

/// `[M, D, Fc, ML, IP, B, tauc, c1, c2]`
pub const UNKNOWNS: usize = 9;
/// Index of the mass.
pub const M: usize = 0;
/// Index of the drag.
pub const D: usize = 1;
/// Index of the rolling resistance.
pub const FC: usize = 2;
/// Index of mass times lever.
pub const ML: usize = 3;
/// Index of the yaw inertia about the axle.
pub const IP: usize = 4;
/// Index of the yaw drag.
pub const B: usize = 5;
/// Index of the yaw friction.
pub const TAUC: usize = 6;
/// Index of the forward accelerometer's constant.
pub const C1: usize = 7;
/// Index of the accelerometer's constant to the left.
pub const C2: usize = 8;

/// Windows that overlap.
pub const OVERLAP: usize = 4;
/// Length of a window, s.
const WINDOW: f64 = 1.0;

/// A window's modulating function, the signals it goes over, and the chair.
pub struct Windows {
    /// The signals.
    pub signals: Signals,
    /// The modulating function.
    pub psi: ModulatingFunction,
    stride: usize,
}

/// One row and its right-hand side.
pub type Row = ([f64; UNKNOWNS], f64);

impl Windows {
    /// Windows of a second, a quarter apart.
    pub fn new(signals: Signals) -> Self {
        let n = ModulatingFunction::steps(WINDOW, signals.period);
        Self { psi: ModulatingFunction::cosine(n, signals.period), stride: (n / OVERLAP).max(1), signals }
    }

    /// First samples of the windows.
    pub fn starts(&self) -> impl Iterator<Item = usize> {
        self.psi.starts(self.signals.len(), self.stride)
    }

    /// Middle of a window, s.
    pub fn middle(&self, start: usize) -> f64 {
        self.signals.start + self.signals.period * (start as f64 + 0.5 * (self.psi.len() - 1) as f64)
    }

    /// What the steps of a command add to the sum over its samples beyond its integral.
    fn steps(&self, start: usize, command: &[f64]) -> f64 {
        self.psi.integral(0, start, |i| command[i]) - self.psi.held_integral(start, |i| command[i])
    }

    /// `sum psi r'` over the accelerometer's instants, rad/s.
    fn turning(&self, chair: &Chair, start: usize, mean: f64) -> f64 {
        let body = &chair.body;
        let inertia = body.yaw_inertia + body.mass * body.com_ahead.powi(2) + chair.rotating_inertia;
        mean + self.steps(start, &self.signals.moment) / inertia
    }

    /// Force balance of a window, N s.
    pub fn force(&self, chair: &Chair, start: usize) -> Row {
        let (s, [dx, dy, _]) = (&self.signals, chair.lever());
        let int = |order: usize, x: &dyn Fn(usize) -> f64| self.psi.integral(order, start, x);
        let r_squared = int(0, &|i| s.yaw_rate[i] * s.yaw_rate[i]);
        let mut row = [0.0; UNKNOWNS];
        let turning = self.turning(chair, start, int(2, &|i| s.heading[i]));
        row[M] = int(0, &|i| s.forward[i]) + dy * turning + dx * r_squared;
        row[D] = -int(1, &|i| s.travel[i]);
        row[FC] = int(0, &|i| s.sense[0][i]);
        row[ML] = -r_squared;
        row[C1] = int(0, &|_| 1.0);
        let rate = int(2, &|i| s.travel[i]) + self.steps(start, &s.force) / (chair.body.mass + chair.rotating_mass);
        (row, int(0, &|i| s.force[i]) - chair.rotating_mass * rate)
    }

    /// Moment balance of a window, N m s.
    pub fn moment(&self, chair: &Chair, start: usize) -> Row {
        let (s, [dx, dy, _]) = (&self.signals, chair.lever());
        let int = |order: usize, x: &dyn Fn(usize) -> f64| self.psi.integral(order, start, x);
        let turning = int(2, &|i| s.heading[i]);
        let mut row = [0.0; UNKNOWNS];
        row[IP] = turning;
        row[B] = -int(1, &|i| s.heading[i]);
        row[TAUC] = int(0, &|i| s.sense[1][i]);
        row[ML] = int(0, &|i| s.left[i]) - dx * self.turning(chair, start, turning)
            + dy * int(0, &|i| s.yaw_rate[i] * s.yaw_rate[i]);
        row[C2] = int(0, &|_| 1.0);
        (row, self.psi.held_integral(start, |i| s.moment[i]) - chair.rotating_inertia * turning)
    }

    /// What sensor noise alone makes of the two rows: the sensors' parts in them.
    fn noise(&self, chair: &Chair) -> [Vec<Part>; 2] {
        let s = &self.signals;
        let [dx, dy, _] = chair.lever();
        let [psi, psi1, psi2, _] = &self.psi.weights;
        let scaled = |weights: &[f64], factor: f64| -> Vec<f64> { weights.iter().map(|w| factor * w).collect() };
        let part = |channel: &'static str, entries: &[(usize, Vec<f64>)], std: f64| -> Part {
            let mut weights = vec![scaled(psi, 0.0); UNKNOWNS + 1];
            entries.iter().for_each(|(index, entry)| weights[*index].clone_from(entry));
            (channel, weights, std)
        };
        let (travel, heading) = (noise_of(&s.travel), noise_of(&s.heading));
        let on_travel = [(D, scaled(psi1, -1.0)), (UNKNOWNS, scaled(psi2, -chair.rotating_mass))];
        let on_heading = [
            (IP, psi2.clone()),
            (B, scaled(psi1, -1.0)),
            (ML, scaled(psi2, -dx)),
            (UNKNOWNS, scaled(psi2, -chair.rotating_inertia)),
        ];
        let held: Vec<f64> = self.psi.held.iter().copied().chain([0.0]).collect();
        let force = vec![
            part("accel_x", &[(M, psi.clone())], noise_of(&s.forward)),
            part("encoders", &on_travel, travel),
            part("encoders", &[(M, scaled(psi2, dy))], heading),
            part("drive_force", &[(UNKNOWNS, psi.clone())], noise_of(&s.force)),
        ];
        let moment = vec![
            part("accel_y", &[(ML, psi.clone())], noise_of(&s.left)),
            part("encoders", &on_heading, heading),
            part("drive_moment", &[(UNKNOWNS, held)], noise_of(&s.moment)),
        ];
        [force, moment]
    }
}

/// Both groups of rows over all logs.
pub fn groups(logs: &[Windows], chair: &Chair) -> Vec<Rows> {
    let mut force = Rows::new("force", "N.s", UNKNOWNS);
    let mut moment = Rows::new("moment", "N.m.s", UNKNOWNS);
    for log in logs {
        let first = force.cluster.last().map_or(0, |last| last + 1);
        for (k, start) in log.starts().enumerate() {
            let cluster = first + (k / OVERLAP) as u32;
            let (row, rhs) = log.force(chair, start);
            force.push(&row, rhs, cluster);
            let (row, rhs) = log.moment(chair, start);
            moment.push(&row, rhs, cluster);
        }
    }
    for (which, group) in [&mut force, &mut moment].into_iter().enumerate() {
        let parts = logs.iter().map(|log| {
            let [force, moment] = log.noise(chair);
            (if which == 0 { force } else { moment }, log.signals.period, log.signals.len() as f64)
        });
        tell_noise(group, &parts.collect::<Vec<_>>());
    }
    vec![force, moment]
}
