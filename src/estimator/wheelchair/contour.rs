//! From heading and slope to the direction of gravity, when the ground contradicts the contour line of
//! `initial.heading`: a pavement's cross slope, a ramp that lies otherwise than was said.

use super::belief::biases;
use super::brake::Brake;
use super::ekf::Noise;
use super::forms::add_paired_noise;
use super::held::Held;
use super::parameters::{InitialParameters, Kind, Model, Parameters};
use super::{ChairBelief, ChairMachine, State};
use crate::estimator::sampled::HELD_BRIEFLY;
use crate::filter::gaussian::Gaussian;
use crate::model::wheelchair::{self as model, biased_gravity, gravity};
use crate::variable::root_sum_square;
use nalgebra::{SMatrix, SVector};

/// What contradicts the contour line for this long is no kerb or edge, s.
const PATIENCE: f64 = 1.5;
/// A bias further from its start than so many of its standard deviations is a tilt of the ground.
const IMPROBABLE: f64 = 2.5;
/// A force's offset within so many of its standard deviations is expected.
const EXPECTED: f64 = 2.0;
/// A bias is known if less than this share of its standard deviation is left.
const KNOWN: f64 = 0.5;
/// Standard deviations of ground whose contour line is unknown, rad, and of its rate, rad/s.
const UNKNOWN_TILT: f64 = 0.1;
const UNKNOWN_TILT_RATE: f64 = 0.1;
/// Standard deviations of what a wrong tilt may have done to distance and heading, m and rad, to the speed, m/s, and to
/// the yaw rate, rad/s.
const UNKNOWN_POSE: f64 = 0.02;
const UNKNOWN_SPEED: f64 = 0.2;
const UNKNOWN_YAW_RATE: f64 = 0.2;
/// A chair that is faster than this, m/s, is not held by a brake.
pub(super) const MOVING: f64 = 0.1;
/// Ground is level, as far as the start knows, up to so many standard deviations of the specific force.
const LEVEL: f64 = 3.0;
/// Time in which a brake's force changes by as much as it may be, s.
const BRAKE_TIME: f64 = 1.0;
/// With more than this share of gravity along the heading the contour line bears on the pitch.
const ACROSS_ONLY: f64 = 0.25;

/// The direction of gravity at the start, biases and errors of the drive as the kind knows them.
pub(super) fn start(parameters: &Parameters) -> Gaussian<15> {
    use gravity::{GX, GY, PSI, R, S, V, WP, WR};
    let p = &parameters.initial;
    let ((sa, ca), tilt) = (p.heading.sin_cos(), p.slope.sin());
    let (mut mean, mut std) = (biased_gravity::State::zeros(), biased_gravity::State::zeros());
    (mean[PSI], mean[V], mean[GX], mean[GY]) = (p.heading, p.speed, tilt * sa, tilt * ca);
    (std[S], std[PSI], std[V], std[R]) = (p.distance_std, p.heading_std, p.speed_std, p.yaw_rate_std);
    (std[GX], std[GY], std[WP], std[WR]) = (p.slope_std, p.slope_std, p.slope_rate_std, p.slope_rate_std);
    if parameters.filter.kind != Kind::Basic {
        mean.fixed_rows_mut::<4>(biased_gravity::GYRO_BIAS).copy_from(&SVector::from(biases(p)));
    }
    let accel = p.accel_bias_std;
    let biases = SVector::from([p.gyro_bias_std, accel, accel, accel]);
    std.fixed_rows_mut::<4>(biased_gravity::GYRO_BIAS).copy_from(&biases);
    if parameters.filter.kind != Kind::AccelerationInput {
        std[biased_gravity::FORCE_GAIN] = p.force_gain_std;
        std[biased_gravity::FORCE_OFFSET] = p.force_offset_std;
    }
    std[biased_gravity::MOMENT_OFFSET] = p.moment_offset_std;
    Gaussian::independent(mean, &std)
}

/// Tilt and bias that the forward and the leftward accelerometer read.
const FORWARD: [usize; 2] = [gravity::GX, biased_gravity::GYRO_BIAS + 1];
const LEFTWARD: [usize; 2] = [gravity::GY, biased_gravity::GYRO_BIAS + 2];

