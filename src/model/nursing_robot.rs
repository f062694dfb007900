//! Differential-drive nursing robot with a seated person whose upper body sways (Yang, Shi, Qi, Deng:
//! *Research on Recognition and Estimation Algorithm for Real time Changes in the Center of Gravity
//! of Human Sitting Quality*).
//!
//! # Frames and signs
//! Robot frame at C, the midpoint of the driven axle projected on the floor: x forward, y left, z up.
//! `theta` heading, counter-clockwise. `phi_y` **pitch** of the upper body, positive leaning forward;
//! `phi_x` **roll**, positive leaning right; the index is the axis of rotation. The unit vector from
//! the hip to the upper body's centre of mass is `n = Rz(theta) Ry(phi_y) Rx(phi_x) e_z`. Wheel
//! torques drive forward when positive. The robot's own centre of mass and the hip lie above C.
//!
//! # Errata of the paper that shape this file
//! * Table 1 and the text swap pitch and roll; (10), (13), (29) only fit the reading above.
//! * (2), (23) forbid side slip at the centre of a robot driven at the front; that holds at the midpoint
//!   of the driven axle, from which the centre of mass is taken to have no distance.
//! * (4), (5): the right wheel turns with `(v + L omega / 2) / r`, the left one with minus; the printed
//!   inverse is singular at `theta = 0`. (6) holds for velocities, not for positions.
//! * All of the person swings in the paper; here the fraction `mu` does, the legs move with the seat.
//!   `h` is the distance from the hip to the centre of mass of the swaying part.
//! * (11) is linearised and drops roll, from which (29) inherits `phi^2` terms, and (29) prints the
//!   spring and the damper with signs that drive the pendulum; here the energies are exact.
//! * (16)-(19): `26/25 f m g` counts the wheels twice and leaves the person out; `F_f = f (m + m_h) g`.
//! * (21) lacks the efficiency; (25) needs four columns or the sway equations are projected away; (26) is
//!   the derivative by `q_dot`; (28) lacks the damping term.
//! * (30) calls `-m h v_dot` (a torque) a force and assumes `v_dot = 0`; see [`Planar::sway_force`].
//! * The paper's factor `delta` on the mass would change with the load; wheels do not: `m_rot` is added.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

/// Gravity, m/s2.
pub const GRAVITY: f64 = 9.81;

/// The robot without the person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robot {
    /// Mass with wheels `m`, kg.
    pub mass: f64,
    /// Distance between the drive wheels `L`, m.
    pub track: f64,
    /// Wheel radius `r`, m.
    pub wheel_radius: f64,
    /// Moment of inertia of one drive wheel `I_w`, kg m2. The paper's 0.0004 is 14 times too small for
    /// its 1.7 kg wheel; the effect is 0.7 % of the mass.
    pub wheel_inertia: f64,
    /// Further equivalent mass of rotating parts, in addition to `2 I_w / r^2`, kg.
    pub rotating_mass: f64,
    /// Yaw moment of inertia `I_z`, kg m2.
    pub yaw_inertia: f64,
    /// Transmission efficiency `eta` between given torque and wheel, 1.
    pub drive_efficiency: f64,
    /// Coefficient of rolling resistance `f`, 1.
    pub rolling_coefficient: f64,
    /// Speed scale `v_s` of the rolling resistance around zero, m/s.
    pub smoothing_speed: f64,
}

impl Robot {
    /// Equivalent mass of all rotating parts, `m_rot`, kg.
    pub fn rotating_mass(&self) -> f64 {
        2.0 * self.wheel_inertia / (self.wheel_radius * self.wheel_radius) + self.rotating_mass
    }

    /// Drive force `F = eta (tau_r + tau_l) / r`, N.
    pub fn drive_force(&self, torque_left: f64, torque_right: f64) -> f64 {
        self.drive_efficiency * (torque_right + torque_left) / self.wheel_radius
    }

    /// Rolling resistance of `total` kg at speed `v`, N: `f M g tanh(v / v_s)`.
    pub fn rolling_resistance(&self, total: f64, v: f64) -> f64 {
        self.rolling_coefficient * total * GRAVITY * (v / self.smoothing_speed).tanh()
    }
}

