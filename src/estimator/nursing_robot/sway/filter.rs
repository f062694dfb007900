//! One step of the sway filter: held wheels, time update, measurement update, adaptation.

use super::motion::Step;
use super::speed_offset::SpeedOffset;
use super::{Form, REJECTIONS, SwayBelief, SwayEstimator, SwayState};
use crate::estimator::nursing_robot::status::SwayStatus;
use crate::filter::adaptation::UnmodelledAcceleration;
use crate::filter::gaussian::{Gaussian, add_square};
use crate::filter::innovation::Innovation;
use crate::filter::ukf::{self, Channel};
use nalgebra::SVector;

/// What one step needs; NaN is missing.
#[derive(Clone, Copy, Debug)]
pub struct SwaySample {
    /// Net drive force without rolling resistance and sway, N.
    pub force: f64,
    /// Yaw rate, rad/s.
    pub yaw_rate: f64,
    /// Speed, pitch and pitch rate.
    pub channels: [f64; 3],
}

/// What one step did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// What became of the sample.
    pub status: SwayStatus,
    /// What speed, pitch and pitch rate said.
    pub innovation: Innovation<3>,
    /// Whether the covariance had to be repaired.
    pub repaired: bool,
}

/// Time constant of the speed smoothed for the stand-still rule, s.
const SMOOTHING_TIME: f64 = 0.1;
/// Memory of the innovations in which a force shows that the model does not have, s: a cough begins within some hundredths.
const NOTICE_TIME: f64 = 0.03;

impl SwayEstimator {
    /// Starts anew, at the first sample or after a gap that the model cannot bridge: at the measured speed, at any
    /// plausible one if there is none, with the body about its relaxed posture.
    pub fn restart(&self, state: &mut SwayState, sample: &SwaySample, mass: f64) {
        let speed = sample.channels[0];
        *state = match speed.is_nan() {
            true => self.start_at(0.0, self.unknown_speed_std),
            false => self.start_at(speed, self.initial_std[0]),
        };
        state.mass = mass.clamp(self.mass_bounds.0, self.mass_bounds.1);
        state.status = SwayStatus::Gap;
    }

    /// Takes one sample: time update over `dt` (none if `dt` is zero), then measurement update, with
    /// `mass` kg of load.
    pub fn step(&self, state: &mut SwayState, sample: &SwaySample, mass: f64, dt: f64) -> Correction {
        let step = self.begin(state, sample, mass, dt);
        let (z, before) = (sample.channels, *state);
        let done = match before.belief {
            SwayBelief::Two(mut belief) => {
                let done = self.filter::<2, 5>(state, &mut belief, &step, z);
                state.belief = SwayBelief::Two(belief);
                done
            }
            SwayBelief::Three(mut belief) => {
                let done = self.filter::<3, 7>(state, &mut belief, &step, z);
                state.belief = SwayBelief::Three(belief);
                done
            }
            SwayBelief::Four(mut belief) => {
                let done = self.filter::<4, 9>(state, &mut belief, &step, z);
                state.belief = SwayBelief::Four(belief);
                done
            }
        };
        let done = done.unwrap_or_else(|| {
            *state = before;
            Correction { status: SwayStatus::RolledBack, innovation: Innovation::none(), repaired: true }
        });
        state.status = done.status;
        done
    }

