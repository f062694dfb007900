//! Equations of motion `x' = f(x, u)` and their Jacobian.

use super::{ALPHA, Accelerations, COLUMNS, Chair, Command, Dynamics, MotionJacobian, R, S, State, Trig, V, W, XI};

/// `v'` and `r'` with their partial derivatives over `v`, `r`, `gx`, `gy`, `gz`.
pub(super) struct Motion {
    pub v_dot: f64,
    pub r_dot: f64,
    pub v_partials: [f64; 5],
    pub r_partials: [f64; 5],
}

/// `v'` and `r'` from what acts along the heading and about the normal.
///
/// `gx = sin(alpha) sin(xi)` and `gy = cos(alpha) sin(xi)` are the shares of gravity along and
/// across the heading, `gz = cos(xi)` the share on the plane's normal. Inlined, so that who needs no
/// partial derivatives does not pay for them.
#[inline(always)]
pub(super) fn motion(chair: &Chair, v: f64, r: f64, [gx, gy, gz]: [f64; 3], u: &Command) -> Motion {
    let (mass, l) = (chair.body.mass, chair.body.com_ahead);
    let weight = mass * chair.gravity;
    let mut force = u[0] - chair.body.drag * v - weight * gx;
    let mut moment = u[1] - chair.body.yaw_drag * r - weight * l * gy;
    let mut along = [-chair.body.drag, 0.0, -weight, 0.0, 0.0];
    let mut about = [0.0, -chair.body.yaw_drag, 0.0, -weight * l, 0.0];
    if chair.dynamics == Dynamics::Full {
        let (rolling, rolling_slope) =
            dry_friction(weight * chair.rolling.coefficient, v, chair.rolling.smoothing_speed);
        let (turning, turning_slope) = dry_friction(chair.body.yaw_friction, r, chair.rolling.smoothing_yaw_rate);
        force += mass * l * r * r - rolling * gz;
        moment -= mass * l * v * r + turning;
        along[0] -= rolling_slope * gz;
        along[1] += 2.0 * mass * l * r;
        along[4] -= rolling;
        about[0] -= mass * l * r;
        about[1] -= mass * l * v + turning_slope;
    }
    let (per_mass, per_inertia) = (1.0 / chair.inertial_mass(), 1.0 / chair.inertia_at_axle());
    Motion {
        v_dot: force * per_mass,
        r_dot: moment * per_inertia,
        v_partials: along.map(|f| f * per_mass),
        r_partials: about.map(|m| m * per_inertia),
    }
}

/// Friction `level tanh(rate/width)` and its slope over the rate.
#[inline(always)]
fn dry_friction(level: f64, rate: f64, width: f64) -> (f64, f64) {
    if level == 0.0 {
        return (0.0, 0.0);
    }
    let share = (rate / width).tanh();
    (level * share, level * (1.0 - share * share) / width)
}

pub(super) fn accelerations(chair: &Chair, x: &State, trig: &Trig, u: &Command, still: bool) -> Accelerations {
    if still {
        return Accelerations::default();
    }
    let Trig { sa, ca, sx, cx } = *trig;
    let motion = motion(chair, x[V], x[R], [sa * sx, ca * sx, cx], u);
    let chain = |[v, r, gx, gy, gz]: [f64; 5]| {
        [gx * ca * sx - gy * sa * sx, v, r, gx * sa * cx + gy * ca * cx - gz * sx] // alpha, v, r, xi
    };
    Accelerations {
        v_dot: motion.v_dot,
        r_dot: motion.r_dot,
        v_gradient: chain(motion.v_partials),
        r_gradient: chain(motion.r_partials),
    }
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
#[inline]
pub fn derivative(chair: &Chair, x: &State, u: &Command, still: bool) -> State {
    let Trig { sa, ca, sx, cx } = Trig::of(x);
    let (v_dot, r_dot) = if still {
        (0.0, 0.0)
    } else {
        let motion = motion(chair, x[V], x[R], [sa * sx, ca * sx, cx], u);
        (motion.v_dot, motion.r_dot)
    };
    rates(chair, x, sa, v_dot, r_dot)
}

fn rates(chair: &Chair, x: &State, sa: f64, v_dot: f64, r_dot: f64) -> State {
    State::new(x[V] + chair.pitch_travel * x[W] * sa, x[R], v_dot, r_dot, x[W], 0.0)
}

/// [`derivative`] and its Jacobian (eq. 44 corrected) at the price of one.
#[inline]
pub fn linearise(chair: &Chair, x: &State, u: &Command, still: bool) -> (State, MotionJacobian) {
    let trig = Trig::of(x);
    let Trig { sa, ca, .. } = trig;
    let a = accelerations(chair, x, &trig, u, still);
    let mut jacobian = MotionJacobian::zeros();
    jacobian[(S, ALPHA)] = chair.pitch_travel * x[W] * ca;
    jacobian[(S, V)] = 1.0;
    jacobian[(S, W)] = chair.pitch_travel * sa;
    jacobian[(ALPHA, R)] = 1.0;
    jacobian[(XI, W)] = 1.0;
    for (k, column) in COLUMNS.into_iter().enumerate() {
        jacobian[(V, column)] = a.v_gradient[k];
        jacobian[(R, column)] = a.r_gradient[k];
    }
    (rates(chair, x, sa, a.v_dot, a.r_dot), jacobian)
}
