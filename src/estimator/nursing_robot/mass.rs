//! Mass of the person or load: threshold-adaptive forgetting least squares over the longitudinal
//! equation of motion (Yang et al., section 4.1, eq. 31-37), compensated for the sway of the body.
//!
//! With everything filtered alike, and `a` the acceleration and `s = tanh(v / v_s)` filtered:
//!
//! ```text
//! y = F - F_air - m f g s - m a_m - m_rot a          E = a_m + f g s + mu h phi''        y = m_h E
//! phi'' = -(c/J) phi' - ((k - b g)/J) phi - kappa a
//! ```
//!
//! `a_m` is `a`, or the specific force if it is measured, in which gravity along a slope is contained.
//! Errata: eq. (33), (37) print the sum `m + m_h` as the load; (32) multiplies all masses by a constant
//! factor for the wheels; "influence of sway is smallest when starting" is false, a swaying body hides
//! up to 42 % of the load from an instantaneous force.

use super::Parameters;
use super::parameters::{Law, LoadChange};
use super::status::MassStatus;
use crate::filter::critically_damped::{CriticallyDamped, Transition};
use crate::filter::discretise::runge_kutta;
use crate::filter::rls::{Config, Forgetting, Rls, Verdict};
use crate::model::nursing_robot::{GRAVITY, SmallSway};
use crate::variable::root_sum_square;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// What one step needs; NaN is missing.
#[derive(Clone, Copy, Debug)]
pub struct MassSample {
    /// Drive force `eta (tau_l + tau_r) / r` without the air drag, N.
    pub force: f64,
    /// Forward speed, m/s.
    pub speed: f64,
    /// Longitudinal specific force, m/s2; only used if configured.
    pub specific_force: f64,
}

/// Settings of the mass estimator in the form in which a step needs them.
#[derive(Clone, Debug)]
pub struct MassEstimator {
    rls: Config,
    mass: f64,
    rotating_mass: f64,
    rolling: f64,
    inverse_smoothing: f64,
    use_accelerometer: bool,
    /// The sway that is compensated, if any.
    sway: Option<SmallSway>,
    cutoff: f64,
    minimum_speed: f64,
    minimum_acceleration: f64,
    stop_time: f64,
    /// If the load changes at long stops only: how much, kg.
    change_std: Option<f64>,
    block_time: f64,
    uncertainty: [f64; 4],
    nominal: (f64, f64),
}

/// Everything that the steps change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MassState {
    /// The recursion; its disturbances are rolling resistance, drive force, sway force and the accelerometer's bias.
    pub rls: Rls<4>,
    /// What the last step did.
    pub status: MassStatus,
    /// Regressor of the last step, m/s2.
    pub regressor: f64,
    /// Measurement of the last step, N.
    pub measurement: f64,
    seeded: bool,
    speed: CriticallyDamped,
    force: CriticallyDamped,
    sign: CriticallyDamped,
    specific: CriticallyDamped,
    held: [f64; 3],
    sway: [f64; 2],
    stopped_for: f64,
    blocked_for: f64,
    at_bound_for: f64,
    /// Running means of regressor times innovation (the score) and of the squared regressor.
    score: [f64; 2],
    /// The samples of late, in [`LOOKS`] of different lengths.
    lately: [Lately; LOOKS],
}

/// Sums over the samples of late with weights `w` that fade: what they say of a change of the load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Lately {
    /// `sum w E e`, N m/s2.
    score: f64,
    /// `sum w E^2`, m2/s4.
    square: f64,
    /// `sum w^2 E^2`, m2/s4.
    spread: f64,
    /// `sum w |E|`, m/s2.
    size: f64,
}

impl Lately {
    fn fade(&mut self, keep: f64) {
        self.score *= keep;
        self.square *= keep;
        self.spread *= keep * keep;
        self.size *= keep;
    }

    fn add(&mut self, regressor: f64, innovation: f64) {
        self.score += regressor * innovation;
        self.square += regressor * regressor;
        self.spread += regressor * regressor;
        self.size += regressor.abs();
    }

    /// The load off the estimate that explains the innovations best, kg, and its inverse variance, 1/kg2: zero if they say
    /// nothing. The residual has this variance; `repeats` of its samples in a row say the same, but no more than there are.
    fn change(&self, variance: f64, repeats: f64) -> (f64, f64) {
        if self.spread < f64::MIN_POSITIVE {
            return (0.0, 0.0);
        }
        let there = self.size * self.size / self.spread;
        (self.score / self.square, self.square * self.square / (self.spread * variance * repeats.min(there)))
    }
}