/// The seated person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Human {
    /// Mass of the whole person `m_h`, kg.
    pub mass: f64,
    /// Fraction `mu` of the mass that sways (head, arms, trunk), 1.
    pub swaying_fraction: f64,
    /// Hip to centre of mass of the swaying part `h`, m.
    pub com_height: f64,
    /// Radius of gyration about that centre of mass `rho`, m.
    pub gyration_radius: f64,
    /// Hip stiffness about y `k_y`, N m/rad.
    pub stiffness_pitch: f64,
    /// Hip damping about y `c_y`, N m s/rad.
    pub damping_pitch: f64,
    /// Pitch at which the hip spring is relaxed `phi_y0`, rad.
    pub rest_pitch: f64,
    /// Hip stiffness about x `k_x`, N m/rad.
    pub stiffness_roll: f64,
    /// Hip damping about x `c_x`, N m s/rad.
    pub damping_roll: f64,
    /// Roll at which the hip spring is relaxed `phi_x0`, rad.
    pub rest_roll: f64,
}

impl Human {
    /// Swaying mass `m_u`, kg.
    pub fn swaying_mass(&self) -> f64 {
        self.swaying_fraction * self.mass
    }

    /// First moment `b = m_u h`, kg m.
    pub fn first_moment(&self) -> f64 {
        self.swaying_mass() * self.com_height
    }

    /// Moment of inertia about the hip `J = m_u (h^2 + rho^2)`, kg m2 (slender rod).
    pub fn hip_inertia(&self) -> f64 {
        self.swaying_mass() * (self.com_height.powi(2) + self.gyration_radius.powi(2))
    }

    /// Ratio `kappa = b / J = h / (h^2 + rho^2)`, 1/m, which does not depend on the mass.
    pub fn coupling(&self) -> f64 {
        self.com_height / (self.com_height.powi(2) + self.gyration_radius.powi(2))
    }
}

/// Position `q = [x, y, theta, phi_x, phi_y]`.
pub type Position = SVector<f64, 5>;
/// Independent velocities `nu = [v, omega, phi_x_dot, phi_y_dot]`.
pub type Velocity = Vector4<f64>;
/// Square matrix of the five-coordinate model.
pub type Matrix5 = SMatrix<f64, 5, 5>;

/// Five-coordinate Lagrange model with the rolling constraint (Yang et al., eq. 11-28, exact).
///
/// `M(q) q'' + V(q, q') q' + C_d q' + G(q) + E F_f + tau_d = B tau + A lambda`, `A^T q' = 0`.
#[derive(Clone, Copy, Debug)]
pub struct Lagrange {
    /// The robot.
    pub robot: Robot,
    /// The person.
    pub human: Human,
}

impl Lagrange {
    /// Inertia of one wheel side as a mass, `w = m_rot / 2`.
    fn w(&self) -> f64 {
        0.5 * self.robot.rotating_mass()
    }

