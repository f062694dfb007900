//! A wheelchair with power assistance on a slope: motion, sensors and their Jacobians.
//!
//! Source: S. Oh and Y. Hori, *Development of an Extended Operational States Observer of a Power
//! Assist Wheelchair*, equations (1)-(20) and (44)-(45), with the corrections listed below.
//!
//! # Frames and signs
//! The slope is a plane with the horizontal contour line `e_h`, the uphill direction `e_u` and the
//! outward normal `e_n = e_h x e_u`; `xi` is its tilt, positive uphill. The body frame sits at the
//! midpoint C of the driven rear axle: x forward `= cos(alpha) e_h + sin(alpha) e_u`, y left, z along
//! `e_n`. The heading `alpha` counts counter-clockwise: `pi/2` climbs straight, 0 runs along the
//! contour with uphill on the left. Up in body axes is `(sin(alpha) sin(xi), cos(alpha) sin(xi),
//! cos(xi))`, so the nose-up pitch obeys `sin(phi) = sin(alpha) sin(xi)` (eq. 1). While only `alpha`
//! and `xi` change, the body turns with `p = w cos(alpha)`, `q = -w sin(alpha)`, `r = alpha'`,
//! where `w = xi'`. `(alpha, xi, w) -> (alpha + pi, -xi, -w)` describes the same pose.
//!
//! State `x = [s, alpha, v, r, xi, w]` (m, rad, m/s, rad/s, rad, rad/s), command `u = [u_f, u_r]`
//! (N, N m), measurement `y = [s_enc, alpha_enc, gyro, a_x, a_y, a_z]`; the gyro is positive nose-up
//! and the accelerometer reads specific force: `(0, 0, +g)` at rest on flat ground.
//!
//! # Equations
//! With `gx = sin(alpha) sin(xi)`, `gy = cos(alpha) sin(xi)`, `gz = cos(xi)`, the mass `M'` and the yaw inertia about the
//! axle `I' = Ic + M l^2`, both with what turns with the wheels, from (1)-(20), corrected:
//!
//! ```text
//! s' = v,  alpha' = r,  xi' = w
//! M' v' = u_f - D v - M g gx + M l r^2 - crr M g gz tanh(v/vs)
//! I' r' = u_r - B r - M g l gy - M l v r - tauc tanh(r/ws)
//!
//! s_enc = s - yP (alpha - alpha_ref)          alpha_enc = alpha         gyro = w sin(alpha)
//! a_x = v' + g gx - dy r' + p q dy - dx (q^2 + r^2)
//! a_y = v r + g gy + dx r' + p q dx - dy (p^2 + r^2)
//! a_z = g gz - v q + 2 r (p dx + q dy) - dz (p^2 + q^2)
//! ```
//!
//! With `v'` from the motion, gravity cancels from `a_x`: it measures the force, not the slope.
//!
//! # Errata of the source
//! | equation | printed | correct | reason |
//! |---|---|---|---|
//! | (2) | `phi' = asin(..)` | `phi = asin(sin(alpha) sin(xi))` | dimension |
//! | (3) as gyro | `r cos(alpha) sin(xi) + w sin(alpha) cos(xi)` | `w sin(alpha)` | (3) is `d sin(phi)/dt`, an Euler rate; a strapped-down gyro across the axle reads nothing while the chair turns on a slope at rest |
//! | (5), (20) | `M x3 x4` | `x3 x4` | force in place of acceleration |
//! | (6) | `a_z = g cos(xi)` | `- v q` and lever terms | the plane tilts under the moving chair |
//! | (7), (8) | `m alpha'^2 Delta` | `alpha'^2 Delta` | dimension; `Delta_x = -dy`, `Delta_y = -dx`: the index names the axis crosswise |
//! | (9), (10) | no sides | `r1` right, `r2` left; (10) needs a constant | (10) counts from the encoders' zero |
//! | (11), (12) to (17) | `I`, constant `B` | `Ic + M l^2`, `B + M l v` | no side slip of the driven axle |
//! | (16) | `x_l' = ..` | `x_l'' = ..` | misprint |
//! | (19) row 4 | `E/T`, `M/T g ..` | `B/I`, `M g l/I` | misprint, lever lost |
//! | (20) rows 4, 5 | `m_acc d x4^2` | `-dx x4^2`, `-dy x4^2` and `r'` terms | dimension |
//! | (28)-(30) | `K R K(t)` | `K R K^T` | misprint |
//! | (39), (43) | `G V G^T`, (44) used as printed | `Phi P Phi^T + Q`, `Phi = I + F dt + ..` | (44) is the continuous Jacobian |
//! | (44) | `M/I g sin sin` | `M g l/I sin sin` | lever lost; the sign is right |
//! | (45) | `M x4`, `M x3`, row 7 | `x4`, `x3`, no row 7 | there are six outputs |
//!
//! The climbing pose `pi/2` is an unstable point of the heading: gravity turns the nose downhill.
//!
//! # What is neglected
//! The tilt of the plane changes slowly (its rate does not drive `v'` and `r'`), the driven axle
//! does not slip sideways, and `xi''` enters the accelerometer only as noise ([`tilt_lever`]).

