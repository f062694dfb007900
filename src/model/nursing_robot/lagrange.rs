//! The robot with a person whose upper body pitches and rolls, by Lagrange's equations with the rolling constraint.

use super::{Human, Robot, Rolling};
use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

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
    /// Its yaw moment of inertia `I_z`, kg m2, which the planar filters do not need.
    pub yaw_inertia: f64,
    /// Rolling resistance.
    pub rolling: Rolling,
    /// The person.
    pub human: Human,
    /// The person's mass `m_h`, kg.
    pub mass: f64,
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
        let (b, j, w) = (self.human.first_moment(self.mass), self.human.hip_inertia(self.mass), self.w());
        let total = self.robot.mass + self.mass;
        let yaw = self.yaw_inertia + 0.5 * w * self.robot.track.powi(2);
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
        let (human, bg) = (&self.human, self.human.toppling_stiffness(self.mass));
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
        let resistance = self.rolling.resistance(robot.mass + self.mass, nu[0]);
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
        let potential = human.toppling_stiffness(self.mass) * q[3].cos() * q[4].cos()
            + 0.5 * human.stiffness_roll * (q[3] - human.rest_roll).powi(2)
            + 0.5 * human.stiffness_pitch * (q[4] - human.rest_pitch).powi(2);
        (kinetic, potential)
    }
}

/// Completes the upper triangle of rows to a symmetric matrix.
fn symmetric(upper: [[f64; 5]; 5]) -> Matrix5 {
    Matrix5::from_fn(|i, j| upper[i.min(j)][i.max(j)])
}
