//! The state with sensor biases: `[x, b_g, b_ax, b_ay, b_az, a_off]`.
//!
//! The biases of gyro and accelerometer are added to rows 3 to 6 of the measurement; `a_off` is the
//! error of the encoders' heading reference: `alpha_enc = alpha - a_off`.

use super::{
    ALPHA, Chair, Command, Output, R, State, V, W, XI, derivative, jacobian, observe, output, output_jacobian,
};
use nalgebra::{SMatrix, SVector};

/// State `[s, alpha, v, r, xi, w, b_g, b_ax, b_ay, b_az, a_off]`; biases in rad/s, m/s^2 and rad.
pub type BiasedState = SVector<f64, 11>;

const GYRO_BIAS: usize = 6;
const ACCEL_X_BIAS: usize = 7;
const HEADING_OFFSET: usize = 10;

fn chair_state(x: &BiasedState) -> State {
    x.fixed_rows::<6>(0).into_owned()
}

/// `x' = f(x, u)` of [`derivative`]; biases stay as they are.
pub fn biased_derivative(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> BiasedState {
    let mut rate = BiasedState::zeros();
    rate.fixed_rows_mut::<6>(0).copy_from(&derivative(chair, &chair_state(x), u, still));
    rate
}

/// Jacobian of [`biased_derivative`].
pub fn biased_jacobian(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> SMatrix<f64, 11, 11> {
    let mut all = SMatrix::<f64, 11, 11>::zeros();
    all.fixed_view_mut::<6, 6>(0, 0).copy_from(&jacobian(chair, &chair_state(x), u, still));
    all
}

/// `y = h(x, u)` of [`output`] with biases.
pub fn biased_output(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> Output {
    with_biases(chair, x, output(chair, &chair_state(x), u, still))
}

fn with_biases(chair: &Chair, x: &BiasedState, mut y: Output) -> Output {
    y[0] += chair.reference_offset() * x[HEADING_OFFSET];
    y[1] -= x[HEADING_OFFSET];
    for k in 0..4 {
        y[2 + k] += x[GYRO_BIAS + k];
    }
    y
}

/// Jacobian of [`biased_output`].
pub fn biased_output_jacobian(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> SMatrix<f64, 6, 11> {
    biased_observe(chair, x, u, still).1
}

/// [`biased_output`] and [`biased_output_jacobian`] at the price of one.
pub fn biased_observe(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> (Output, SMatrix<f64, 6, 11>) {
    let (y, jacobian) = observe(chair, &chair_state(x), u, still);
    let mut all = SMatrix::<f64, 6, 11>::zeros();
    all.fixed_view_mut::<6, 6>(0, 0).copy_from(&jacobian);
    all[(0, HEADING_OFFSET)] = chair.reference_offset();
    all[(1, HEADING_OFFSET)] = -1.0;
    for k in 0..4 {
        all[(2 + k, GYRO_BIAS + k)] = 1.0;
    }
    (with_biases(chair, x, y), all)
}

/// [`biased_derivative`] with the measured specific force `accel_x` in place of the drive force:
/// `v' = accel_x - b_ax - (a_x - v')`, the bracket being the model's without `v'`. Independent of
/// mass, drag and force; the drive moment still enters through `r'`.
pub fn acceleration_driven(chair: &Chair, x: &BiasedState, u: &Command, accel_x: f64, still: bool) -> BiasedState {
    let mut rate = biased_derivative(chair, x, u, still);
    if !still {
        let state = chair_state(x);
        let rest = output(chair, &state, u, still)[3] - rate[V];
        rate[V] = accel_x - x[ACCEL_X_BIAS] - rest;
    }
    rate
}

/// Jacobian of [`acceleration_driven`].
pub fn acceleration_driven_jacobian(chair: &Chair, x: &BiasedState, u: &Command, still: bool) -> SMatrix<f64, 11, 11> {
    let mut all = biased_jacobian(chair, x, u, still);
    if !still {
        let state = chair_state(x);
        let sensor = output_jacobian(chair, &state, u, still);
        // Row v' = -(row a_x of the sensors without v').
        for column in [ALPHA, V, R, XI, W] {
            all[(V, column)] -= sensor[(3, column)];
        }
        all[(V, ACCEL_X_BIAS)] = -1.0;
    }
    all
}
