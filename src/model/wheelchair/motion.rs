//! Equations of motion `x' = f(x, u)` and their Jacobian.

use super::{ALPHA, Accelerations, COLUMNS, Chair, Command, Dynamics, Jacobian, R, S, State, Trig, V, W, XI};

/// `v'` and `r'` from what acts along the heading and about the normal.
///
/// `gx = sin(alpha) sin(xi)` and `gy = cos(alpha) sin(xi)` are the shares of gravity along and
/// across the heading, `gz = cos(xi)` the share on the plane's normal.
pub(super) fn accelerations(chair: &Chair, v: f64, r: f64, gravity: [f64; 3], u: &Command) -> (f64, f64) {
    let [gx, gy, gz] = gravity;
    let (mass, l) = (chair.mass, chair.com_ahead);
    let weight = mass * chair.gravity;
    let mut force = u[0] - chair.drag * v - weight * gx;
    let mut moment = u[1] - chair.yaw_drag * r - weight * l * gy;
    if chair.dynamics == Dynamics::Full {
        force += mass * l * r * r - weight * chair.rolling_coefficient * gz * (v / chair.smoothing_speed).tanh();
        moment -= mass * l * v * r + chair.yaw_friction * (r / chair.smoothing_yaw_rate).tanh();
    }
    (force / chair.inertial_mass(), moment / chair.inertia_at_axle())
}

/// Partial derivatives of [`accelerations`] over `v`, `r`, `gx`, `gy`, `gz`: rows `v'` and `r'`.
pub(super) fn acceleration_partials(chair: &Chair, v: f64, r: f64, gz: f64) -> [[f64; 5]; 2] {
    let (mass, l) = (chair.mass, chair.com_ahead);
    let weight = mass * chair.gravity;
    let mut force = [-chair.drag, 0.0, -weight, 0.0, 0.0];
    let mut moment = [0.0, -chair.yaw_drag, 0.0, -weight * l, 0.0];
    if chair.dynamics == Dynamics::Full {
        let rolling = (v / chair.smoothing_speed).tanh();
        let turning = (r / chair.smoothing_yaw_rate).tanh();
        let resistance = weight * chair.rolling_coefficient;
        force[0] -= resistance * gz * (1.0 - rolling * rolling) / chair.smoothing_speed;
        force[1] += 2.0 * mass * l * r;
        force[4] -= resistance * rolling;
        moment[0] -= mass * l * r;
        moment[1] -= mass * l * v + chair.yaw_friction * (1.0 - turning * turning) / chair.smoothing_yaw_rate;
    }
    [force.map(|f| f / chair.inertial_mass()), moment.map(|m| m / chair.inertia_at_axle())]
}

pub(super) fn accelerations_with_gradients(
    chair: &Chair,
    x: &State,
    trig: &Trig,
    u: &Command,
    still: bool,
) -> Accelerations {
    if still {
        return Accelerations::default();
    }
    let Trig { sa, ca, sx, cx } = *trig;
    let (v_dot, r_dot) = accelerations(chair, x[V], x[R], [sa * sx, ca * sx, cx], u);
    let chain = |[v, r, gx, gy, gz]: [f64; 5]| {
        [gx * ca * sx - gy * sa * sx, v, r, gx * sa * cx + gy * ca * cx - gz * sx] // alpha, v, r, xi
    };
    let [v_partials, r_partials] = acceleration_partials(chair, x[V], x[R], cx);
    Accelerations { v_dot, r_dot, v_gradient: chain(v_partials), r_gradient: chain(r_partials) }
}

/// `x' = f(x, u)` (Oh & Hori, eq. 16-19 corrected, or the full Newton-Euler equations):
///
/// ```text
/// s' = v + renc w sin(alpha)       alpha' = r       xi' = w       w' = 0
/// v' = (u_f - D v - M crr g cos(xi) tanh(v/vs) + M l r^2 - M g sin(alpha) sin(xi)) / (M + mrot)
/// r' = (u_r - B r - tauc tanh(r/ws) - M l v r - M g l cos(alpha) sin(xi)) / (Ic + M l^2 + irot)
/// ```
///
/// The source's model has neither `crr`, `tauc`, `mrot`, `irot` nor the terms in `M l r`.
/// `still`: brakes or static friction hold the chair, `v' = r' = 0` whatever the command.
pub fn derivative(chair: &Chair, x: &State, u: &Command, still: bool) -> State {
    let ((sa, ca), (sx, cx)) = (x[ALPHA].sin_cos(), x[XI].sin_cos());
    let (v_dot, r_dot) = if still { (0.0, 0.0) } else { accelerations(chair, x[V], x[R], [sa * sx, ca * sx, cx], u) };
    State::new(x[V] + chair.pitch_travel * x[W] * sa, x[R], v_dot, r_dot, x[W], 0.0)
}

/// Jacobian of [`derivative`] over the state (eq. 44 corrected).
pub fn jacobian(chair: &Chair, x: &State, u: &Command, still: bool) -> Jacobian {
    let trig = Trig::of(x);
    let Trig { sa, ca, .. } = trig;
    let a = accelerations_with_gradients(chair, x, &trig, u, still);
    let mut jacobian = Jacobian::zeros();
    jacobian[(S, ALPHA)] = chair.pitch_travel * x[W] * ca;
    jacobian[(S, V)] = 1.0;
    jacobian[(S, W)] = chair.pitch_travel * sa;
    jacobian[(ALPHA, R)] = 1.0;
    jacobian[(XI, W)] = 1.0;
    for (k, column) in COLUMNS.into_iter().enumerate() {
        jacobian[(V, column)] = a.v_gradient[k];
        jacobian[(R, column)] = a.r_gradient[k];
    }
    jacobian
}
