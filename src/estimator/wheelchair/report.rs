//! The outputs: what the filter knows, carried forward and in the user's terms.

use super::attitude::{Attitude, attitude, slope_std};
use super::ekf::{Drive, wrap};
use super::{ChairBelief, ChairMachine, Inputs, Kind, Outputs, State};
use crate::filter::gaussian::{Gaussian, add_square};
use crate::model::wheelchair::{self as model, Command, biased_gravity, gravity, pitch};
use crate::variable::{Estimate, root_sum_square};
use nalgebra::SVector;
use std::f64::consts::{FRAC_PI_2, PI};

/// `1/sqrt(3)`
const FRAC_1_SQRT_3: f64 = 0.577_350_269_189_625_8;

/// Standard deviation of a heading of which nothing is known: that of an even distribution over a turn, rad.
pub(super) const UNKNOWN_HEADING: f64 = PI * FRAC_1_SQRT_3;

/// A filter that expects less acceleration than this, m^2/s^3 or rad^2/s^3, counts errors of force and moment as if it were this.
const LEAST_DENSITY: f64 = 1e-9;

/// A slope below this many of its standard deviations may as well be flat.
const SIGNIFICANT: f64 = 3.0;

/// The rate at which the ground tilts and the speed among what may be late.
const TILT_RATE: usize = 0;
const SPEED: usize = 1;

impl ChairBelief {
    /// Whether the ground is steep enough to tell where uphill is.
    pub(super) fn heading_is_observable(&self) -> bool {
        let (slope, std) = match self {
            Self::Basic(belief) => (belief.mean[model::XI], belief.std(model::XI)),
            Self::Biased(belief) => (belief.mean[model::XI], belief.std(model::XI)),
            Self::Gravity(belief) => {
                let x = biased_gravity::chair_state(&belief.mean);
                // the sine of the slope tells as well as the slope
                (gravity::tilt(&x).0, slope_std(&x, &belief.covariance))
            }
        };
        slope.abs() > SIGNIFICANT * std
    }
}

/// One state, carried forward to `mean`, with its standard deviation.
fn estimate<const N: usize>(mean: &SVector<f64, N>, belief: &Gaussian<N>, index: usize) -> Estimate {
    Estimate::new(mean[index], belief.std(index))
}

impl ChairMachine {
    pub(super) fn report(&self, state: &State, inputs: &Inputs, horizon: f64, outputs: &mut Outputs) {
        let command = self.acting(state, [inputs.drive_force, inputs.drive_moment]);
        let still = state.standstill.is_still() && self.parameters.filter.detect_standstill;
        let accel_x = Some(inputs.accel_x).filter(|a| a.is_finite());
        let drive = Drive { accel_x, ..Drive::reported(command, still) };
        // outputs are reused: what only one form estimates must not stay from a state before
        (outputs.moment_offset, outputs.heading_from_gravity) = (Estimate::NONE, false);
        match &state.belief {
            ChairBelief::Basic(belief) => {
                let mean = self.basic.carry_forward(&belief.mean, horizon, &drive);
                let mut belief = state.watch.brake.with_unknown(belief);
                self.add_errors_of_drive(&mut belief, &drive.command, self.tilt_along_contour(state));
                self.report_chair(&mean, &belief, state, outputs);
            }
            ChairBelief::Biased(belief) => {
                let mean = self.biased.carry_forward(&belief.mean, horizon, &drive);
                let belief = &mut state.watch.brake.with_unknown(belief);
                self.add_rolling_error(belief, model::XI, model::GYRO_BIAS + 1, mean[model::ALPHA].sin());
                self.report_chair(&mean, belief, state, outputs);
                report_biases(&mean, belief, [model::GYRO_BIAS, model::FORCE_GAIN], outputs);
                outputs.heading_offset = estimate(&mean, belief, model::HEADING_OFFSET);
            }
            ChairBelief::Gravity(belief) => {
                let mean = self.gravity.carry_forward(&belief.mean, horizon, &drive);
                let belief = &mut state.watch.brake.with_unknown(belief);
                self.add_rolling_error(belief, gravity::GX, biased_gravity::GYRO_BIAS + 1, 1.0);
                report_gravity(&mean, belief, outputs);
                outputs.moment_offset = estimate(&mean, belief, biased_gravity::MOMENT_OFFSET);
                outputs.heading_from_gravity = true;
                if state.left_contour {
                    let heading = outputs.heading;
                    outputs.heading_offset = Estimate::new(wrap(heading.value - mean[gravity::PSI]), heading.std);
                }
                report_biases(&mean, belief, [biased_gravity::GYRO_BIAS, biased_gravity::FORCE_GAIN], outputs);
            }
        }
        self.count_wheels(state, outputs);
        outputs.slope_rate.widen(state.lateness.std(TILT_RATE, self.delay(state)));
        outputs.standstill = drive.still;
    }