/// At the start, a specific force beyond what tilt and bias together are expected to make is ground that is less level than
/// expected: the variance of its tilt grows until the reading is a usual one.
fn widen_tilt(belief: &mut Gaussian<15>, [tilt, bias]: [usize; 2], read: f64, noise: &Noise, gravity: f64) -> bool {
    let off = read - gravity * belief.mean[tilt] - belief.mean[bias];
    let known = gravity * gravity * belief.covariance[(tilt, tilt)] + belief.covariance[(bias, bias)];
    widen(belief, tilt, off, known + noise.accel * noise.accel, gravity)
}

/// The same for the slope across the contour line.
fn widen_across(belief: &mut Gaussian<13>, read: [f64; 2], noise: &Noise, gravity: f64) -> bool {
    let (x, bias) = (&belief.mean, model::GYRO_BIAS + 1);
    let (sa, ca) = x[model::ALPHA].sin_cos();
    let up = sa * (read[0] - x[bias]) + ca * (read[1] - x[bias + 1]);
    let off = up - gravity * x[model::XI].sin();
    let known = gravity * gravity * belief.covariance[(model::XI, model::XI)] + belief.covariance[(bias, bias)];
    widen(belief, model::XI, off, known + noise.accel * noise.accel, gravity)
}

/// Mean square tilt along the contour line that a specific force shows beyond what biases and noise explain, of variance `known`,
/// rad^2.
fn along_contour<const N: usize>(
    belief: &Gaussian<N>,
    read: [f64; 2],
    biases: [f64; 2],
    known: f64,
    gravity: f64,
) -> f64 {
    let (sa, ca) = belief.mean[model::ALPHA].sin_cos();
    let along = ca * (read[0] - biases[0]) - sa * (read[1] - biases[1]);
    // NaN vanishes in max
    (along * along - known).max(0.0) / (gravity * gravity)
}

/// Widens a tilt by what a specific force is off beyond its variance. Returns whether that is improbable.
fn widen<const N: usize>(belief: &mut Gaussian<N>, tilt: usize, off: f64, known: f64, gravity: f64) -> bool {
    let beyond = off * off - known;
    if beyond > 0.0 {
        belief.inflate(tilt, (beyond / (gravity * gravity)).min(UNKNOWN_TILT * UNKNOWN_TILT));
    }
    off * off > LEVEL * LEVEL * known
}

/// What the biases of the accelerometer along the contour line hide, from what the filter has found for them: the
/// standard deviation of the tilt at a start of which both are uncertain, and the share of a found bias that is tilt.
fn hidden(p: &InitialParameters, bias_std: f64, gravity: f64) -> (f64, f64) {
    let (tilt, bias) = (p.slope_std * gravity, bias_std);
    let share = tilt * tilt / (tilt * tilt + bias * bias).max(f64::MIN_POSITIVE);
    ((share * bias * bias).sqrt() / gravity, share)
}

/// A belief in heading and slope as one in the direction of gravity, by the delta method. Nothing is added.
fn as_gravity<const N: usize>(belief: &Gaussian<N>) -> Gaussian<15> {
    use gravity::{GX, GY, PSI, R, S, V, WP, WR};
    let x = &belief.mean;
    let ((sa, ca), (sx, cx), w) = (x[model::ALPHA].sin_cos(), x[model::XI].sin_cos(), x[model::W]);
    let mut mean = biased_gravity::State::zeros();
    mean.fixed_rows_mut::<8>(0).copy_from(&SVector::from([
        x[model::S],
        x[model::ALPHA],
        x[model::V],
        x[model::R],
        sa * sx,
        ca * sx,
        w * sa,
        w * ca,
    ]));
    let mut by = SMatrix::<f64, 15, N>::zeros();
    (by[(S, model::S)], by[(PSI, model::ALPHA)], by[(V, model::V)], by[(R, model::R)]) = (1.0, 1.0, 1.0, 1.0);
    (by[(GX, model::ALPHA)], by[(GX, model::XI)]) = (ca * sx, sa * cx);
    (by[(GY, model::ALPHA)], by[(GY, model::XI)]) = (-sa * sx, ca * cx);
    (by[(WP, model::ALPHA)], by[(WP, model::W)]) = (w * ca, sa);
    (by[(WR, model::ALPHA)], by[(WR, model::W)]) = (-w * sa, ca);
    if N > model::FORCE_OFFSET {
        mean[PSI] -= x[model::HEADING_OFFSET];
        by[(PSI, model::HEADING_OFFSET)] = -1.0;
        let others = (0..4)
            .map(|k| (biased_gravity::GYRO_BIAS + k, model::GYRO_BIAS + k))
            .chain((0..2).map(|k| (biased_gravity::FORCE_GAIN + k, model::FORCE_GAIN + k)));
        for (to, from) in others {
            mean[to] = x[from];
            by[(to, from)] = 1.0;
        }
    }
    Gaussian { mean, covariance: by * belief.covariance * by.transpose() }
}

