//! What the sensors read: `y = h(x, u)`, its Jacobian and the shape of its noise.

use super::motion::accelerations;
use super::{ALPHA, Accelerations, Accelerometer, COLUMNS, Chair, Command, Gyro, Output, R, S, State, Trig, V, W, XI};
use nalgebra::{Matrix2, SMatrix, Vector3};

/// `y = h(x, u)`, as the [module's page](super) has it (eq. 20 corrected, or a point of a rigid body).
pub fn output(chair: &Chair, x: &State, u: &Command, still: bool) -> Output {
    let trig = Trig::of(x);
    reading(chair, x, &trig, &accelerations(chair, x, &trig, u, still))
}

/// What the sensors are expected to read, and how that depends on the state of `N` numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<const N: usize> {
    /// The reading.
    pub output: Output,
    /// Its derivative over the state (eq. 45 corrected).
    pub jacobian: SMatrix<f64, 6, N>,
    /// As [`tilt_lever`].
    pub tilt_lever: Vector3<f64>,
}

/// [`output`], its Jacobian and [`tilt_lever`] at the price of one.
#[inline]
pub fn observe(chair: &Chair, x: &State, u: &Command, still: bool) -> Observation<6> {
    let trig = Trig::of(x);
    let a = accelerations(chair, x, &trig, u, still);
    Observation {
        output: reading(chair, x, &trig, &a),
        jacobian: sensitivity(chair, x, &trig, &a),
        tilt_lever: lever(chair, trig.sa, trig.ca),
    }
}

fn reading(chair: &Chair, x: &State, trig: &Trig, a: &Accelerations) -> Output {
    let Trig { sa, ca, sx, cx } = *trig;
    let (v, r, w, g) = (x[V], x[R], x[W], chair.gravity);
    let [dx, dy, dz] = chair.lever();
    let gyro = match chair.gyro {
        Gyro::Body => w * sa,
        Gyro::Paper => r * ca * sx + w * sa * cx,
        Gyro::Euler => (r * ca * sx + w * sa * cx) / cosine_of_pitch(sa * sx),
    };
    let (ax, ay, az) = match chair.accelerometer {
        Accelerometer::Paper => (a.v_dot + g * sa * sx - dx * r * r, v * r + g * ca * sx - dy * r * r, g * cx),
        Accelerometer::Rigid => {
            let (p, q) = (w * ca, -w * sa);
            (
                a.v_dot + g * sa * sx - dy * a.r_dot + p * q * dy - dx * (q * q + r * r),
                v * r + g * ca * sx + dx * a.r_dot + p * q * dx - dy * (p * p + r * r),
                g * cx - v * q + 2.0 * r * (p * dx + q * dy) - dz * (p * p + q * q),
            )
        }
    };
    let travel = x[S] - chair.reference_offset() * (x[ALPHA] - chair.heading_reference);
    Output::new(travel, x[ALPHA], gyro, ax, ay, az)
}

