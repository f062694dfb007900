//! The state with what sensors and drive get wrong: `[x, b_g, b_ax, b_ay, b_az, a_off, k_f, c_f]`.
//!
//! The biases of gyro and accelerometer are added to rows 3 to 6 of the measurement; `a_off` is the
//! error of the encoders' heading reference: `alpha_enc = alpha - a_off`. On the chair acts
//! `(1 + k_f) u_f + c_f` instead of the reported `u_f`: `k_f` is the error of the drive's gain over
//! that of the mass, `c_f` an unmodelled force, rolling resistance or a push. The source has none of
//! them; known exactly (`k_f = c_f = 0`) the last two leave the state of eleven.

use super::{
    ALPHA, Chair, Command, Observation, Output, R, State, V, W, XI, acting_command, derivative, force_gradient,
    linearise, observe, output,
};
use nalgebra::{SMatrix, SVector};

/// State `[s, alpha, v, r, xi, w, b_g, b_ax, b_ay, b_az, a_off, k_f, c_f]`; biases in rad/s, m/s^2 and rad,
/// the force's gain error as a share, its offset in N.
pub type BiasedState = SVector<f64, 13>;

/// Index of the gyro's bias, rad/s; those of the accelerometer's three axes, m/s^2, follow.
pub const GYRO_BIAS: usize = 6;
const ACCEL_X_BIAS: usize = 7;
/// Index of the error of the encoders' heading reference, rad.
pub const HEADING_OFFSET: usize = 10;
/// Index of the error of the drive force's gain, 1.
pub const FORCE_GAIN: usize = 11;
/// Index of an unmodelled force, N.
pub const FORCE_OFFSET: usize = 12;

fn chair_state(x: &BiasedState) -> State {
    x.fixed_rows::<6>(0).into_owned()
}

fn acting(x: &BiasedState, u: &Command) -> Command {
    acting_command(u, x[FORCE_GAIN], x[FORCE_OFFSET])
}

fn without_biases(rate: &State) -> BiasedState {
    let mut all = BiasedState::zeros();
    all.fixed_rows_mut::<6>(0).copy_from(rate);
    all
}

/// `x' = f(x, u)` of [`derivative`]; biases stay as they are.
pub fn biased_derivative(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> BiasedState {
    without_biases(&derivative(chair, &chair_state(x), &acting(x, u), still))
}

/// [`biased_derivative`] and the Jacobian of its first five rows at the price of one.
#[inline]
pub fn biased_linearise(
    chair: &Chair,
    x: &BiasedState,
    u: &Command,
    still: bool,
) -> (BiasedState, SMatrix<f64, 5, 13>) {
    let (rate, jacobian) = linearise(chair, &chair_state(x), &acting(x, u), still);
    let mut all = SMatrix::<f64, 5, 13>::zeros();
    all.fixed_columns_mut::<6>(0).copy_from(&jacobian);
    all.fixed_view_mut::<1, 2>(V, FORCE_GAIN).copy_from(&force_gradient(chair, u, still));
    (without_biases(&rate), all)
}

/// `y = h(x, u)` of [`output`] with biases.
pub fn biased_output(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> Output {
    with_biases(chair, x, output(chair, &chair_state(x), &acting(x, u), still))
}

fn with_biases(chair: &Chair, x: &BiasedState, mut y: Output) -> Output {
    y[0] += chair.reference_offset() * x[HEADING_OFFSET];
    y[1] -= x[HEADING_OFFSET];
    for k in 0..4 {
        y[2 + k] += x[GYRO_BIAS + k];
    }
    y
}

/// [`observe`] with biases.
#[inline]
pub fn biased_observe(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> Observation<13> {
    let seen = observe(chair, &chair_state(x), &acting(x, u), still);
    let mut jacobian = SMatrix::<f64, 6, 13>::zeros();
    jacobian.fixed_columns_mut::<6>(0).copy_from(&seen.jacobian);
    jacobian[(0, HEADING_OFFSET)] = chair.reference_offset();
    jacobian[(1, HEADING_OFFSET)] = -1.0;
    for k in 0..4 {
        jacobian[(2 + k, GYRO_BIAS + k)] = 1.0;
    }
    jacobian.fixed_view_mut::<1, 2>(3, FORCE_GAIN).copy_from(&force_gradient(chair, u, still)); // a_x contains v'
    Observation { output: with_biases(chair, x, seen.output), jacobian, tilt_lever: seen.tilt_lever }
}

/// [`biased_derivative`] with the measured specific force `accel_x` in place of the drive force:
/// `v' = accel_x - b_ax - (a_x - v')`, the bracket being the model's without `v'`. Independent of
/// mass, drag and force; the drive moment still enters through `r'`.
pub fn acceleration_driven(chair: &Chair, x: &BiasedState, u: &Command, accel_x: f64, still: bool) -> BiasedState {
    let mut rate = biased_derivative(chair, x, u, still);
    if !still {
        let rest = output(chair, &chair_state(x), &acting(x, u), still)[3] - rate[V];
        rate[V] = accel_x - x[ACCEL_X_BIAS] - rest;
    }
    rate
}

/// [`acceleration_driven`] and the Jacobian of its first five rows at the price of one.
pub fn acceleration_driven_linearise(
    chair: &Chair,
    x: &BiasedState,
    u: &Command,
    accel_x: f64,
    still: bool,
) -> (BiasedState, SMatrix<f64, 5, 13>) {
    let (mut rate, mut jacobian) = biased_linearise(chair, x, u, still);
    if !still {
        let seen = observe(chair, &chair_state(x), &acting(x, u), still);
        rate[V] = accel_x - x[ACCEL_X_BIAS] - (seen.output[3] - rate[V]);
        // Row v' = -(row a_x of the sensors without v').
        for column in [ALPHA, V, R, XI, W] {
            jacobian[(V, column)] -= seen.jacobian[(3, column)];
        }
        jacobian.fixed_view_mut::<1, 2>(V, FORCE_GAIN).fill(0.0);
        jacobian[(V, ACCEL_X_BIAS)] = -1.0;
    }
    (rate, jacobian)
}