    /// `M(q)` and its derivatives by `theta`, `phi_x` and `phi_y`.
    pub fn inertia(&self, q: &Position) -> (Matrix5, [Matrix5; 3]) {
        let (s, c) = q[2].sin_cos();
        let (sx, cx) = q[3].sin_cos();
        let (sy, cy) = q[4].sin_cos();
        let (b, j, w) = (self.human.first_moment(), self.human.hip_inertia(), self.w());
        let total = self.robot.mass + self.human.mass;
        let yaw = self.robot.yaw_inertia + 0.5 * w * self.robot.track.powi(2);
        let m = symmetric([
            [
                total + 2.0 * w * c * c,
                2.0 * w * s * c,
                b * (sx * c - sy * cx * s),
                b * (cx * s - sx * sy * c),
                b * cx * cy * c,
            ],
            [0.0, total + 2.0 * w * s * s, b * (sx * s + sy * cx * c), -b * (sx * sy * s + cx * c), b * cx * cy * s],
            [0.0, 0.0, yaw + j * (1.0 - cx * cx * cy * cy), -j * sy, j * sx * cx * cy],
            [0.0, 0.0, 0.0, j, 0.0],
            [0.0, 0.0, 0.0, 0.0, j * cx * cx],
        ]);
        let by_theta = symmetric([
            [
                -4.0 * w * s * c,
                2.0 * w * (c * c - s * s),
                -b * (sx * s + sy * cx * c),
                b * (cx * c + sx * sy * s),
                -b * cx * cy * s,
            ],
            [0.0, 4.0 * w * s * c, b * (sx * c - sy * cx * s), b * (cx * s - sx * sy * c), b * cx * cy * c],
            [0.0; 5],
            [0.0; 5],
            [0.0; 5],
        ]);
        let by_roll = symmetric([
            [0.0, 0.0, b * (cx * c + sy * sx * s), -b * (sx * s + cx * sy * c), -b * sx * cy * c],
            [0.0, 0.0, b * (cx * s - sy * sx * c), b * (sx * c - cx * sy * s), -b * sx * cy * s],
            [0.0, 0.0, 2.0 * j * sx * cx * cy * cy, 0.0, j * (cx * cx - sx * sx) * cy],
            [0.0; 5],
            [0.0, 0.0, 0.0, 0.0, -2.0 * j * sx * cx],
        ]);
        let by_pitch = symmetric([
            [0.0, 0.0, -b * cy * cx * s, -b * sx * cy * c, -b * cx * sy * c],
            [0.0, 0.0, b * cy * cx * c, -b * sx * cy * s, -b * cx * sy * s],
            [0.0, 0.0, 2.0 * j * cx * cx * cy * sy, -j * cy, -j * sx * cx * sy],
            [0.0; 5],
            [0.0; 5],
        ]);
        (m, [by_theta, by_roll, by_pitch])
    }

    /// Coriolis matrix `V(q, q')` from the Christoffel symbols, so that `M' - 2 V` is skew.
    pub fn coriolis(&self, derivatives: &[Matrix5; 3], q_dot: &Position) -> Matrix5 {
        let by = |k: usize, i: usize, j: usize| if k < 2 { 0.0 } else { derivatives[k - 2][(i, j)] };
        Matrix5::from_fn(|i, j| (0..5).map(|k| 0.5 * (by(k, i, j) + by(j, i, k) - by(i, j, k)) * q_dot[k]).sum())
    }

    /// Gravity and springs `G(q)`.
    pub fn gravity(&self, q: &Position) -> Position {
        let (sx, cx) = q[3].sin_cos();
        let (sy, cy) = q[4].sin_cos();
        let (human, bg) = (&self.human, self.human.first_moment() * GRAVITY);
        let roll = -bg * sx * cy + human.stiffness_roll * (q[3] - human.rest_roll);
        let pitch = -bg * cx * sy + human.stiffness_pitch * (q[4] - human.rest_pitch);
        Position::from([0.0, 0.0, 0.0, roll, pitch])
    }

    /// `S(q)` with `q' = S nu`. Erratum: eq. (25) has two columns.
    pub fn basis(q: &Position) -> SMatrix<f64, 5, 4> {
        let (s, c) = q[2].sin_cos();
        let mut basis = SMatrix::<f64, 5, 4>::zeros();
        (basis[(0, 0)], basis[(1, 0)]) = (c, s);
        (basis[(2, 1)], basis[(3, 2)], basis[(4, 3)]) = (1.0, 1.0, 1.0);
        basis
    }

    /// Reduced form `Mr nu' + hr = ...`: returns `Mr` and `hr`, the constraint eliminated.
    pub fn reduced(&self, q: &Position, nu: &Velocity) -> (Matrix4<f64>, Vector4<f64>) {
        let (m, derivatives) = self.inertia(q);
        let basis = Self::basis(q);
        let q_dot = basis * nu;
        let (s, c) = q[2].sin_cos();
        let basis_dot_nu = Position::from([-s * nu[1] * nu[0], c * nu[1] * nu[0], 0.0, 0.0, 0.0]);
        let bias = m * basis_dot_nu + self.coriolis(&derivatives, &q_dot) * q_dot;
        (basis.transpose() * m * basis, basis.transpose() * bias)
    }