/// Time of updates at a bound after which the estimate is called implausible, s.
const BOUND_TIME: f64 = 0.5;
/// Share of what was known before a stop from which the estimate counts as one of that time.
const OLD_SHARE: f64 = 0.1;
/// Share of the stops in which another load comes: the standard deviation while the machine stands is half of that of a person
/// who was never weighed, three of which contain seven persons of eight.
const EXCHANGED: f64 = 0.25;
/// Longest time over which the samples are asked whether the load has changed, s.
const CHANGE_TIME: f64 = 0.9;
/// In how many looks, each a third as long as the one before: a large change shows in few samples, a small one in many.
const LOOKS: usize = 3;
/// Odds that it has before they are asked.
const CHANGE_ODDS: f64 = 0.02;
/// Most that the logarithm of the odds may be: so certain is nothing.
const MOST_LOG_ODDS: f64 = 100.0;
/// How far beyond the bound the forces must point, as a share of the machine's mass.
const BOUND_MARGIN: f64 = 0.05;

impl MassEstimator {
    /// From checked parameters.
    pub fn new(p: &Parameters) -> Self {
        let m = &p.mass;
        let per_newton = 1.0 / p.robot.mass;
        let (fast, slow, low) = (m.forgetting_fast, m.forgetting_slow, m.error_low * p.robot.mass);
        let at_stops = match m.load_change {
            LoadChange::Auto => m.use_accelerometer,
            LoadChange::AnyTime => false,
            LoadChange::AtStops => true,
        };
        let forgetting = match m.law {
            _ if at_stops => Forgetting::Fixed(m.forgetting_steady),
            Law::Fixed => Forgetting::Fixed(m.forgetting_fixed),
            Law::Threshold => Forgetting::Threshold { fast, slow, low, high: m.error_high * p.robot.mass },
            Law::Exponential => Forgetting::Exponential { fast, slow, low, rate: m.error_rate * per_newton },
        };
        Self {
            rls: Config {
                forgetting,
                initial_forgetting: slow,
                covariance: (m.covariance_low, m.covariance_high),
                bounds: (p.limit.load_mass_low, p.limit.load_mass),
                gate: p.limit.slip_residual,
                pooled: m.pooled_samples.max(1) as u32,
                persistence: m.error_persistence,
                expected_residual: low,
            },
            mass: p.robot.mass,
            rotating_mass: p.robot.rotating_mass(),
            rolling: p.rolling.coefficient * GRAVITY,
            inverse_smoothing: 1.0 / p.rolling.smoothing_speed,
            use_accelerometer: m.use_accelerometer,
            sway: SmallSway::new(&p.human, p.human.nominal_mass).filter(|_| m.compensate_sway),
            cutoff: m.cutoff,
            minimum_speed: m.minimum_speed,
            minimum_acceleration: m.minimum_acceleration,
            stop_time: if at_stops { m.change_time } else { m.stop_time },
            change_std: at_stops.then_some(m.change_std),
            block_time: m.block_time,
            uncertainty: [m.rolling_uncertainty, m.force_uncertainty, m.sway_uncertainty, m.accel_x_bias_std],
            nominal: (p.human.nominal_mass, p.human.nominal_mass_std),
        }
    }

    /// The state before the first sample.
    pub fn start(&self) -> MassState {
        MassState {
            rls: Rls::new(&self.rls, self.nominal.0),
            status: MassStatus::NotMoving,
            regressor: 0.0,
            measurement: 0.0,
            seeded: false,
            speed: CriticallyDamped::default(),
            force: CriticallyDamped::default(),
            sign: CriticallyDamped::default(),
            specific: CriticallyDamped::default(),
            held: [0.0; 3],
            sway: [0.0; 2],
            stopped_for: 0.0,
            blocked_for: 0.0,
            at_bound_for: 0.0,
            score: [0.0; 2],
            lately: [Lately::default(); LOOKS],
        }
    }

    /// Takes one sample, `dt` seconds after the one before.
    pub fn step(&self, state: &mut MassState, sample: &MassSample, dt: f64) -> MassStatus {
        state.status = self.advance(state, sample, dt);
        state.status
    }

    /// After a gap that the filters cannot bridge: they start anew and the mass is held for a while.
    pub fn bridge_gap(&self, state: &mut MassState, sample: &MassSample) {
        state.seeded |= self.hold(state, sample);
        self.seed(state);
        state.blocked_for = self.block_time;
        state.status = MassStatus::Bad;
    }

