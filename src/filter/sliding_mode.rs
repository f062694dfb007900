//! Sliding-mode observer of the unknown force in an equation of motion such as a wheel's, `J w' = T - R F`.
//!
//! The speed `w` and the torque `T` are measured, the force `F` is not. The observer gets the equation from
//! outside ([`ForcedMotion`]), copies its motion, keeps the copy's error `s = w - w_hat` small by an injection, and reads the force
//! from the injection that was needed (CN117406607B, claim 1, step 2):
//!
//! ```text
//! inj   = k s + eps tanh(a s)
//! F_nom = F_bar (+ T/R with feedforward)
//! F_hat = clip(F_nom - (J/R) inj, ±f_max)
//! w_hat <- w_hat + dt [(T - R F_nom)/J + inj],   F_bar <- F_bar + dt lambda (F_hat - F_nom)
//! ```
//!
//! Errata: the source feeds its own estimate back, `F_nom = F_hat`; sampled, that loop is undamped,
//! so the nominal force is a low-passed one with a rate `lambda <= kappa/4`. Its `sign(s)` is
//! unusable when sampled; the smooth saturation `tanh` is the one it introduces later.
//!
//! # Why it converges
//! With `V = s²/2`, `s' = -(R/J)(F - F_nom) - k s - eps sat`: for `sign`, `eps > (R/J) max|F - F_nom|`
//! suffices; with `k > 0`, `|s|` stays below `(R/J) max|F - F_nom| / k` even if `eps` is too small.
//!
//! # Error budget
//! Inside the layer (`|a s| << 1`), with `kappa = k + eps a`,
//! `F_hat = kappa (p + lambda)/(p² + kappa p + lambda kappa) F`: a first-order lag for `lambda = 0`,
//! no error on ramps for `lambda > 0`, damping `sqrt(kappa/lambda)/2`.
//!
//! | cause | force error |
//! |---|---|
//! | lag on a ramp, `lambda = 0` | at most `max abs(F') / kappa`; in general `(F_hat' - F_bar')/kappa` |
//! | lag after a step of the torque | what the observer would lag behind a force `T/R` |
//! | white speed noise | `(J/R) kappa sigma_w sqrt(2/(2 - kappa dt))` |
//! | white torque noise | `sigma_T/R sqrt(kappa dt/(2 - kappa dt))` |
//! | torque bias `b` | `b/R`, not observable |
//! | inertia error `dJ` | `-(dJ/R) w'` |
//!
//! Sampling needs `kappa dt < 2`; above 0.5 noise and lag grow quickly. A good `kappa` is near
//! `sqrt(max|F'| R / (J sigma_w))`. Torque bias and inertia, not the gain, limit the accuracy.

use serde::{Deserialize, Serialize};

/// An equation of motion, linear in a known torque and an unknown force.
pub trait ForcedMotion {
    /// `w'` under a torque and a force, for a wheel `(T - R F)/J`.
    fn acceleration(&self, torque: f64, force: f64) -> f64;
    /// The force that balances a torque, for a wheel `T/R`.
    fn balance(&self, torque: f64) -> f64;
    /// The force that changes `w'` by -1, for a wheel `J/R`.
    fn force_per_acceleration(&self) -> f64;
}

/// The observer's settings.
#[derive(Clone, Debug, PartialEq)]
pub struct SlidingMode {
    /// Linear gain `k`, 1/s.
    pub gain: f64,
    /// Amplitude `eps` of the smooth switching term, rad/s².
    pub amplitude: f64,
    /// Steepness `a` of the switching term, s/rad.
    pub steepness: f64,
    /// Rate `lambda` of the low-passed nominal force, 1/s.
    pub nominal_rate: f64,
    /// Largest force `f_max` that is reported, N; infinite for none.
    pub force_limit: f64,
    /// Whether the nominal force contains `T/R`.
    pub feedforward: bool,
    /// The adaptation of the amplitude, if any.
    pub adaptation: Option<Adaptation>,
}

/// `eps <- clip(eps + dt gamma |s| (+1 if |s| > dead zone else -1), least, greatest)`.
#[derive(Clone, Debug, PartialEq)]
pub struct Adaptation {
    /// Rate `gamma`, 1/s².
    pub rate: f64,
    /// Error below which the amplitude shrinks, rad/s.
    pub dead_zone: f64,
    /// Least amplitude, rad/s².
    pub least: f64,
    /// Greatest amplitude, rad/s².
    pub greatest: f64,
}

/// What a step of the observer changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlidingModeState {
    /// The copy's speed `w_hat`, rad/s.
    pub speed: f64,
    /// Low-passed nominal force `F_bar`, N.
    pub nominal: f64,
    /// Present amplitude, rad/s².
    pub amplitude: f64,
    /// Last estimated force `F_hat`, N.
    pub force: f64,
    /// Low-passed lag error, N: `(F_hat' - F_bar')/kappa`.
    pub lag: f64,
    /// The largest of late of its sizes, N: a lag that swings is no smaller where it changes its sign.
    pub swing: f64,
    /// `s` and `F_bar` of the same observer if the force were the one that balances the torque, rad/s and N.
    #[serde(with = "super::array")]
    pub balanced: [f64; 2],
    /// What that observer lags behind, N.
    pub torque_lag: f64,
    /// Last change of speed, rad/s².
    pub acceleration: f64,
    /// The force that balanced the torque at the last measured speed, and how far it has moved since, N.
    #[serde(with = "super::array")]
    pub since: [f64; 2],
    /// Samples without a measured speed since the last one.
    pub stale: u32,
    /// Whether a speed was ever measured.
    pub started: bool,
}