impl ChairMachine {
    /// Standard deviation of the accelerometer's bias where it is a state.
    fn accel_bias_std(&self) -> f64 {
        match self.parameters.filter.kind {
            Kind::Basic => 0.0,
            Kind::Bias | Kind::AccelerationInput | Kind::GravityVector => self.parameters.initial.accel_bias_std,
        }
    }

    /// At the first sample, widens the slope by what the forward and leftward specific force, m/s^2, say of it. A chair that
    /// stands on such ground is held by a brake, which nobody reports. `basic`, to which forces are exact, knows no brake.
    pub(super) fn widen_slope(&self, state: &mut State, read: [f64; 2]) {
        let (gravity, noise, start) = (self.chair.gravity, &self.basic.noise, &self.parameters.initial);
        let known = self.accel_bias_std().powi(2) + noise.accel.powi(2);
        state.may_be_braked = match &mut state.belief {
            ChairBelief::Basic(belief) => {
                state.watch.begin(along_contour(belief, read, [0.0; 2], known, gravity));
                false
            }
            ChairBelief::Biased(belief) => {
                let biases = [start.accel_x_bias, start.accel_y_bias];
                state.watch.begin(along_contour(belief, read, biases, known, gravity));
                widen_across(belief, read, noise, gravity)
            }
            ChairBelief::Gravity(belief) => {
                widen_tilt(belief, LEFTWARD, read[1], noise, gravity);
                widen_tilt(belief, FORWARD, read[0], noise, gravity)
            }
        };
        if state.may_be_braked {
            let held = self.brake_std();
            self.inflate_force(&mut state.belief, held * held);
        } else if self.parameters.filter.kind != Kind::AccelerationInput {
            state.watch.brake = Brake::unknown();
        }
    }

    /// Lets a brake of which the state does not know end with the first motion, and go into the state if it was there.
    pub(super) fn settle_brake(&self, state: &mut State, dt: f64) {
        let State { belief, watch, command, .. } = state;
        let driven = watch.brake.is_driven(command[0], self.parameters.initial.force_offset_std);
        if driven || belief.motion().0.abs() > MOVING {
            watch.brake.release();
        }
        match belief {
            ChairBelief::Basic(belief) => watch.brake.settle(belief, dt),
            ChairBelief::Biased(belief) => watch.brake.settle(belief, dt),
            ChairBelief::Gravity(belief) => watch.brake.settle(belief, dt),
        }
    }

    /// Until the chair moves, force and moment of the brake may be any and may end at any time; then there are none.
    pub(super) fn let_brakes_hold(&self, state: &mut State, dt: f64) {
        if !state.may_be_braked {
            return;
        }
        // What hands hold shows when the brake is off.
        state.watch.held = Held::default();
        if state.belief.motion().0.abs() <= MOVING {
            let held = self.brake_std();
            self.inflate_force(&mut state.belief, held * held * dt / BRAKE_TIME);
            let turning = held * self.chair.body.com_ahead / self.chair.inertia_at_axle();
            if let ChairBelief::Biased(belief) = &mut state.belief {
                let density = 2.0 * BRAKE_TIME * turning * turning;
                add_paired_noise(&mut belief.covariance, dt, [(model::ALPHA, model::R, density)]);
            }
            return;
        }
        state.may_be_braked = false;
        self.forget_force(&mut state.belief);
    }

