//! The direction of gravity with what sensors and drive get wrong: `[x, b_g, b_ax, b_ay, b_az, k_f, c_f, c_m]`.
//!
//! `x` is that of [`gravity`], the others as in [`BiasedState`](super::BiasedState); the heading needs no
//! offset, as it does not come from the encoders. `c_m` is an unmodelled moment: hands that hold a chair on its course
//! across a slope, where gravity turns it downhill by `M g l cos(alpha) sin(xi)`.

use super::gravity::{self, GX, GY, R, V};
use super::{Chair, Command, Output, acting_command, force_gradient, moment_gradient};
use nalgebra::{SMatrix, SVector};

/// State `[s, psi, v, r, gx, gy, wp, wr, b_g, b_ax, b_ay, b_az, k_f, c_f, c_m]`; biases in rad/s and m/s^2, the
/// force's gain error as a share, its offset in N, that of the moment in N m.
pub type State = SVector<f64, 15>;

/// Index of the gyro's bias, rad/s; those of the accelerometer's three axes, m/s^2, follow.
pub const GYRO_BIAS: usize = 8;
/// Index of the error of the drive force's gain, 1.
pub const FORCE_GAIN: usize = 12;
/// Index of an unmodelled force, N.
pub const FORCE_OFFSET: usize = 13;
/// Index of an unmodelled moment, N m.
pub const MOMENT_OFFSET: usize = 14;
const ACCEL_X_BIAS: usize = 9;

/// The state without biases and force errors.
#[inline]
pub fn chair_state(x: &State) -> gravity::State {
    x.fixed_rows::<8>(0).into_owned()
}

fn acting(x: &State, u: &Command) -> Command {
    acting_command(u, x[FORCE_GAIN], x[FORCE_OFFSET]) + Command::new(0.0, x[MOMENT_OFFSET])
}

fn without_biases(rate: &gravity::State) -> State {
    let mut all = State::zeros();
    all.fixed_rows_mut::<8>(0).copy_from(rate);
    all
}

fn with_biases(x: &State, mut y: Output) -> Output {
    for k in 0..4 {
        y[2 + k] += x[GYRO_BIAS + k];
    }
    y
}

/// `x' = f(x, u)` of [`gravity::derivative`]; biases stay as they are.
#[inline]
pub fn derivative(chair: &Chair, x: &State, u: &Command, still: bool) -> State {
    without_biases(&gravity::derivative(chair, &chair_state(x), &acting(x, u), still))
}

/// [`derivative`] and the Jacobian of its first six rows at the price of one; the others are zero.
#[inline]
pub fn linearise(chair: &Chair, x: &State, u: &Command, still: bool) -> (State, SMatrix<f64, 6, 15>) {
    let (rate, jacobian) = gravity::linearise(chair, &chair_state(x), &acting(x, u), still);
    let mut all = SMatrix::<f64, 6, 15>::zeros();
    all.fixed_columns_mut::<8>(0).copy_from(&jacobian);
    all.fixed_view_mut::<1, 2>(V, FORCE_GAIN).copy_from(&force_gradient(chair, u, still));
    all[(R, MOMENT_OFFSET)] = moment_gradient(chair, still);
    (without_biases(&rate), all)
}

/// `y = h(x, u)` of [`gravity::output`] with biases.
pub fn output(chair: &Chair, x: &State, u: &Command, still: bool) -> Output {
    with_biases(x, gravity::output(chair, &chair_state(x), &acting(x, u), still))
}

/// [`output`] and its Jacobian at the price of one.
#[inline]
pub fn observe(chair: &Chair, x: &State, u: &Command, still: bool) -> (Output, SMatrix<f64, 6, 15>) {
    let (y, seen) = gravity::observe(chair, &chair_state(x), &acting(x, u), still);
    let mut jacobian = SMatrix::<f64, 6, 15>::zeros();
    jacobian.fixed_columns_mut::<8>(0).copy_from(&seen);
    for k in 0..4 {
        jacobian[(2 + k, GYRO_BIAS + k)] = 1.0;
    }
    jacobian.fixed_view_mut::<1, 2>(3, FORCE_GAIN).copy_from(&force_gradient(chair, u, still)); // a_x contains v'
    // r' through the accelerometer's lever
    let ([dx, dy, _], per_moment) = (chair.lever(), moment_gradient(chair, still));
    (jacobian[(3, MOMENT_OFFSET)], jacobian[(4, MOMENT_OFFSET)]) = (-dy * per_moment, dx * per_moment);
    (with_biases(x, y), jacobian)
}

/// [`derivative`] with the measured specific force `accel_x` in place of the drive force, as in
/// [`acceleration_driven`](super::acceleration_driven).
pub fn driven_derivative(chair: &Chair, x: &State, u: &Command, accel_x: f64, still: bool) -> State {
    let mut rate = derivative(chair, x, u, still);
    if !still {
        let rest = gravity::output(chair, &chair_state(x), &acting(x, u), still)[3] - rate[V];
        rate[V] = accel_x - x[ACCEL_X_BIAS] - rest;
    }
    rate
}

/// [`driven_derivative`] and the Jacobian of its first six rows at the price of one.
pub fn driven_linearise(
    chair: &Chair,
    x: &State,
    u: &Command,
    accel_x: f64,
    still: bool,
) -> (State, SMatrix<f64, 6, 15>) {
    let (mut rate, mut jacobian) = linearise(chair, x, u, still);
    if !still {
        let (reading, seen) = gravity::observe(chair, &chair_state(x), &acting(x, u), still);
        rate[V] = accel_x - x[ACCEL_X_BIAS] - (reading[3] - rate[V]);
        // Row v' = -(row a_x of the sensors without v').
        for column in [V, R, GX, GY] {
            jacobian[(V, column)] -= seen[(3, column)];
        }
        jacobian.fixed_view_mut::<1, 2>(V, FORCE_GAIN).fill(0.0);
        jacobian[(V, MOMENT_OFFSET)] = chair.lever()[1] * moment_gradient(chair, still);
        jacobian[(V, ACCEL_X_BIAS)] = -1.0;
    }
    (rate, jacobian)
}