impl SlidingMode {
    /// The state before the first sample.
    pub fn start(&self) -> SlidingModeState {
        SlidingModeState {
            speed: 0.0,
            nominal: 0.0,
            amplitude: self.amplitude,
            force: 0.0,
            lag: 0.0,
            swing: 0.0,
            balanced: [0.0; 2],
            torque_lag: 0.0,
            acceleration: 0.0,
            since: [0.0; 2],
            stale: 0,
            started: false,
        }
    }

    /// The gain inside the layer, `kappa = k + eps a`, at an amplitude, 1/s.
    pub fn layer_gain(&self, amplitude: f64) -> f64 {
        self.gain + amplitude * self.steepness
    }

    /// The largest layer gain that adaptation can reach, 1/s.
    pub fn greatest_layer_gain(&self) -> f64 {
        self.layer_gain(self.adaptation.as_ref().map_or(self.amplitude, |a| a.greatest.max(self.amplitude)))
    }

    /// Takes one sample of speed (rad/s) and torque (N m) and gives the force, N.
    ///
    /// A speed that is not finite is a missing sample: the copy runs on with the last force, which is held.
    pub fn step(
        &self,
        motion: &impl ForcedMotion,
        state: &mut SlidingModeState,
        speed: f64,
        torque: f64,
        dt: f64,
    ) -> f64 {
        if !speed.is_finite() {
            state.stale = state.stale.saturating_add(1);
            state.since[1] = motion.balance(torque) - state.since[0];
            if state.started {
                state.acceleration = motion.acceleration(torque, state.force);
                state.speed += dt * state.acceleration;
            }
            return state.force;
        }
        if !state.started {
            state.speed = speed;
            state.started = true;
        }
        let s = speed - state.speed;
        let injection = self.gain * s + state.amplitude * (self.steepness * s).tanh();
        let nominal = state.nominal + if self.feedforward { motion.balance(torque) } else { 0.0 };
        let force = (nominal - motion.force_per_acceleration() * injection).clamp(-self.force_limit, self.force_limit);

        let before = (state.force, state.nominal, state.stale);
        state.acceleration = motion.acceleration(torque, nominal) + injection;
        state.speed += dt * state.acceleration;
        state.nominal += dt * self.nominal_rate * (force - nominal);
        state.force = force;
        (state.since, state.stale) = ([motion.balance(torque), 0.0], 0);
        let kappa = self.layer_gain(state.amplitude);
        if before.2 == 0 {
            // rates of change, seen through a low-pass a quarter as fast as the layer
            let rate = (force - before.0 - (state.nominal - before.1)) / dt;
            let share = (0.25 * kappa * dt).min(1.0);
            state.lag += share * (rate / kappa - state.lag);
            state.swing = state.lag.abs().max((1.0 - share) * state.swing);
        }
        if !self.feedforward {
            self.follow_torque(state, motion.balance(torque), motion.force_per_acceleration(), dt);
        }
        if let Some(law) = &self.adaptation {
            let direction = if s.abs() > law.dead_zone { 1.0 } else { -1.0 };
            let moved = state.amplitude + dt * law.rate * s.abs() * direction;
            state.amplitude = moved.clamp(law.least, law.greatest);
        }
        force
    }

    /// What the observer would lag behind a force that balances the torque: a step of this shows before the force does.
    fn follow_torque(&self, state: &mut SlidingModeState, balance: f64, per_acceleration: f64, dt: f64) {
        let kappa = self.layer_gain(state.amplitude);
        let [s, nominal] = &mut state.balanced;
        let force = *nominal - per_acceleration * kappa * *s;
        state.torque_lag = balance - force;
        *s -= dt * ((balance - *nominal) / per_acceleration + kappa * *s);
        *nominal += dt * self.nominal_rate * (force - *nominal);
    }

    /// The error budget: standard deviation of the last force, N, from the standard deviations of
    /// speed noise (rad/s), torque noise and torque bias (N m), and the relative error of the inertia.
    pub fn force_std(&self, motion: &impl ForcedMotion, state: &SlidingModeState, known: &Knowledge, dt: f64) -> f64 {
        let per_acceleration = motion.force_per_acceleration();
        let kappa = self.layer_gain(state.amplitude);
        let sampled = (kappa * dt).min(1.9);
        let speed = per_acceleration * kappa * known.speed_noise * (2.0 / (2.0 - sampled)).sqrt();
        let through = if self.feedforward { 1.0 } else { (sampled / (2.0 - sampled)).sqrt() };
        let torque = motion.balance(known.torque_noise) * through;
        let bias = motion.balance(known.torque_bias);
        let inertia = known.inertia_error * per_acceleration * state.acceleration;
        // a held force is as wrong as the force may have moved since, by itself or with the torque
        let moved = f64::from(state.stale.min(1_000_000)) * dt * (state.lag * kappa).abs();
        let lag = state.swing.max(state.torque_lag.abs());
        let parts = [speed, torque, bias, inertia, lag, moved, state.since[1]];
        parts.iter().map(|part| part * part).sum::<f64>().sqrt()
    }
}

/// How well the observer's inputs are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knowledge {
    /// White noise of the speed, rad/s.
    pub speed_noise: f64,
    /// White noise of the torque, N m.
    pub torque_noise: f64,
    /// Constant error of the torque, N m.
    pub torque_bias: f64,
    /// Relative error of the inertia.
    pub inertia_error: f64,
}