    /// Of the force's errors no more is known than at the start.
    fn forget_force(&self, belief: &mut ChairBelief) {
        if !self.takes_force() {
            return;
        }
        let variance = self.parameters.initial.force_offset_std.powi(2);
        match belief {
            ChairBelief::Basic(_) => {}
            ChairBelief::Biased(belief) => belief.reset_state(model::FORCE_OFFSET, 0.0, variance),
            ChairBelief::Gravity(belief) => belief.reset_state(biased_gravity::FORCE_OFFSET, 0.0, variance),
        }
    }

    /// A force that nobody samples may be as large as a brake's; once it is sampled again its errors are those of the start.
    pub(super) fn doubt_held_force(&self, state: &mut State, held: bool, dt: f64) {
        if held {
            state.held_for += dt;
            if state.held_for > HELD_BRIEFLY {
                let (unknown, known) = (self.brake_std().powi(2), state.belief.force_variance());
                self.inflate_force(&mut state.belief, (unknown * dt / BRAKE_TIME).min((unknown - known).max(0.0)));
            }
            return;
        }
        if state.held_for > HELD_BRIEFLY {
            self.forget_force(&mut state.belief);
        }
        state.held_for = 0.0;
    }

    /// Standard deviation of a brake's force, N.
    fn brake_std(&self) -> f64 {
        self.chair.body.mass * self.chair.gravity * UNKNOWN_TILT
    }

    /// Whether the force's errors are states.
    pub(super) fn takes_force(&self) -> bool {
        matches!(self.parameters.filter.kind, Kind::Bias | Kind::GravityVector)
    }

    fn inflate_force(&self, belief: &mut ChairBelief, variance: f64) {
        if !self.takes_force() {
            return;
        }
        match belief {
            ChairBelief::Basic(_) => {}
            ChairBelief::Biased(belief) => belief.inflate(model::FORCE_OFFSET, variance),
            ChairBelief::Gravity(belief) => belief.inflate(biased_gravity::FORCE_OFFSET, variance),
        }
    }

    /// How far the biases of the forward and leftward accelerometer are from their start, m/s^2.
    fn found_biases(&self, belief: &ChairBelief) -> [f64; 2] {
        let p = &self.parameters.initial;
        match belief {
            ChairBelief::Biased(belief) => {
                let x = belief.mean.fixed_rows::<2>(model::GYRO_BIAS + 1);
                [x[0] - p.accel_x_bias, x[1] - p.accel_y_bias]
            }
            ChairBelief::Basic(_) | ChairBelief::Gravity(_) => [0.0; 2],
        }
    }

    /// How far the force's offset is beyond what is expected of it, N: along the contour line a tilt looks like it.
    fn improbable_force(&self, belief: &Gaussian<13>) -> f64 {
        let (offset, std) = (belief.mean[model::FORCE_OFFSET], self.parameters.initial.force_offset_std);
        if self.takes_force() { (offset * offset - (EXPECTED * std).powi(2)).max(0.0).sqrt() } else { 0.0 }
    }

    /// Mean square tilt that the ground may have along the contour line, rad^2: what the accelerometer's bias and the force's
    /// offset may hide, and what the innovations indicate.
    pub(super) fn tilt_along_contour(&self, state: &State) -> f64 {
        let gravity = self.chair.gravity;
        let (std, share) = hidden(&self.parameters.initial, self.accel_bias_std(), gravity);
        let found = match &state.belief {
            ChairBelief::Biased(belief) => {
                let ([x, y], (sa, ca)) = (self.found_biases(&state.belief), belief.mean[model::ALPHA].sin_cos());
                let hidden = share * (ca * x - sa * y) / gravity;
                root_sum_square([hidden, ca * self.improbable_force(belief) / (self.chair.body.mass * gravity)])
            }
            // Which line the contour line is shows no better than the slope does.
            ChairBelief::Basic(belief) => belief.std(model::XI),
            ChairBelief::Gravity(_) => 0.0,
        };
        std * std + found * found + state.watch.tilt_along_contour()
    }

    /// Whether a bias of the forward and of the leftward accelerometer has been found where none is expected.
    fn improbable_biases(&self, state: &State) -> [bool; 2] {
        let ChairBelief::Biased(gaussian) = &state.belief else { return [false; 2] };
        let (std, found) = (self.accel_bias_std(), self.found_biases(&state.belief));
        std::array::from_fn(|k| {
            let bias = model::GYRO_BIAS + 1 + k;
            let known = gaussian.covariance[(bias, bias)] + state.watch.brake.variance_of(bias);
            found[k].abs() > IMPROBABLE * std && known < KNOWN * std * KNOWN * std
        })
    }

