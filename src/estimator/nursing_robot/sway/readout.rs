//! What the sway filter's belief says about the machine: forces and their standard deviations, also a
//! while after the last sample.

use super::{Form, SwayBelief, SwayEstimator, SwayState};
use crate::filter::gaussian::Gaussian;
use crate::model::nursing_robot::Planar;
use crate::variable::{Estimate, root_sum_square};
use nalgebra::SVector;

/// The filter's answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SwayEstimate {
    /// Speed, m/s; pitch, rad; pitch rate, rad/s; active torque, N m; 0 for what the model does not have.
    pub state: [Estimate; 4],
    /// Pitch about the posture that the body keeps, rad: without what nobody knows of that.
    pub motion: Estimate,
    /// Force of the swaying body, N.
    pub force: Estimate,
    /// Passive hip torque, N m.
    pub torque: Estimate,
}

/// Places of pitch rate and speed among what may be late.
const PITCH_RATE: usize = 0;
const SPEED: usize = 1;
/// Longest step of the model when it is carried forward, s.
const LONGEST_STEP: f64 = 0.01;
/// A force that the model does not have is taken for a lean if it lasts so long, s.
const LEAN_TIME: f64 = 0.15;
/// Least stiffness of the upright posture, N m/rad: a softer hip topples.
const LEAST_STIFFNESS: f64 = 1.0;
/// Most steps forward; what lies beyond is held.
const MOST_STEPS: f64 = 200.0;

impl SwayEstimator {
    /// The estimate `horizon` seconds after the last sample: its posterior, the mean carried forward
    /// under a drive force, held (the last one if it is NaN).
    pub fn estimate(&self, state: &SwayState, drive_force: f64, horizon: f64) -> SwayEstimate {
        self.estimate_under(state, drive_force, horizon, 0.0)
    }

    /// The same where a force with the standard deviation `unexplained`, N, is taken for one of the sway: what a wrong mass
    /// makes of the acceleration. Without a tilt sensor the pitch may also have moved by the torque that the model does
    /// not carry before the filter notices it, `phi = T^2/2 phi''`.
    pub fn estimate_under(&self, state: &SwayState, force: f64, horizon: f64, unexplained: f64) -> SwayEstimate {
        let mut estimate = match &state.belief {
            SwayBelief::Two(belief) => self.read(state, belief, force, horizon),
            SwayBelief::Three(belief) => self.read(state, belief, force, horizon),
            SwayBelief::Four(belief) => self.read(state, belief, force, horizon),
        };
        estimate.force.widen(unexplained);
        for (channel, estimate) in estimate.state.iter_mut().enumerate().take(3) {
            estimate.widen(self.noise_taken_for_motion(state, channel, estimate.std));
        }
        let planar = self.step_of(state, 0.0, 0.0).planar;
        let moved = match self.use_channel[1] {
            true => self.widen_measured(state, &mut estimate),
            false => self.widen_motion(state, &planar, unexplained, &mut estimate),
        };
        self.widen_torques(state, &planar, moved, &mut estimate);
        self.widen_speed(state, &mut estimate.state[0]);
        if self.use_channel[2] {
            let late = state.lateness.std(PITCH_RATE, self.delay(state));
            estimate.state[2].widen(root_sum_square([self.bias_std[1], late]));
        }
        estimate
    }

    /// Adds what the estimates may have changed by while nothing new was read for so many seconds.
    pub(in super::super) fn widen_aged(&self, state: &SwayState, seconds: f64, estimate: &mut SwayEstimate) {
        estimate.state[0].widen(state.lateness.std(SPEED, seconds));
        if self.use_channel[1] {
            let moved = seconds * estimate.state[2].value;
            estimate.motion.widen(moved);
            estimate.state[1].widen(moved);
        }
        if self.use_channel[2] {
            estimate.state[2].widen(state.lateness.std(PITCH_RATE, seconds));
        }
    }

