//! A wheel loader as a rigid body on tyre springs: surge, heave, pitch, two axles.
//!
//! Written from the free body, without the estimator's elimination of the loads: axle loads come from
//! tyre deflections, tyre forces from a magic formula behind a relaxation length, the rolling moment
//! acts on the wheels. `x` forward along the road, `z` up, pitch nose-up. Grade is a constant slope;
//! the road's elevation drives the tyres.

use super::road::Road;

/// The machine and its tyres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine {
    /// Mass, kg.
    pub mass: f64,
    /// Pitch inertia about the centre of gravity, kg.m2.
    pub pitch_inertia: f64,
    /// Distances of the front axle forward of and of the rear axle behind the centre of gravity, m.
    pub to_axle: [f64; 2],
    /// Height of the centre of gravity above ground, m.
    pub cg_height: f64,
    /// Kinematic rolling radii at the static load, m.
    pub wheel_radius: [f64; 2],
    /// Loss of rolling radius per tyre deflection beyond the static one, 1.
    pub radius_softness: f64,
    /// Axle inertias at the wheels, kg.m2.
    pub axle_inertia: [f64; 2],
    /// Vertical stiffness of an axle's tyres, N/m.
    pub tire_stiffness: f64,
    /// Vertical damping of an axle's tyres, N.s/m.
    pub tire_damping: f64,
    /// Slip stiffness over load at the nominal load, half the weight.
    pub slip_stiffness: f64,
    /// Relative loss of slip stiffness when the load doubles.
    pub load_sensitivity: f64,
    /// Largest friction coefficient.
    pub friction: f64,
    /// Shape factor of the magic formula.
    pub shape: f64,
    /// Curvature factor of the magic formula.
    pub curvature: f64,
    /// Relaxation length, m.
    pub relaxation_length: f64,
    /// Rolling moment over load and radius.
    pub rolling: f64,
    /// Share of the wheels' own moments, rolling and spinning up, that counts in the pitch balance.
    /// 1 is the full balance: it shifts the share `rolling * radius / wheelbase` of the load to the
    /// rear and adds `inertia / (mass * radius)` to the effective height. 0 is the source's idealisation.
    pub wheel_moments: f64,
    /// Distance of the bucket's tip forward of the front axle and its height, m.
    pub bucket: [f64; 2],
}

impl Default for Machine {
    fn default() -> Self {
        Self {
            mass: 4700.0,
            pitch_inertia: 6200.0,
            to_axle: [1.21, 0.99],
            cg_height: 0.95,
            wheel_radius: [0.55; 2],
            radius_softness: 0.0,
            axle_inertia: [36.0; 2],
            tire_stiffness: 7e5,
            tire_damping: 7e3,
            slip_stiffness: 19.0,
            load_sensitivity: 0.05,
            friction: 0.75,
            shape: 1.5,
            curvature: 0.3,
            relaxation_length: 0.35,
            rolling: 0.03,
            wheel_moments: 0.0,
            bucket: [1.6, 0.0],
        }
    }
}

/// What acts on the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Action {
    /// Drive torques at the wheels, front and rear, N.m.
    pub torque: [f64; 2],
    /// Brake torque magnitudes, N.m.
    pub brake: [f64; 2],
    /// Grade, rad, positive uphill.
    pub grade: f64,
    /// Forces on the bucket's tip: backwards and down, N.
    pub spading: [f64; 2],
}

/// The machine in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    /// What it is.
    pub machine: Machine,
    /// What it drives on.
    pub road: Road,
    state: State,
}

const DISTANCE: usize = 0;
const SPEED: usize = 1;
const HEAVE: usize = 2;
const HEAVE_RATE: usize = 3;
const PITCH: usize = 4;
const PITCH_RATE: usize = 5;
const WHEEL: usize = 6;
const SLIP: usize = 8;
type State = [f64; 10];

const G: f64 = super::STANDARD_GRAVITY;
/// Speed over which rolling and braking moments change sign, m/s.
const SIGN_SPEED: f64 = 0.05;
/// Speed that keeps the relaxation alive at standstill, m/s.
const CREEP_SPEED: f64 = 0.3;

impl Plant {
    /// A machine that rolls at `speed` without slip, level and at its static deflections.
    pub fn new(machine: Machine, road: Road, speed: f64) -> Self {
        let mut state = [0.0; 10];
        state[SPEED] = speed;
        for i in 0..2 {
            state[WHEEL + i] = speed / machine.wheel_radius[i];
        }
        let (front, rear) = (road.at(machine.to_axle[0]).0, road.at(-machine.to_axle[1]).0);
        let wheelbase = machine.to_axle[0] + machine.to_axle[1];
        state[PITCH] = (front - rear) / wheelbase;
        state[HEAVE] = front - machine.to_axle[0] * state[PITCH];
        Self { machine, road, state }
    }

    /// Speed, m/s.
    pub fn speed(&self) -> f64 {
        self.state[SPEED]
    }