mod biased;
pub mod biased_gravity;
mod encoder;
pub mod gravity;
mod motion;
mod sensors;

pub use biased::{
    BiasedState, FORCE_GAIN, FORCE_OFFSET, GYRO_BIAS, HEADING_OFFSET, acceleration_driven,
    acceleration_driven_linearise, biased_derivative, biased_linearise, biased_observe, biased_output,
};
pub use encoder::{Unwrapper, wheel_angles, wheel_travel};
pub use motion::{derivative, linearise};
pub use sensors::{Observation, encoder_covariance, observe, output, pitch, tilt_lever};

use nalgebra::{RowVector2, SMatrix, SVector};

/// State `[s, alpha, v, r, xi, w]`.
pub type State = SVector<f64, 6>;
/// Command `[u_f, u_r]`: drive force along the heading, N, and drive moment about the normal, N m.
pub type Command = SVector<f64, 2>;
/// Measurement `[s_enc, alpha_enc, gyro, a_x, a_y, a_z]`.
pub type Output = SVector<f64, 6>;

/// Index of the distance travelled by the axle's midpoint, m.
pub const S: usize = 0;
/// Index of the heading, rad.
pub const ALPHA: usize = 1;
/// Index of the speed, m/s.
pub const V: usize = 2;
/// Index of the yaw rate, rad/s.
pub const R: usize = 3;
/// Index of the slope, rad.
pub const XI: usize = 4;
/// Index of the slope's rate, rad/s.
pub const W: usize = 5;

/// Equations of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dynamics {
    /// The source's equations (16)-(19), corrected.
    Paper,
    /// Newton-Euler without side slip, with rolling resistance, yaw friction and wheel inertia.
    Full,
}

/// What the pitch gyro reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gyro {
    /// A gyro strapped down along the axle: `w sin(alpha)`.
    Body,
    /// The source's equation (3), the rate of `sin(phi)`.
    Paper,
    /// The rate of the pitch angle, `d phi/dt`.
    Euler,
}

/// What the accelerometer reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accelerometer {
    /// The source's equation (20), corrected, without `r'` and `w` terms.
    Paper,
    /// A point of a rigid body.
    Rigid,
}