    fn advance(&self, state: &mut MassState, sample: &MassSample, dt: f64) -> MassStatus {
        let good = self.hold(state, sample);
        if !state.seeded {
            if !good {
                return MassStatus::Bad;
            }
            state.seeded = true;
            self.seed(state);
        }
        self.filter(state, dt);
        let mut keep = (-dt / CHANGE_TIME).exp();
        for lately in &mut state.lately {
            lately.fade(keep);
            keep = keep * keep * keep;
        }
        let moving = self.watch_stops(state, dt);
        state.blocked_for = if good { (state.blocked_for - dt).max(0.0) } else { self.block_time };

        let acceleration = self.acceleration(state);
        let excited =
            acceleration.abs() > self.minimum_acceleration && state.regressor.abs() > 0.5 * self.minimum_acceleration;
        if !good {
            MassStatus::Bad
        } else if !moving {
            MassStatus::NotMoving
        } else if state.blocked_for > 0.0 {
            MassStatus::Blocked
        } else if !excited {
            MassStatus::NotExcited
        } else {
            self.correct(state, dt)
        }
    }

    /// Takes over a sample that is complete; the last one holds otherwise. Returns whether it was complete.
    fn hold(&self, state: &mut MassState, sample: &MassSample) -> bool {
        let specific = if self.use_accelerometer { sample.specific_force } else { 0.0 };
        let good = sample.force.is_finite() && sample.speed.is_finite() && specific.is_finite();
        if good {
            state.held = [sample.speed, sample.force, specific];
        }
        good
    }

    /// A stop that is long enough lets the load change: what is known of it is given up at the next start. Returns
    /// whether the machine moves.
    fn watch_stops(&self, state: &mut MassState, dt: f64) -> bool {
        let moving = state.speed.value.abs() > self.minimum_speed;
        if !moving {
            state.stopped_for = (state.stopped_for + dt).min(1e9);
            return false;
        }
        if state.stopped_for >= self.stop_time {
            match self.change_std {
                Some(std) if state.rls.valid => state.rls.inflate(&self.rls, std),
                _ => state.rls.reset_covariance(&self.rls),
            }
        }
        state.stopped_for = 0.0;
        true
    }

    fn correct(&self, state: &mut MassState, dt: f64) -> MassStatus {
        let total = self.mass + state.rls.estimate;
        let resistance = total * self.rolling * state.sign.value;
        let sway = self.sway.map_or(0.0, |sway| state.rls.estimate * self.reaction(&sway, state));
        let biased = if self.use_accelerometer { -total } else { 0.0 };
        let disturbances = [-resistance, state.force.value, sway, biased];
        let verdict = state.rls.correct(&self.rls, state.regressor, state.measurement, &disturbances, dt);
        if verdict == Verdict::Rejected {
            state.blocked_for = self.block_time;
            // At a bound a rejection is no slip but the same contradiction, and it silences the updates.
            if state.rls.at_bound(&self.rls) {
                state.at_bound_for = (state.at_bound_for + self.block_time + dt).min(1e3);
            }
            return MassStatus::Rejected;
        }
        self.watch_bound(state, dt);
        if verdict == Verdict::Pooled { MassStatus::Pooling } else { MassStatus::Updated }
    }

    /// An empty machine sits at the bound zero and is no cause for alarm; forces that ask for a mass far
    /// beyond the bound are. The score over the mean squared regressor is how far they ask beyond it, kg.
    fn watch_bound(&self, state: &mut MassState, dt: f64) {
        let e = state.regressor;
        for lately in &mut state.lately {
            lately.add(e, state.rls.innovation);
        }
        let share = 1.0 - (-dt / BOUND_TIME).exp();
        state.score[0] += share * (e * state.rls.innovation - state.score[0]);
        state.score[1] += share * (e * e - state.score[1]);
        let beyond = state.score[0].abs() > BOUND_MARGIN * self.mass * state.score[1];
        let stuck = state.rls.at_bound(&self.rls) && beyond;
        state.at_bound_for = if stuck { (state.at_bound_for + dt).min(1e3) } else { 0.0 };
    }

    fn seed(&self, state: &mut MassState) {
        let [speed, force, specific] = state.held;
        state.speed = CriticallyDamped::at(speed);
        state.force = CriticallyDamped::at(force);
        state.sign = CriticallyDamped::at((speed * self.inverse_smoothing).tanh());
        state.specific = CriticallyDamped::at(specific);
        state.sway = [0.0; 2];
    }