    /// With a tilt sensor: adds to the deviations of the pitch what constant errors and lateness of the sensors make of it. Returns what it has added to that
    /// of the motion, rad.
    fn widen_measured(&self, state: &SwayState, estimate: &mut SwayEstimate) -> f64 {
        let [tilt, rate] = self.bias_std;
        let tilt = root_sum_square([tilt, self.delay(state) * estimate.state[2].value, self.drift(state, rate)]);
        estimate.motion.widen(tilt);
        estimate.state[1].widen(tilt);
        tilt
    }

    /// How late tilt and tilt rate may be, s (one standard deviation).
    fn delay(&self, state: &SwayState) -> f64 {
        state.rate_delay.delay_std(self.delay_std)
    }

    /// What a sensor's noise moves an estimate of this deviation where the adapted noise is less than that.
    ///
    /// A model that is wrong is let follow the sensor, whose noise then seems to vanish: with the gain `K = P/R` the estimate has
    /// `K^2` of the noise's true variance.
    fn noise_taken_for_motion(&self, state: &SwayState, channel: usize, std: f64) -> f64 {
        let (adapted, nominal) = (state.noise.variance[channel], self.nominal_noise[channel]);
        if !self.use_channel[channel] || adapted >= nominal {
            return 0.0;
        }
        (std * std / adapted).min(1.0) * (nominal - adapted).sqrt()
    }

    /// Adds to the deviation of the speed what a force that lasts, samples that come late and an error of their scale make of it, and
    /// that wheels which count as held may creep.
    fn widen_speed(&self, state: &SwayState, speed: &mut Estimate) {
        let creeps = if state.standstill.is_still() { state.smoothed_speed } else { 0.0 };
        speed.widen(root_sum_square([
            state.speed_offset.std(),
            state.lateness.std(SPEED, self.speed_delay_std),
            self.speed_scale_std * speed.value,
            creeps,
        ]));
    }

    /// How far a pitch rate that is off by `rate` leads the pitch away before the tilt holds it, rad: the filter, which balances the noise
    /// of the two, forgets what the rate says in the time in which this adds up to the noise of the tilt.
    fn drift(&self, state: &SwayState, rate: f64) -> f64 {
        let [_, of_tilt, of_rate] = state.noise.variance;
        if self.use_channel[2] { rate * (of_tilt / of_rate).sqrt() } else { 0.0 }
    }

    /// Without a tilt sensor: adds to the deviations of pitch and pitch rate what the wheels do not tell of them. Returns what it
    /// has added to that of the motion, rad.
    fn widen_motion(&self, state: &SwayState, planar: &Planar, unexplained: f64, estimate: &mut SwayEstimate) -> f64 {
        let (posture, notice) = (planar.posture_by_rest(), self.scale.0);
        // J phi'' = -(k - b g) phi
        let frequency = ((planar.k / posture).max(LEAST_STIFFNESS) / planar.j).sqrt();
        // A force that lasts is taken for a lean: for a sway of this force in its own frequency, F = b phi''.
        let unexplained = root_sum_square([unexplained, planar.inertial_mass * state.unmodelled.lasting(LEAN_TIME)]);
        let taken_for_sway = unexplained / (planar.b * frequency * frequency);
        // The force shows, the sway follows from it by spring and damper: at rest b a = -(k - b g) phi, so that an error of k moves
        // phi by that over k - b g, and one of c by c frequency over it.
        let [spring, damper] = self.passive_std;
        let damping = planar.c * frequency / planar.k.max(LEAST_STIFFNESS);
        let share = posture * root_sum_square([spring, damper * damping]);
        let amplitude = root_sum_square([estimate.motion.value, estimate.state[2].value / frequency]);
        let sway = root_sum_square([taken_for_sway, share * amplitude]);
        let torque = self.torque_noise(state).sqrt();
        let unnoticed = notice * planar.hip_torque_response(estimate.state[1].value).1 * torque;
        let moved = root_sum_square([sway, 0.5 * notice * unnoticed]);
        estimate.motion.widen(moved);
        estimate.state[1].widen(root_sum_square([moved, posture * self.rest_std]));
        if self.form.states() > 2 && !self.use_channel[2] {
            estimate.state[2].widen(root_sum_square([frequency * sway, unnoticed]));
        }
        moved
    }