variables! {
    /// The chair with its user.
    #[derive(Copy)]
    pub struct ChairParameters {
        /// Mass of chair and user (M).
        mass: f64 = 100.0, "kg", [1.0, 1e4], essential;
        /// Yaw inertia of chair and user about their common centre of mass (Ic).
        yaw_inertia: f64 = 7.0, "kg.m2", [1e-3, 1e5], essential;
        /// Distance of the centre of mass forward of the driven axle (l).
        com_ahead: f64 = 0.12, "m", [-2.0, 2.0], essential;
        /// Viscous drag that opposes the speed (D).
        drag: f64 = 12.0, "N.s/m", [0.0, 1e4];
        /// Viscous drag that opposes the yaw rate (B).
        yaw_drag: f64 = 3.0, "N.m.s/rad", [0.0, 1e4];
        /// Dry friction that opposes turning, mostly of the casters (tauc).
        yaw_friction: f64 = 0.0, "N.m", [0.0, 1e3];
        /// Radius of the driven wheels (R).
        wheel_radius: f64 = 0.305, "m", [0.01, 2.0], essential;
        /// Error of the wheel radius over the radius (one standard deviation), which counts in the deviations of what the encoders give: speed, distance, yaw rate, heading. Tyres roll on 0.95 to 1 of the radius that they are sold with; 0.005 if it was calibrated over a known distance.
        wheel_radius_std: f64 = 0.02, "1", [0.0, 1.0], tunable;
        /// Difference of the two wheels' radii over the radius (one standard deviation), which counts in the deviations of yaw rate and heading; 0.001 if straight lines were driven to calibrate it.
        wheel_radius_difference_std: f64 = 0.007, "1", [0.0, 1.0], tunable;
        /// Distance from the encoder reference point to the right wheel; half the track for the axle's midpoint (r1).
        reference_to_right: f64 = 0.28, "m", [1e-3, 5.0], essential;
        /// Distance from the encoder reference point to the left wheel; half the track for the axle's midpoint (r2).
        reference_to_left: f64 = 0.26, "m", [1e-3, 5.0], essential;
        /// Spin inertia of one driven wheel with what turns with it.
        wheel_inertia: f64 = 0.0, "kg.m2", [0.0, 1e3];
    }
}

variables! {
    /// Rolling resistance.
    #[derive(Copy)]
    pub struct RollingParameters {
        /// Rolling resistance coefficient; 0.01 to 0.02 on a hard floor (crr).
        coefficient: f64 = 0.0, "1", [0.0, 1.0];
        /// Speed around standstill over which rolling resistance builds up (vs).
        smoothing_speed: f64 = 0.05, "m/s", [1e-4, 10.0];
        /// Yaw rate around standstill over which dry yaw friction builds up (ws).
        smoothing_yaw_rate: f64 = 0.03, "rad/s", [1e-4, 10.0];
    }
}

variables! {
    /// Where the accelerometer sits.
    #[derive(Copy)]
    pub struct ImuParameters {
        /// Accelerometer forward of the driven axle's midpoint (dx).
        x: f64 = 0.10, "m", [-5.0, 5.0], essential;
        /// Accelerometer to the left of the driven axle's midpoint (dy).
        y: f64 = 0.01, "m", [-5.0, 5.0], essential;
        /// Accelerometer above the driven axle's midpoint (dz).
        z: f64 = 0.10, "m", [-5.0, 5.0], essential;
    }
}

impl ChairParameters {
    /// Distance between the driven wheels, m (T).
    pub fn track(&self) -> f64 {
        self.reference_to_right + self.reference_to_left
    }
}

/// A chair with its user, its sensors and the equations that describe them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chair {
    /// Chair and user.
    pub body: ChairParameters,
    /// Rolling resistance.
    pub rolling: RollingParameters,
    /// Where the accelerometer sits.
    pub imu: ImuParameters,
    /// Gravity, m/s^2.
    pub gravity: f64,
    /// Heading at which both encoders read zero, rad.
    pub heading_reference: f64,
    /// Encoder travel per radian of body pitch, m: the wheel radius if the encoders count rotation
    /// relative to the frame, 0 if relative to the ground (renc).
    pub pitch_travel: f64,
    /// Mass equivalent of the spinning wheels, kg (mrot); follows from their inertia.
    pub rotating_mass: f64,
    /// Yaw inertia equivalent of the spinning wheels, kg m^2 (irot); follows from their inertia.
    pub rotating_inertia: f64,
    /// Equations of motion.
    pub dynamics: Dynamics,
    /// What the gyro reads.
    pub gyro: Gyro,
    /// What the accelerometer reads.
    pub accelerometer: Accelerometer,
}