    /// Takes heading and slope from the direction of gravity if the ground has contradicted the contour line for long.
    pub(super) fn doubt_contour(&self, state: &mut State, dt: f64) {
        if matches!(state.belief, ChairBelief::Gravity(_)) || self.parameters.filter.model == Model::Paper {
            return;
        }
        let [forward, leftward] = self.improbable_biases(state);
        let drifting = match &state.belief {
            ChairBelief::Biased(belief) => {
                let bias = model::GYRO_BIAS + 2;
                state.watch.bias_drifts(belief.mean[bias], belief.covariance[(bias, bias)], dt)
            }
            ChairBelief::Basic(_) | ChairBelief::Gravity(_) => false,
        };
        if !state.watch.doubts(forward || leftward || drifting, PATIENCE, dt) {
            return;
        }
        let (alpha, mut belief) = match &state.belief {
            ChairBelief::Basic(belief) => {
                (belief.mean[model::ALPHA], as_gravity(&state.watch.brake.with_unknown(belief)))
            }
            ChairBelief::Biased(belief) => {
                (belief.mean[model::ALPHA], as_gravity(&state.watch.brake.with_unknown(belief)))
            }
            ChairBelief::Gravity(_) => return,
        };
        let pitch_too = forward || alpha.cos().abs() > ACROSS_ONLY || state.watch.gyro_contradicts();
        self.free_tilt(&mut belief, &state.belief, pitch_too, leftward);
        if !belief.is_valid() {
            return;
        }
        state.belief = ChairBelief::Gravity(belief);
        state.left_contour = true;
        state.watch.reset();
    }

    /// Removes from a belief what it has from the contour line.
    fn free_tilt(&self, belief: &mut Gaussian<15>, from: &ChairBelief, pitch_too: bool, improbable: bool) {
        use gravity::{GX, GY, PSI, R, S, V, WP, WR};
        let (p, start) = (&self.parameters.initial, start(&self.parameters));
        let accel_y = biased_gravity::GYRO_BIAS + 2;
        if pitch_too || matches!(from, ChairBelief::Basic(_)) {
            for state in biased_gravity::GYRO_BIAS..biased_gravity::MOMENT_OFFSET {
                belief.reset_state(state, start.mean[state], start.covariance[(state, state)]);
            }
        }
        if pitch_too {
            belief.reset_state(GX, 0.0, UNKNOWN_TILT * UNKNOWN_TILT);
            belief.reset_state(WP, 0.0, UNKNOWN_TILT_RATE * UNKNOWN_TILT_RATE);
        } else if improbable {
            belief.reset_state(accel_y, start.mean[accel_y], start.covariance[(accel_y, accel_y)]);
        } else {
            // At the start the bias was taken for all of what may have been a tilt in part.
            let (std, share) = hidden(p, self.accel_bias_std(), self.chair.gravity);
            let [_, found] = self.found_biases(from);
            let variance = belief.covariance[(accel_y, accel_y)] + (std * self.chair.gravity).powi(2);
            belief.reset_state(accel_y, belief.mean[accel_y] - share * found, variance);
        }
        // The motion has been driven by a wrong tilt.
        belief.inflate(S, UNKNOWN_POSE * UNKNOWN_POSE);
        belief.inflate(PSI, UNKNOWN_POSE * UNKNOWN_POSE);
        belief.inflate(V, UNKNOWN_SPEED * UNKNOWN_SPEED);
        belief.inflate(R, UNKNOWN_YAW_RATE * UNKNOWN_YAW_RATE);
        // Along the contour line, "up" may lie anywhere.
        belief.reset_state(GY, 0.0, UNKNOWN_TILT * UNKNOWN_TILT);
        belief.reset_state(WR, 0.0, UNKNOWN_TILT_RATE * UNKNOWN_TILT_RATE);
        // Nor has the moment been measured with which hands hold the chair on a slope across the heading.
        let held = self.chair.body.mass * self.chair.gravity * self.chair.body.com_ahead * UNKNOWN_TILT;
        belief.reset_state(biased_gravity::MOMENT_OFFSET, 0.0, held * held);
    }
}