    /// Adds to the deviations of the hip's torques what errors of spring, damper and posture make of them; `moved` is the
    /// standard deviation of the motion that the filter does not know of, rad.
    fn widen_torques(&self, state: &SwayState, planar: &Planar, moved: f64, estimate: &mut SwayEstimate) {
        let [spring, damper] = self.passive_std;
        // Where the pitch is not measured it moves with the posture, and the torque is the one that gravity then asks for.
        let posture = if self.use_channel[1] { 1.0 } else { planar.posture_by_rest() - 1.0 };
        let passive = root_sum_square([
            spring * planar.k * (estimate.state[1].value - planar.rest),
            damper * planar.c * estimate.state[2].value,
            planar.k * posture * self.rest_std,
            planar.k * moved,
        ]);
        estimate.torque.widen(passive);
        estimate.state[3].std = if self.form == Form::SoundTorque {
            // Together they are what the motion needs.
            root_sum_square([estimate.state[3].std, passive])
        } else {
            let seen = state.unmodelled.std.max(state.unmodelled.again());
            let unmodelled = seen / planar.hip_torque_response(estimate.state[1].value).0.abs();
            root_sum_square([self.initial_std[3], self.torque_noise(state).sqrt(), unmodelled])
        };
    }

    fn read<const N: usize>(&self, state: &SwayState, belief: &Gaussian<N>, force: f64, horizon: f64) -> SwayEstimate {
        let mut mean = belief.mean;
        let last = state.last_force();
        let mut step = self.step_of(state, last, 0.0);
        if horizon > 0.0 {
            step.force = if force.is_finite() { force } else { last };
            let span = horizon.min(LONGEST_STEP * MOST_STEPS);
            let steps = (span / LONGEST_STEP).ceil();
            step.dt = span / steps;
            for _ in 0..steps as usize {
                mean = step.propagate(&mean);
            }
            if mean.iter().any(|x| !x.is_finite()) {
                mean = belief.mean;
            }
        }

        let mut estimate = SwayEstimate::default();
        for i in 0..N {
            estimate.state[i] = Estimate::new(mean[i], belief.std(i));
        }
        let planar = &step.planar;
        let posture = planar.posture_by_rest();
        estimate.motion = Estimate::new(mean[1] - posture * planar.rest, estimate.state[1].std);
        let unmodelled = self.torque_noise(state);
        let force = step.sway_force(&mean);
        let gradient = gradient(&mean, force, |x| step.sway_force(x));
        let direct = planar.b * planar.hip_torque_response(mean[1]).1;
        let variance = belief.variance_along(&gradient) + direct * direct * unmodelled;
        // a force that only the innovations know of moves the robot and looks like one of the sway
        let unmodelled = planar.inertial_mass * state.unmodelled.std.max(state.unmodelled.again());
        estimate.force = Estimate::new(force, (variance + unmodelled * unmodelled).sqrt());
        let rate = if N > 2 { mean[2] } else { 0.0 };
        let gradient = SVector::<f64, N>::from_fn(|i, _| [0.0, planar.k, planar.c, 0.0][i]);
        let variance = belief.variance_along(&gradient);
        estimate.torque = Estimate::new(planar.hip_torque(mean[1], rate), variance.sqrt());
        estimate
    }

    /// Variance of the hip torque that the model does not carry, N2 m2, over the time that the filter
    /// needs to notice it.
    fn torque_noise(&self, state: &SwayState) -> f64 {
        let scale = if self.form == Form::Sound { state.scale.scale } else { 1.0 };
        self.torque_density * scale / self.scale.0
    }
}

/// Forward differences over steps that are small for speeds, angles, rates and torques alike.
fn gradient<const N: usize>(x: &SVector<f64, N>, value: f64, f: impl Fn(&SVector<f64, N>) -> f64) -> SVector<f64, N> {
    const STEP: f64 = 1e-6;
    SVector::from_fn(|i, _| {
        let mut moved = *x;
        moved[i] += STEP;
        (f(&moved) - value) / STEP
    })
}