impl Chair {
    /// A chair under standard gravity whose encoders count rotation relative to the ground and read zero at heading
    /// zero, with the full equations.
    pub fn new(body: ChairParameters, rolling: RollingParameters, imu: ImuParameters) -> Self {
        let half_track = 0.5 * body.track();
        let rotating_mass = 2.0 * body.wheel_inertia / (body.wheel_radius * body.wheel_radius);
        Self {
            body,
            rolling,
            imu,
            gravity: super::STANDARD_GRAVITY,
            heading_reference: 0.0,
            pitch_travel: 0.0,
            rotating_mass,
            rotating_inertia: rotating_mass * half_track * half_track,
            dynamics: Dynamics::Full,
            gyro: Gyro::Body,
            accelerometer: Accelerometer::Rigid,
        }
    }

    /// Accelerometer position in the body frame, m, `[dx, dy, dz]`.
    pub fn lever(&self) -> [f64; 3] {
        [self.imu.x, self.imu.y, self.imu.z]
    }

    /// Encoder reference point to the left of the axle's midpoint, m (yP).
    pub fn reference_offset(&self) -> f64 {
        0.5 * (self.body.reference_to_right - self.body.reference_to_left)
    }

    /// Inertial mass along the heading, kg [M + mrot].
    pub fn inertial_mass(&self) -> f64 {
        match self.dynamics {
            Dynamics::Paper => self.body.mass,
            Dynamics::Full => self.body.mass + self.rotating_mass,
        }
    }

    /// Yaw inertia about the driven axle, kg m^2 [IP + irot, IP = Ic + M l^2].
    pub fn inertia_at_axle(&self) -> f64 {
        let body = &self.body;
        let about_axle = body.yaw_inertia + body.mass * body.com_ahead * body.com_ahead;
        match self.dynamics {
            Dynamics::Paper => about_axle,
            Dynamics::Full => about_axle + self.rotating_inertia,
        }
    }
}

/// What acts on the chair when `u` is reported: the force's gain is wrong by a share, and some of it in N is not
/// reported at all.
fn acting_command(u: &Command, gain_error: f64, offset: f64) -> Command {
    Command::new((1.0 + gain_error) * u[0] + offset, u[1])
}

/// How gain error and offset of the force change `v'`.
fn force_gradient(chair: &Chair, u: &Command, still: bool) -> RowVector2<f64> {
    let per_force = if still { 0.0 } else { 1.0 / chair.inertial_mass() };
    RowVector2::new(u[0] * per_force, per_force)
}

/// How a moment changes `r'`.
fn moment_gradient(chair: &Chair, still: bool) -> f64 {
    if still { 0.0 } else { 1.0 / chair.inertia_at_axle() }
}

/// `v'` and `r'` with their gradients over `[alpha, v, r, xi]`; what motion and sensors share.
#[derive(Clone, Copy, Debug, Default)]
struct Accelerations {
    v_dot: f64,
    r_dot: f64,
    /// Columns of the state: alpha, v, r, xi.
    v_gradient: [f64; 4],
    r_gradient: [f64; 4],
}

/// Sines and cosines of heading and slope, which everything needs.
#[derive(Clone, Copy, Debug)]
struct Trig {
    sa: f64,
    ca: f64,
    sx: f64,
    cx: f64,
}

impl Trig {
    fn of(x: &State) -> Self {
        let ((sa, ca), (sx, cx)) = (x[ALPHA].sin_cos(), x[XI].sin_cos());
        Self { sa, ca, sx, cx }
    }
}

/// Columns of the state that [`Accelerations`] depend on.
const COLUMNS: [usize; 4] = [ALPHA, V, R, XI];

/// Derivative of `[s', alpha', v', r', xi']` over the state; `w' = 0` has none.
pub type MotionJacobian = SMatrix<f64, 5, 6>;