    /// `nu'` under wheel torques and active hip torques about x and y, N m. `None` if the inertia is
    /// not positive definite (parameters or state not finite).
    pub fn acceleration(&self, q: &Position, nu: &Velocity, wheels: [f64; 2], hip: [f64; 2]) -> Option<Velocity> {
        let (robot, human) = (&self.robot, &self.human);
        let [left, right] = wheels;
        let (inertia, bias) = self.reduced(q, nu);
        let gravity = self.gravity(q);
        let resistance = robot.rolling_resistance(robot.mass + human.mass, nu[0]);
        let lever = 0.5 * robot.drive_efficiency * robot.track / robot.wheel_radius;
        let force = Velocity::new(
            robot.drive_force(left, right) - resistance,
            lever * (right - left),
            hip[0] - human.damping_roll * nu[2] - gravity[3],
            hip[1] - human.damping_pitch * nu[3] - gravity[4],
        );
        Some(inertia.cholesky()?.solve(&(force - bias)))
    }

    /// Kinetic and potential energy, J.
    pub fn energy(&self, q: &Position, nu: &Velocity) -> (f64, f64) {
        let (inertia, _) = self.reduced(q, nu);
        let human = &self.human;
        let kinetic = 0.5 * nu.dot(&(inertia * nu));
        let potential = human.first_moment() * GRAVITY * q[3].cos() * q[4].cos()
            + 0.5 * human.stiffness_roll * (q[3] - human.rest_roll).powi(2)
            + 0.5 * human.stiffness_pitch * (q[4] - human.rest_pitch).powi(2);
        (kinetic, potential)
    }
}

/// Completes the upper triangle of rows to a symmetric matrix.
fn symmetric(upper: [[f64; 5]; 5]) -> Matrix5 {
    Matrix5::from_fn(|i, j| upper[i.min(j)][i.max(j)])
}

/// A pitch angle with its sine and cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lean {
    /// The angle, rad.
    pub phi: f64,
    /// Its sine.
    pub sin: f64,
    /// Its cosine.
    pub cos: f64,
}

impl Lean {
    /// The farthest that [`moved_to`](Self::moved_to) goes by series, rad: what they leave out is below 1e-16.
    const NEAR: f64 = 0.15;

    /// At `phi`.
    pub fn new(phi: f64) -> Self {
        let (sin, cos) = phi.sin_cos();
        Self { phi, sin, cos }
    }

    /// At `phi` nearby, by the sum of angles: a third of the cost of a sine and a cosine.
    pub fn moved_to(&self, phi: f64) -> Self {
        let d = phi - self.phi;
        let near = d.abs() < Self::NEAR;
        if !near {
            return Self::new(phi);
        }
        let [s3, s5, s7, s9] = [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0];
        let [c4, c6, c8, c10] = [1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0];
        let square = d * d;
        let s = d + d * square * (s3 + square * (s5 + square * (s7 + square * s9)));
        let c = 1.0 + square * (-0.5 + square * (c4 + square * (c6 + square * (c8 + square * c10))));
        Self { phi, sin: self.sin * c + self.cos * s, cos: self.cos * c - self.sin * s }
    }
}

/// Longitudinal motion with pitch sway only (`phi_x = 0`), solved for the accelerations:
///
/// ```text
/// [ Mt        b cos phi ] [ v'   ]   [ F - F_f + b (omega^2 + phi'^2) sin phi                                    ]
/// [ b cos phi J         ] [ phi''] = [ b g sin phi - k (phi - phi0) - c phi' + J omega^2 sin phi cos phi + tau_a ]
/// ```
///
/// The determinant `Mt J - b^2 cos^2 phi` is positive for every phi.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planar {
    /// `Mt`: robot, person and rotating parts, kg.
    pub inertial_mass: f64,
    /// First moment `b`, kg m.
    pub b: f64,
    /// Hip inertia `J`, kg m2.
    pub j: f64,
    /// Stiffness `k`, N m/rad.
    pub k: f64,
    /// Damping `c`, N m s/rad.
    pub c: f64,
    /// Rest angle `phi0`, rad.
    pub rest: f64,
    /// Rolling resistance at speed, `f M g`, N.
    pub rolling: f64,
    /// `1 / v_s`, s/m.
    pub inverse_smoothing: f64,
}

