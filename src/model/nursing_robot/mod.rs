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
//! # Equations
//! With `F = eta (tau_r + tau_l)/r`, `F_f = f M g tanh(v/v_s)`, the swaying mass `m_u = mu m_h`, `b = m_u h`,
//! `J = m_u (h^2 + rho^2)` and `Mt = m + m_h + m_rot`, for pitch alone (`phi_x = 0`), from (11)-(29), corrected:
//!
//! ```text
//! [ Mt        b cos phi ] [ v'   ]   [ F - F_f + b (omega^2 + phi'^2) sin phi                                    ]
//! [ b cos phi J         ] [ phi''] = [ b g sin phi - k (phi - phi0) - c phi' + J omega^2 sin phi cos phi + tau_a ]
//!
//! phi'' = -(c/J) phi' - ((k - b g)/J) phi - kappa a,  kappa = h/(h^2 + rho^2)       small angles
//! ```
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

mod lagrange;
mod wide;

pub use lagrange::{Lagrange, Matrix5, Position, Velocity};

/// Gravity, m/s2.
pub const GRAVITY: f64 = super::ROUNDED_GRAVITY;

variables! {
    /// The robot or vehicle without its load.
    #[derive(Copy)]
    pub struct Robot {
        /// Mass of the robot or vehicle with its wheels, without the load that is estimated (m).
        mass: f64 = 160.0, "kg", [1.0, 1e5], essential;
        /// Distance between the left and right drive wheels (L).
        track: f64 = 0.7, "m", [0.05, 10.0];
        /// Radius of the drive wheels (r).
        wheel_radius: f64 = 0.0825, "m", [0.005, 3.0], essential;
        /// Moment of inertia of one drive wheel about its axle (I_w). The source's 0.0004 is 14 times too small for its 1.7 kg wheel; the effect is 0.7 % of the mass.
        wheel_inertia: f64 = 0.0004, "kg.m2", [0.0, 1e3], essential;
        /// Further equivalent mass of rotating parts (motors, gears), in addition to 2 wheel_inertia / wheel_radius^2. A vehicle whose rotating inertia is known only as one mass sets wheel_inertia to 0 and gives it here.
        rotating_mass: f64 = 0.0, "kg", [0.0, 1e5];
        /// Efficiency between the given wheel torque and the force at the wheel, taken alike in driving and braking (eta).
        drive_efficiency: f64 = 1.0, "1", [0.1, 2.0];
        /// Height of the hip of the seated person above the floor.
        seat_height: f64 = 0.5, "m", [0.0, 5.0];
        /// Height of the robot's own centre of gravity above the floor; it lies above the driven axle.
        cog_height: f64 = 0.3, "m", [0.0, 5.0];
    }
}

variables! {
    /// Rolling resistance.
    #[derive(Copy)]
    pub struct Rolling {
        /// Coefficient of rolling resistance: resistance over weight (f).
        coefficient: f64 = 0.015, "1", [0.0, 0.5], essential;
        /// Speed scale over which the rolling resistance changes its sign around standstill (v_s).
        smoothing_speed: f64 = 0.02, "m/s", [1e-4, 10.0];
    }
}

variables! {
    /// Air drag, for road vehicles.
    #[derive(Copy)]
    pub struct Aero {
        /// Drag coefficient times frontal area; 0 leaves air drag out.
        drag_area: f64 = 0.0, "m2", [0.0, 100.0];
        /// Density of the air.
        air_density: f64 = 1.2, "kg/m3", [0.0, 5.0];
    }
}