    /// Adds to a belief that takes force and moment as exact what their errors make of it.
    ///
    /// An acceleration `d` that lasts moves the estimates by `P e d/q`: `P e` are the covariances with the speed that it drives,
    /// `q` is the density of the acceleration that the filter expects there. With `q` in the Riccati equation this makes
    /// `(F - K H) P e/q + e` zero as far as no state drives that speed. A slope does, in which a force's error ends: `d/g`. What the
    /// ground may tilt along the contour line (its mean square, rad^2) drives the chair too.
    fn add_errors_of_drive(&self, belief: &mut Gaussian<6>, reported: &Command, along_contour: f64) {
        let (p, noise, gravity) = (&self.parameters.initial, &self.basic.noise, self.chair.gravity);
        let downhill = gravity * belief.mean[model::ALPHA].cos() * along_contour.sqrt();
        let rolling = p.rolling_coefficient_std * self.chair.body.mass * gravity;
        let force = root_sum_square([p.force_gain_std * reported[0], p.force_offset_std, rolling]);
        let moment = root_sum_square([p.force_gain_std * reported[1], p.moment_offset_std]);
        for (rate, error, density) in [
            (model::V, root_sum_square([force / self.chair.inertial_mass(), downhill]), noise.speed),
            (model::R, moment / self.chair.inertia_at_axle(), noise.yaw_rate),
        ] {
            let moved = belief.covariance.column(rate) * (error / density.max(LEAST_DENSITY));
            add_square(&mut belief.covariance, 1.0, &moved);
        }
        let slope = force / (self.chair.inertial_mass() * gravity);
        belief.inflate(model::XI, slope * slope);
    }

    /// Adds to a belief what an error of the rolling coefficient makes of it where a force drives the chair: forward it needs the
    /// force of so much tilt, of which a state has the share `part`, and what the forward accelerometer feels then is taken for its bias.
    fn add_rolling_error<const N: usize>(&self, belief: &mut Gaussian<N>, tilt: usize, bias: usize, part: f64) {
        if self.parameters.filter.kind == Kind::AccelerationInput {
            return;
        }
        let error = self.parameters.initial.rolling_coefficient_std;
        belief.inflate(tilt, (error * part).powi(2));
        belief.inflate(bias, (error * self.chair.gravity).powi(2));
    }

    /// Heading per distance that two wheels of different radii make, rad/m (one standard deviation).
    fn turning(&self) -> f64 {
        self.parameters.chair.wheel_radius_difference_std / self.chair.body.track()
    }

    /// How late what was read may be, s (one standard deviation): as sensors are, as these show, and as long as nothing new was read.
    fn delay(&self, state: &State) -> f64 {
        let declared = self.parameters.filter.measurement_std.delay;
        root_sum_square([state.encoder_delay.delay_std(declared), state.unchanged.seconds()])
    }

    /// Counts what the encoders cannot tell: errors of the wheels' radius, the frame that they sit on, where their zeros are, how late
    /// they are.
    fn count_wheels(&self, state: &State, outputs: &mut Outputs) {
        let relative = self.parameters.chair.wheel_radius_std;
        let turning = self.turning() * outputs.speed.value;
        let delay = self.delay(state);
        // within the declared delay a chair's speed changes by no more than the filter's deviation
        let declared = self.parameters.filter.measurement_std.delay;
        let slower = state.lateness.std(SPEED, (delay * delay - declared * declared).max(0.0).sqrt());
        outputs.heading.widen(delay * outputs.yaw_rate.value);
        let of_speed = [state.frame_turn.speed_std(&self.chair), state.stopped, slower];
        let of_distance =
            [state.frame_turn.distance_std(&self.chair), delay * outputs.speed.value, state.zeros[0].sqrt()];
        for (estimate, errors) in [
            (&mut outputs.speed, root_sum_square(of_speed)),
            (&mut outputs.distance, root_sum_square(of_distance)),
            (&mut outputs.yaw_rate, turning),
        ] {
            estimate.widen(root_sum_square([errors, relative * estimate.value]));
        }
    }