impl Planar {
    /// Of a robot with a person.
    pub fn new(robot: &Robot, human: &Human) -> Self {
        let total = robot.mass + human.mass;
        Self {
            inertial_mass: total + robot.rotating_mass(),
            b: human.first_moment(),
            j: human.hip_inertia(),
            k: human.stiffness_pitch,
            c: human.damping_pitch,
            rest: human.rest_pitch,
            rolling: robot.rolling_coefficient * total * GRAVITY,
            inverse_smoothing: 1.0 / robot.smoothing_speed,
        }
    }

    /// Rolling resistance at speed `v`, N.
    pub fn rolling_resistance(&self, v: f64) -> f64 {
        self.rolling * (v * self.inverse_smoothing).tanh()
    }

    /// Right side of the pitch equation, N m.
    fn pitch_torque(&self, &Lean { phi, sin, cos }: &Lean, phi_dot: f64, omega: f64, active: f64) -> f64 {
        self.b * GRAVITY * sin - self.k * (phi - self.rest) - self.c * phi_dot
            + self.j * omega * omega * sin * cos
            + active
    }

    /// `(v', phi'')` under the force `force` = drive force minus resistances, N.
    pub fn acceleration(&self, force: f64, lean: &Lean, phi_dot: f64, omega: f64, active: f64) -> (f64, f64) {
        let r1 = force + self.b * (omega * omega + phi_dot * phi_dot) * lean.sin;
        let r2 = self.pitch_torque(lean, phi_dot, omega, active);
        let coupling = self.b * lean.cos;
        let inverse = 1.0 / (self.inertial_mass * self.j - coupling * coupling);
        ((self.j * r1 - coupling * r2) * inverse, (self.inertial_mass * r2 - coupling * r1) * inverse)
    }

    /// `phi''` while the wheels are held.
    pub fn held_acceleration(&self, lean: &Lean, phi_dot: f64, omega: f64, active: f64) -> f64 {
        self.pitch_torque(lean, phi_dot, omega, active) / self.j
    }

    /// Response `(v', phi'')` to a hip torque of 1 N m.
    pub fn hip_torque_response(&self, phi: f64) -> (f64, f64) {
        let coupling = self.b * phi.cos();
        let inverse = 1.0 / (self.inertial_mass * self.j - coupling * coupling);
        (-coupling * inverse, self.inertial_mass * inverse)
    }

    /// Force of the swaying body on the robot `F_phi = b (phi'' cos phi - phi'^2 sin phi - omega^2 sin phi)`,
    /// positive slowing it, so that `F = F_f + Mt v' + F_phi`, N.
    pub fn sway_force(&self, phi: f64, phi_dot: f64, phi_ddot: f64, omega: f64) -> f64 {
        let (sin, cos) = phi.sin_cos();
        self.b * (phi_ddot * cos - (phi_dot * phi_dot + omega * omega) * sin)
    }

    /// Passive hip torque `k (phi - phi0) + c phi'`, N m.
    pub fn hip_torque(&self, phi: f64, phi_dot: f64) -> f64 {
        self.k * (phi - self.rest) + self.c * phi_dot
    }
}

/// Height and forward position of a centre of gravity in the robot frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CentreOfGravity {
    /// Forward of the driven axle, m.
    pub x: f64,
    /// Above the floor, m.
    pub z: f64,
}

/// Centre of gravity of the person: legs and pelvis at the seat, the fraction `mu` at `h n` above it
/// (Yang et al., eq. 10, for `phi_x = 0` in the robot frame).
pub fn person_cog(human: &Human, seat_height: f64, phi: f64) -> CentreOfGravity {
    let arm = human.swaying_fraction * human.com_height;
    let (sin, cos) = phi.sin_cos();
    CentreOfGravity { x: arm * sin, z: seat_height + arm * cos }
}

/// Centre of gravity of robot and person; the robot's own one lies above C at `robot_height`.
pub fn common_cog(robot_mass: f64, robot_height: f64, human_mass: f64, person: CentreOfGravity) -> CentreOfGravity {
    let share = human_mass / (robot_mass + human_mass);
    CentreOfGravity { x: share * person.x, z: robot_height + share * (person.z - robot_height) }
}