fn sensitivity(chair: &Chair, x: &State, trig: &Trig, a: &Accelerations) -> SMatrix<f64, 6, 6> {
    let Trig { sa, ca, sx, cx } = *trig;
    let (v, r, w, g) = (x[V], x[R], x[W], chair.gravity);
    let [dx, dy, dz] = chair.lever();
    let mut jacobian = SMatrix::<f64, 6, 6>::zeros();
    jacobian[(0, S)] = 1.0;
    jacobian[(0, ALPHA)] = -chair.reference_offset();
    jacobian[(1, ALPHA)] = 1.0;

    let rate = r * ca * sx + w * sa * cx; // eq. 3, the rate of sin(phi)
    match chair.gyro {
        Gyro::Body => {
            jacobian[(2, ALPHA)] = w * ca;
            jacobian[(2, W)] = sa;
        }
        Gyro::Paper | Gyro::Euler => {
            let gradient = [-r * sa * sx + w * ca * cx, ca * sx, r * ca * cx - w * sa * sx, sa * cx];
            let sine_gradient = [ca * sx, 0.0, sa * cx, 0.0];
            let (scale, pull) = match chair.gyro {
                Gyro::Euler => {
                    let cosine = cosine_of_pitch(sa * sx);
                    (1.0 / cosine, rate * sa * sx / (cosine * cosine * cosine))
                }
                _ => (1.0, 0.0),
            };
            for (k, column) in [ALPHA, R, XI, W].into_iter().enumerate() {
                jacobian[(2, column)] = scale * gradient[k] + pull * sine_gradient[k];
            }
        }
    }

    // Gravity and centripetal terms that both accelerometer models share.
    for (k, column) in COLUMNS.into_iter().enumerate() {
        jacobian[(3, column)] = a.v_gradient[k];
    }
    jacobian[(3, ALPHA)] += g * ca * sx;
    jacobian[(3, XI)] += g * sa * cx;
    jacobian[(3, R)] -= 2.0 * dx * r;
    jacobian[(4, ALPHA)] = -g * sa * sx;
    jacobian[(4, V)] = r;
    jacobian[(4, R)] = v - 2.0 * dy * r;
    jacobian[(4, XI)] = g * ca * cx;
    jacobian[(5, XI)] = -g * sx;
    if chair.accelerometer == Accelerometer::Rigid {
        let (p, q) = (w * ca, -w * sa);
        for (k, column) in COLUMNS.into_iter().enumerate() {
            jacobian[(3, column)] -= dy * a.r_gradient[k];
            jacobian[(4, column)] += dx * a.r_gradient[k];
        }
        // dp/dalpha = q, dq/dalpha = -p, dp/dw = cos(alpha), dq/dw = -sin(alpha)
        jacobian[(3, ALPHA)] += dy * (q * q - p * p) + 2.0 * dx * p * q;
        jacobian[(3, W)] = dy * (ca * q - sa * p) + 2.0 * dx * q * sa;
        jacobian[(4, ALPHA)] += dx * (q * q - p * p) - 2.0 * dy * p * q;
        jacobian[(4, W)] = dx * (ca * q - sa * p) - 2.0 * dy * p * ca;
        jacobian[(5, ALPHA)] = v * p + 2.0 * r * (q * dx - p * dy);
        jacobian[(5, V)] = -q;
        jacobian[(5, R)] = 2.0 * (p * dx + q * dy);
        jacobian[(5, W)] = v * sa + 2.0 * r * (ca * dx - sa * dy) - 2.0 * dz * w;
    }
    jacobian
}

/// Nose-up pitch of the body, rad, `phi = asin(sin(alpha) sin(xi))` (eq. 1), and its gradient over
/// `[alpha, xi]`.
pub fn pitch(alpha: f64, xi: f64) -> (f64, [f64; 2]) {
    let ((sa, ca), (sx, cx)) = (alpha.sin_cos(), xi.sin_cos());
    let cosine = cosine_of_pitch(sa * sx);
    ((sa * sx).clamp(-1.0, 1.0).asin(), [ca * sx / cosine, sa * cx / cosine])
}

/// `cos(phi)` from `sin(phi)`, kept away from the pole of a chair standing on end.
fn cosine_of_pitch(sine: f64) -> f64 {
    (1.0 - sine * sine).max(1e-12).sqrt()
}

/// Covariance of `(s_enc, alpha_enc)` for independent wheel angles of variance `sigma^2`, rad^2:
/// `A A^T sigma^2` with `A = (R/T) [[r2, r1], [1, -1]]`. Diagonal only for `r1 = r2`.
pub fn encoder_covariance(chair: &Chair, sigma: f64) -> Matrix2<f64> {
    let (r1, r2) = (chair.body.reference_to_right, chair.body.reference_to_left);
    let scale = chair.body.wheel_radius * sigma / chair.body.track();
    Matrix2::new(r1 * r1 + r2 * r2, r2 - r1, r2 - r1, 2.0) * (scale * scale)
}

/// What `xi''` adds to the rigid accelerometer per rad/s^2, m (m); the model leaves it to the noise.
pub fn tilt_lever(chair: &Chair, alpha: f64) -> Vector3<f64> {
    let (sa, ca) = alpha.sin_cos();
    lever(chair, sa, ca)
}

fn lever(chair: &Chair, sa: f64, ca: f64) -> Vector3<f64> {
    let [dx, dy, dz] = chair.lever();
    match chair.accelerometer {
        Accelerometer::Paper => Vector3::zeros(),
        Accelerometer::Rigid => Vector3::new(-dz * sa, -dz * ca, dx * sa + dy * ca),
    }
}