    /// The outputs that come from the first six states, with or without biases behind them; `along_contour` is the mean
    /// square tilt that the ground may have along the contour line, rad^2, `held` the slope's standard deviation from what
    /// hands may hold, rad.
    fn report_chair<const N: usize>(
        &self,
        x: &SVector<f64, N>,
        belief: &Gaussian<N>,
        state: &State,
        outputs: &mut Outputs,
    ) {
        let (along_contour, held) = (self.tilt_along_contour(state), self.slope_std_of_held(state));
        // (alpha, xi, w) and (alpha + pi, -xi, -w) are the same pose.
        let turned = self.parameters.filter.canonical_slope && x[model::XI] < 0.0;
        let sign = if turned { -1.0 } else { 1.0 };
        outputs.distance = estimate(x, belief, model::S);
        outputs.heading = estimate(x, belief, model::ALPHA);
        outputs.heading.value += if turned { PI } else { 0.0 };
        outputs.speed = estimate(x, belief, model::V);
        outputs.yaw_rate = estimate(x, belief, model::R);
        // With chi along the contour line the slope is hypot(xi, chi), and the contour line turns by atan(chi/xi).
        let (xi, chi) = (x[model::XI].abs(), along_contour.sqrt());
        let steeper = if chi > 0.0 { along_contour / xi.hypot(chi) } else { 0.0 };
        let by_radius = self.parameters.chair.wheel_radius_std * (x[model::ALPHA] - self.chair.heading_reference);
        let by_difference = self.turning() * x[model::S];
        let turned_line =
            root_sum_square([chi.atan2(xi), outputs.heading.std, by_radius, by_difference, state.zeros[1].sqrt()]);
        outputs.heading.std = turned_line.min(UNKNOWN_HEADING.max(outputs.heading.std));
        outputs.slope = Estimate::new(sign * x[model::XI], root_sum_square([belief.std(model::XI), steeper, held]));
        outputs.slope_rate = Estimate::new(sign * x[model::W], belief.std(model::W));
        let (angle, [by_heading, by_slope]) = pitch(x[model::ALPHA], x[model::XI]);
        let mut gradient = SVector::<f64, N>::zeros();
        (gradient[model::ALPHA], gradient[model::XI]) = (by_heading, by_slope);
        // Where the chair stands on end the gradient has a pole.
        let forward = x[model::ALPHA].cos() * chi;
        let std = root_sum_square([belief.variance_along(&gradient).sqrt(), forward, by_slope * held]);
        outputs.pitch = Estimate::new(angle, std.min(FRAC_PI_2));
    }
}

/// Biases of the four sensors from `sensors` on, errors of the force from `force` on.
fn report_biases<const N: usize>(
    x: &SVector<f64, N>,
    belief: &Gaussian<N>,
    [sensors, force]: [usize; 2],
    outputs: &mut Outputs,
) {
    outputs.gyro_bias = estimate(x, belief, sensors);
    outputs.accel_x_bias = estimate(x, belief, sensors + 1);
    outputs.accel_y_bias = estimate(x, belief, sensors + 2);
    outputs.accel_z_bias = estimate(x, belief, sensors + 3);
    outputs.force_gain_error = estimate(x, belief, force);
    outputs.force_offset = estimate(x, belief, force + 1);
}

fn report_gravity(mean: &biased_gravity::State, belief: &Gaussian<15>, outputs: &mut Outputs) {
    let Attitude { heading, slope, slope_rate, pitch } =
        attitude(&biased_gravity::chair_state(mean), &belief.covariance);
    outputs.distance = estimate(mean, belief, gravity::S);
    outputs.speed = estimate(mean, belief, gravity::V);
    outputs.yaw_rate = estimate(mean, belief, gravity::R);
    (outputs.heading, outputs.slope) = (heading, slope);
    (outputs.slope_rate, outputs.pitch) = (slope_rate, pitch);
}