variables! {
    /// The seated person.
    #[derive(Copy)]
    pub struct Human {
        /// Mass of the person until one is estimated; also the mass to which stiffness and damping belong.
        nominal_mass: f64 = 70.0, "kg", [0.0, 1e5], essential;
        /// Standard deviation of nominal_mass, shown as load_mass_std until a mass is estimated.
        nominal_mass_std: f64 = 20.0, "kg", [0.0, 1e5];
        /// Fraction of the person's mass that sways (head, arms, trunk); 0 for a load that cannot sway, which switches the sway filter off (mu).
        swaying_fraction: f64 = 0.678, "1", [0.0, 1.0];
        /// Distance from the hip to the centre of mass of the swaying part (h).
        com_height: f64 = 0.3065, "m", [0.01, 3.0];
        /// Radius of gyration of the swaying part about its centre of mass (rho).
        gyration_radius: f64 = 0.2428, "m", [0.0, 3.0];
        /// Stiffness of the hip against pitching. Must exceed the toppling moment of gravity per angle, else upright is unstable (k_y).
        stiffness_pitch: f64 = 400.0, "N.m/rad", [0.0, 1e5], essential;
        /// Damping of the hip against pitching (c_y).
        damping_pitch: f64 = 25.0, "N.m.s/rad", [0.0, 1e4], essential;
        /// Error of stiffness_pitch over stiffness_pitch (one standard deviation), which counts in the estimates' deviations. identify fit finds it; persons differ by half.
        stiffness_pitch_std: f64 = 0.5, "1", [0.0, 10.0], tunable;
        /// Error of damping_pitch over damping_pitch (one standard deviation), likewise.
        damping_pitch_std: f64 = 0.5, "1", [0.0, 10.0], tunable;
        /// Pitch of the relaxed posture, positive leaning forward (phi_y0).
        rest_pitch: f64 = 0.0, "rad", [-1.0, 1.0];
        /// How far the posture that a person keeps may differ from rest_pitch (standard deviation). Wheels cannot feel a kept lean, so this enters body_pitch_std when no tilt is measured. identify fit finds it from a log with tilt (--only human.rest_pitch,human.rest_pitch_std).
        rest_pitch_std: f64 = 0.05, "rad", [0.0, 1.0];
        /// Stiffness of the hip against rolling sideways. Not used by the filters; identified for models of the lateral sway (k_x).
        stiffness_roll: f64 = 500.0, "N.m/rad", [0.0, 1e5];
        /// Damping of the hip against rolling sideways. Not used by the filters (c_x).
        damping_roll: f64 = 30.0, "N.m.s/rad", [0.0, 1e4];
        /// Roll of the relaxed posture, positive leaning right. Not used by the filters (phi_x0).
        rest_roll: f64 = 0.0, "rad", [-1.0, 1.0];
    }
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

    /// Share of a load in the mass of both, and its derivative by the load's mass, 1/kg.
    pub fn load_share(&self, load: f64) -> (f64, f64) {
        let total = self.mass + load;
        (load / total, self.mass / (total * total))
    }

    /// Centre of gravity of robot and load, whose own one is at `load_cog`; the robot's lies above C. Its derivative by
    /// the load's mass is the distance of the two times that of [`load_share`](Self::load_share).
    pub fn common_cog(&self, load: f64, load_cog: CentreOfGravity) -> CentreOfGravity {
        let (share, _) = self.load_share(load);
        CentreOfGravity { x: share * load_cog.x, z: self.cog_height + share * (load_cog.z - self.cog_height) }
    }
}

impl Rolling {
    /// Rolling resistance of `total` kg at speed `v`, N: `f M g tanh(v / v_s)`.
    pub fn resistance(&self, total: f64, v: f64) -> f64 {
        self.coefficient * total * GRAVITY * (v / self.smoothing_speed).tanh()
    }
}

impl Aero {
    /// Air drag at a speed, N.
    pub fn drag(&self, v: f64) -> f64 {
        0.5 * self.air_density * self.drag_area * v * v.abs()
    }
}

/// A person of `mass` kg; hip stiffness and damping do not change with it.
impl Human {
    /// Swaying mass `m_u`, kg.
    pub fn swaying_mass(&self, mass: f64) -> f64 {
        self.swaying_fraction * mass
    }

    /// First moment `b = m_u h`, kg m.
    pub fn first_moment(&self, mass: f64) -> f64 {
        self.swaying_mass(mass) * self.com_height
    }

    /// Moment of inertia about the hip `J = m_u (h^2 + rho^2)`, kg m2 (slender rod).
    pub fn hip_inertia(&self, mass: f64) -> f64 {
        self.swaying_mass(mass) * (self.com_height.powi(2) + self.gyration_radius.powi(2))
    }

    /// Moment of gravity per angle that a hip must hold, `b g`, N m/rad.
    pub fn toppling_stiffness(&self, mass: f64) -> f64 {
        self.first_moment(mass) * GRAVITY
    }

    /// Ratio `kappa = b / J = h / (h^2 + rho^2)`, 1/m, which does not depend on the mass.
    pub fn coupling(&self) -> f64 {
        self.com_height / (self.com_height.powi(2) + self.gyration_radius.powi(2))
    }

    /// Distance from the hip to the centre of gravity of the whole person, who sits with the rest at the hip, `mu h`, m.
    pub fn cog_arm(&self) -> f64 {
        self.swaying_fraction * self.com_height
    }

    /// Centre of gravity of the person, m: legs and pelvis at the seat, the fraction `mu` at `h n` above it (Yang et al.,
    /// eq. 10, for `phi_x = 0` in the robot frame); and its derivative by the pitch, m/rad.
    pub fn cog(&self, seat_height: f64, phi: f64) -> (CentreOfGravity, CentreOfGravity) {
        let (sin, cos) = phi.sin_cos();
        let (forward, up) = (self.cog_arm() * sin, self.cog_arm() * cos);
        (CentreOfGravity { x: forward, z: seat_height + up }, CentreOfGravity { x: up, z: -forward })
    }
}