    fn filter(&self, state: &mut MassState, dt: f64) {
        let transition = Transition::new(self.cutoff, dt);
        let [speed, force, specific] = state.held;
        state.speed.step(&transition, speed);
        state.force.step(&transition, force);
        state.sign.step(&transition, (speed * self.inverse_smoothing).tanh());
        if self.use_accelerometer {
            state.specific.step(&transition, specific);
        }
        let acceleration = self.acceleration(state);
        let rolling = self.rolling * state.sign.value;
        state.measurement =
            state.force.value - self.mass * (acceleration + rolling) - self.rotating_mass * state.speed.rate;
        state.regressor = acceleration + rolling;
        if let Some(sway) = &self.sway {
            // with the acceleration held
            let motion = SVector::from(state.sway);
            state.sway =
                runge_kutta(&motion, dt, |x| [x[1], sway.acceleration(acceleration, x[0], x[1])].into()).into();
            state.regressor += self.reaction(sway, state);
        }
    }

    /// Acceleration of the masses that move along, with gravity if it is measured.
    fn acceleration(&self, state: &MassState) -> f64 {
        if self.use_accelerometer { state.specific.value } else { state.speed.rate }
    }

    /// The swaying body's reaction per kilogram of the person, m/s2.
    fn reaction(&self, sway: &SmallSway, state: &MassState) -> f64 {
        let [phi, phi_dot] = state.sway;
        sway.reaction(self.acceleration(state), phi, phi_dot)
    }

    /// How far the load may have changed in a stop, kg: as far as a person's mass is unknown before one is weighed, less what
    /// the samples since then have said.
    pub fn change_std(&self, state: &MassState) -> f64 {
        if !state.rls.valid || self.change_std.is_some() {
            return 0.0;
        }
        let stopped = state.stopped_for >= self.stop_time;
        self.nominal.1 * if stopped { EXCHANGED.sqrt() } else { self.old_share(state) }
    }

    /// How far the load may have changed in motion, as the innovations of late say, kg: by the look that says most, since
    /// nobody knows when it did.
    ///
    /// The innovations of a look are explained best by a load `c` off the estimate, known with the information `j`. A change
    /// that has the variance `P` of the nominal mass explains them better than none by the odds `exp(j c^2 k/2)/sqrt(1 + P j)`,
    /// `k = P j/(1 + P j)`; it is then `k c`, with the variance `P/(1 + P j)`.
    fn change_in_motion(&self, state: &MassState) -> f64 {
        let (variance, repeats) = state.rls.residual_moments();
        if self.change_std.is_some() || variance <= 0.0 {
            return 0.0;
        }
        let prior = self.nominal.1 * self.nominal.1;
        let mean_square = |lately: &Lately| {
            let (c, j) = lately.change(variance, repeats);
            let certain = prior * j / (1.0 + prior * j);
            let odds = CHANGE_ODDS * (0.5 * j * c * c * certain).min(MOST_LOG_ODDS).exp() / (1.0 + prior * j).sqrt();
            ((certain * c).powi(2) + prior / (1.0 + prior * j)) * odds / (1.0 + odds)
        };
        state.lately.iter().map(mean_square).fold(0.0, f64::max).sqrt()
    }

    /// Least squares keep the share `P/P_0` of what they knew when their covariance was `P_0`.
    fn old_share(&self, state: &MassState) -> f64 {
        state.rls.covariance / self.rls.covariance.1
    }

    /// Whether most of what is known of the load is from before a stop in which it may have changed.
    pub fn is_from_before_a_stop(&self, state: &MassState) -> bool {
        self.change_std(state) > OLD_SHARE * self.nominal.1
    }

    /// Standard deviation of the estimate; that of the nominal mass before there is one.
    pub fn std(&self, state: &MassState) -> f64 {
        let (low, high) = self.rls.bounds;
        if !state.rls.valid {
            return self.nominal.1;
        }
        // An unknown mass between the bounds has no larger standard deviation than half their distance.
        let since = state.rls.variance(&self.uncertainty).sqrt();
        root_sum_square([since, self.change_std(state), self.change_in_motion(state)]).min(0.5 * (high - low))
    }
}

impl MassState {
    /// Whether the estimate has sat at its bound for longer than half a second of updates.
    pub fn implausible(&self) -> bool {
        self.at_bound_for > BOUND_TIME
    }
}