    /// Wheel speeds of the front and the rear axle, rad/s.
    pub fn wheel_speeds(&self) -> [f64; 2] {
        [self.state[WHEEL], self.state[WHEEL + 1]]
    }

    /// Distance driven, m.
    pub fn distance(&self) -> f64 {
        self.state[DISTANCE]
    }

    /// Axle loads, N.
    pub fn loads(&self) -> [f64; 2] {
        self.contacts(&self.state).map(|contact| contact.load)
    }

    /// Slope under the machine: that of the line between the contacts, on top of the grade, rad.
    pub fn slope(&self, grade: f64) -> f64 {
        let [ahead, behind] = self.machine.to_axle;
        let x = self.state[DISTANCE];
        grade + (self.road.at(x + ahead).0 - self.road.at(x - behind).0) / (ahead + behind)
    }

    /// Moves on by `dt` seconds with one Runge-Kutta step of order 4; 1 ms is a good choice.
    pub fn advance(&mut self, action: &Action, dt: f64) {
        let moved = |by: &State, h: f64| std::array::from_fn(|i| self.state[i] + h * by[i]);
        let k1 = self.rates(&self.state, action);
        let k2 = self.rates(&moved(&k1, 0.5 * dt), action);
        let k3 = self.rates(&moved(&k2, 0.5 * dt), action);
        let k4 = self.rates(&moved(&k3, dt), action);
        for i in 0..self.state.len() {
            self.state[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }

    /// Static axle loads, about which the springs deflect.
    fn static_loads(&self) -> [f64; 2] {
        let m = &self.machine;
        let weight = m.mass * G;
        let front = weight * m.to_axle[1] / (m.to_axle[0] + m.to_axle[1]);
        [front, weight - front]
    }

    fn contacts(&self, x: &State) -> [Contact; 2] {
        let m = &self.machine;
        let still = self.static_loads();
        std::array::from_fn(|i| {
            let arm = if i == 0 { m.to_axle[0] } else { -m.to_axle[1] };
            let (elevation, slope) = self.road.at(x[DISTANCE] + arm);
            let deflection = elevation - (x[HEAVE] + arm * x[PITCH]);
            let rate = slope * x[SPEED] - (x[HEAVE_RATE] + arm * x[PITCH_RATE]);
            let load = (still[i] + m.tire_stiffness * deflection + m.tire_damping * rate).max(0.0);
            Contact { arm, slope, load, deflection }
        })
    }

    fn rates(&self, x: &State, action: &Action) -> State {
        let m = &self.machine;
        let (sin, cos) = action.grade.sin_cos();
        let [push, pull] = action.spading;
        let contacts = self.contacts(x);
        let nominal = 0.5 * m.mass * G;

        let mut dx = [0.0; 10];
        let (mut along, mut up, mut nose_up) = (-push - m.mass * G * sin, -pull - m.mass * G * cos, 0.0);
        for (i, contact) in contacts.iter().enumerate() {
            let radius = m.wheel_radius[i] - m.radius_softness * contact.deflection;
            let (w, slip) = (x[WHEEL + i], x[SLIP + i]);
            let traction = contact.load * self.grip(slip, contact.load / nominal);
            let rim = w * m.wheel_radius[i];
            let rolling = m.rolling * contact.load * m.wheel_radius[i] * (rim / SIGN_SPEED).tanh();
            let braking = action.brake[i] * (rim / SIGN_SPEED).tanh();
            dx[WHEEL + i] = (action.torque[i] - braking - rolling - m.wheel_radius[i] * traction) / m.axle_inertia[i];
            dx[SLIP + i] = (w * radius - x[SPEED] - slip * x[SPEED].abs().max(CREEP_SPEED)) / m.relaxation_length;
            let drag = traction - contact.load * contact.slope;
            along += drag;
            up += contact.load;
            let wheel = rolling + m.axle_inertia[i] * dx[WHEEL + i];
            nose_up += contact.load * contact.arm + drag * m.cg_height + m.wheel_moments * wheel;
        }
        let tip = m.to_axle[0] + m.bucket[0];
        nose_up += -pull * tip - push * (m.cg_height - m.bucket[1]);

        dx[DISTANCE] = x[SPEED];
        dx[SPEED] = along / m.mass;
        dx[HEAVE] = x[HEAVE_RATE];
        dx[HEAVE_RATE] = up / m.mass;
        dx[PITCH] = x[PITCH_RATE];
        dx[PITCH_RATE] = nose_up / m.pitch_inertia;
        dx
    }

    /// Magic formula: longitudinal force over load at this slip and share of the nominal load.
    fn grip(&self, slip: f64, share: f64) -> f64 {
        let m = &self.machine;
        let stiffness = m.slip_stiffness * (1.0 - m.load_sensitivity * (share - 1.0));
        let x = stiffness / (m.shape * m.friction) * slip;
        m.friction * (m.shape * (x - m.curvature * (x - x.atan())).atan()).sin()
    }
}

struct Contact {
    arm: f64,
    slope: f64,
    load: f64,
    deflection: f64,
}