/// Sway about the rest posture for small angles, driven by the robot's acceleration:
/// `phi'' = -(c/J) phi' - ((k - b g)/J) phi - kappa a` (Yang et al., eq. 29, corrected).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallSway {
    stiffness: f64,
    damping: f64,
    coupling: f64,
    arm: f64,
}

impl SmallSway {
    /// Of a person of `mass` kg; nothing if nothing sways.
    pub fn new(human: &Human, mass: f64) -> Option<Self> {
        let inertia = human.hip_inertia(mass);
        let per_inertia = 1.0 / inertia;
        (inertia > 0.0).then(|| Self {
            stiffness: (human.stiffness_pitch - human.toppling_stiffness(mass)) * per_inertia,
            damping: human.damping_pitch * per_inertia,
            coupling: human.coupling(),
            arm: human.cog_arm(),
        })
    }

    /// `phi''` at an acceleration `a` (m/s2) of the robot, rad/s2.
    pub fn acceleration(&self, a: f64, phi: f64, phi_dot: f64) -> f64 {
        -self.damping * phi_dot - self.stiffness * phi - self.coupling * a
    }

    /// The swaying body's reaction on the robot per kilogram of the person, `mu h phi''`, m/s2.
    pub fn reaction(&self, a: f64, phi: f64, phi_dot: f64) -> f64 {
        self.arm * self.acceleration(a, phi, phi_dot)
    }
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

    /// Sine and cosine of an angle of at most [`NEAR`](Self::NEAR) by their series, of a number or of several side by side.
    #[inline(always)]
    fn small_angle<T>(d: T, number: impl Fn(f64) -> T) -> (T, T)
    where
        T: Copy + std::ops::Add<Output = T> + std::ops::Mul<Output = T>,
    {
        let [s3, s5, s7, s9] = [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0].map(&number);
        let [c2, c4, c6] = [-0.5, 1.0 / 24.0, -1.0 / 720.0].map(&number);
        let [c8, c10] = [1.0 / 40_320.0, -1.0 / 3_628_800.0].map(&number);
        let square = d * d;
        let s = d + d * square * (s3 + square * (s5 + square * (s7 + square * s9)));
        let c = number(1.0) + square * (c2 + square * (c4 + square * (c6 + square * (c8 + square * c10))));
        (s, c)
    }

    /// At `phi` nearby, by the sum of angles: a third of the cost of a sine and a cosine.
    pub fn moved_to(&self, phi: f64) -> Self {
        let d = phi - self.phi;
        let near = d.abs() < Self::NEAR;
        if !near {
            return Self::new(phi);
        }
        let (s, c) = Self::small_angle(d, |x| x);
        Self { phi, sin: self.sin * c + self.cos * s, cos: self.cos * c - self.sin * s }
    }
}

/// Longitudinal motion with pitch sway only (`phi_x = 0`), the equations of the [module's page](self) solved for the
/// accelerations. The determinant `Mt J - b^2 cos^2 phi` is positive for every phi.
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
    /// Of a robot with a person of `mass` kg.
    pub fn new(robot: &Robot, rolling: &Rolling, human: &Human, mass: f64) -> Self {
        let total = robot.mass + mass;
        Self {
            inertial_mass: total + robot.rotating_mass(),
            b: human.first_moment(mass),
            j: human.hip_inertia(mass),
            k: human.stiffness_pitch,
            c: human.damping_pitch,
            rest: human.rest_pitch,
            rolling: rolling.coefficient * total * GRAVITY,
            inverse_smoothing: 1.0 / rolling.smoothing_speed,
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
    pub fn sway_force(&self, lean: &Lean, phi_dot: f64, phi_ddot: f64, omega: f64) -> f64 {
        self.b * (phi_ddot * lean.cos - (phi_dot * phi_dot + omega * omega) * lean.sin)
    }

    /// How far the posture at rest moves with the relaxed one, `k / (k - b g)`: gravity moves it further. Ten at most.
    pub fn posture_by_rest(&self) -> f64 {
        self.k / (self.k - self.b * GRAVITY).max(0.1 * self.k)
    }

    /// The paper's disturbance force (30) with its torque divided by the lever `J / b`, N.
    pub fn paper_force(&self, phi: f64) -> f64 {
        self.b / self.j * (self.b * GRAVITY * phi.sin() - self.k * (phi - self.rest))
    }

    /// The paper's disturbance force (30) as printed, a torque taken for a force: all of a person of `mass` kg swings,
    /// `m_h g h sin(phi) - k phi`.
    pub fn printed_force(&self, human: &Human, mass: f64, phi: f64) -> f64 {
        mass * GRAVITY * human.com_height * phi.sin() - self.k * phi
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