    /// Takes over what a sample says besides its measurements; the step that leads to it.
    #[inline]
    pub(super) fn begin(&self, state: &mut SwayState, sample: &SwaySample, mass: f64, dt: f64) -> Step<'_> {
        state.mass = mass.clamp(self.mass_bounds.0, self.mass_bounds.1);
        let force = if sample.force.is_nan() { state.last_force() } else { sample.force };
        let mean_force = 0.5 * (state.force.unwrap_or(force) + force);
        state.force = if sample.force.is_nan() { state.force } else { Some(force) };
        state.yaw_rate = sample.yaw_rate;
        self.watch_wheels(state, sample.channels[0], dt);
        self.step_of(state, mean_force, dt)
    }

    /// Whether the wheels are held: the smoothed speed has been small for long enough.
    fn watch_wheels(&self, state: &mut SwayState, speed: f64, dt: f64) {
        let Some((hold_speed, hold_time)) = self.hold else { return };
        let quiet = (!speed.is_nan()).then(|| {
            let share = 1.0 - (-dt / SMOOTHING_TIME).exp();
            state.smoothed_speed += share * (speed - state.smoothed_speed);
            state.smoothed_speed.abs() < hold_speed
        });
        state.standstill.update(quiet, hold_time, dt);
    }

    /// Time and measurement update; `None` if what came out is no Gaussian.
    fn filter<const N: usize, const P: usize>(
        &self,
        state: &mut SwayState,
        belief: &mut Gaussian<N>,
        step: &Step,
        mut z: [f64; 3],
    ) -> Option<Correction> {
        if step.held {
            belief.mean[0] = 0.0;
            z[0] = f64::NAN;
        }
        let mut repaired = false;
        if step.dt > 0.0 {
            repaired = ukf::predict(belief, &self.transform, |x: &[_; P]| step.propagate_all(x))?;
            self.add_noise(belief, step, state.scale.scale);
        }
        let (mut status, innovation) = self.correct(state, belief, step, &z);
        if !belief.is_valid() {
            return None;
        }
        state.lateness.follow([if N > 2 { belief.mean[2] } else { 0.0 }, belief.mean[0]], step.dt);
        if N > 2 && self.use_channel[2] {
            state.rate_delay.follow(z[1], z[2], step.dt);
        }
        if (belief.mean[1] - self.human.rest_pitch).abs() > self.pitch_limit {
            *belief = self.relaxed(belief.mean[0], self.initial_std[0]);
            status = SwayStatus::Restarted;
        }
        Some(Correction { status, innovation, repaired })
    }

    /// Measurement update, after which measurement and process noise are adapted.
    fn correct<const N: usize>(
        &self,
        state: &mut SwayState,
        belief: &mut Gaussian<N>,
        step: &Step,
        z: &[f64; 3],
    ) -> (SwayStatus, Innovation<3>) {
        state.noise.count(&self.adaptation);
        let channels: [Channel; 3] = std::array::from_fn(|i| Channel {
            index: if i < N { i } else { 0 },
            sample: if self.use_channel[i] { z[i] } else { f64::NAN },
            variance: state.noise.variance[i],
        });
        let prior = *belief;
        let innovation = ukf::correct(belief, &channels, self.gate, &mut state.rejected);
        if step.held {
            state.unmodelled = UnmodelledAcceleration::default();
            state.speed_offset = SpeedOffset::default();
        } else if !channels[0].sample.is_nan() && step.dt > 0.0 {
            let (predicted, measured) = (prior.covariance[(0, 0)], channels[0].variance);
            state.unmodelled.learn(innovation.residual[0], predicted, measured, step.dt, NOTICE_TIME);
            state.speed_offset.follow(innovation.residual[0], self.nominal_noise[0], step.dt);
        }
        let wanted = self.use_channel.iter().filter(|used| **used).count();
        let complete = innovation.dof == wanted;
        if innovation.any_rejected() {
            return (SwayStatus::Gated, innovation);
        }
        if state.rejected > REJECTIONS {
            // The gate has let through what it had rejected: of that the speed alone is believed.
            state.rejected = 0;
            *belief = prior;
            if !z[0].is_nan() {
                belief.reset_state(0, z[0], self.nominal_noise[0]);
            }
            return (SwayStatus::Realigned, innovation);
        }
        if self.adaptive && complete {
            let residual = channels.map(|c| c.sample - belief.mean[c.index]);
            let posterior = channels.map(|c| belief.covariance[(c.index, c.index)]);
            let normalised = std::array::from_fn(|i| {
                let (index, variance) = (channels[i].index, channels[i].variance);
                innovation.residual[i] / (prior.covariance[(index, index)] + variance).sqrt()
            });
            state.noise.learn(&self.adaptation, &self.nominal_noise, &self.use_channel, &residual, &posterior);
            state.scale.learn(&self.use_channel, &normalised, step.dt, self.scale.0, self.scale.1);
        }
        let status = match (step.held, complete) {
            (true, _) => SwayStatus::Held,
            (false, true) => SwayStatus::Updated,
            (false, false) => SwayStatus::Missing,
        };
        (status, innovation)
    }

    /// Process noise over one step: independent on the states, and a white hip torque.
    pub(super) fn add_noise<const N: usize>(&self, belief: &mut Gaussian<N>, step: &Step, scale: f64) {
        let mut density = self.density;
        match self.form {
            Form::PaperRaw | Form::Paper => density[1] *= scale,
            Form::Sound => {}
            Form::SoundTorque => density[3] *= scale,
        }
        for (i, density) in density.iter().enumerate().take(N) {
            belief.covariance[(i, i)] += density * step.dt;
        }
        if self.torque_density > 0.0 {
            let torque = if self.form == Form::Sound { self.torque_density * scale } else { self.torque_density };
            let (v_dot, phi_ddot) = step.planar.hip_torque_response(belief.mean[1]);
            let response = SVector::<f64, N>::from_fn(|i, _| [v_dot, 0.0, phi_ddot, 0.0][i]);
            add_square(&mut belief.covariance, torque * step.dt, &response);
        }
    }
}
