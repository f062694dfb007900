//! Four-wheeled vehicle with turning, slipping wheels: truth for the wheeled robot.
//!
//! State: speeds `vx, vy` and yaw rate `r` of the body, and the speeds of the four wheels, which
//! the estimator's model does not have. The longitudinal force of a wheel comes from its slip,
//! `Fx = mu Fz sin(C atan(B kappa))`, and slows or speeds the wheel by `J w' = T - R Fx`. The
//! equations of the body are written wheel by wheel in components. Integrated by Runge-Kutta steps of
//! at most a millisecond.

/// The machine and the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Mass, kg.
    pub mass: f64,
    /// Yaw inertia, kg m².
    pub yaw_inertia: f64,
    /// Distance of the centre of gravity from the front and from the rear axle, m.
    pub arms: [f64; 2],
    /// Track in front and at the rear, m.
    pub tracks: [f64; 2],
    /// Height of the centre of gravity, m.
    pub height: f64,
    /// Rolling radius, m.
    pub radius: f64,
    /// Inertia of a wheel, kg m².
    pub wheel_inertia: f64,
    /// Front and rear tyre.
    pub tires: [TireLaw; 2],
    /// Ground friction under each wheel over that of the tyres' parameters.
    pub ground: [f64; 4],
    /// Shape and stiffness of the slip law.
    pub slip_law: [f64; 2],
    /// Rolling resistance over load.
    pub rolling: f64,
    /// Whether longitudinal force takes lateral grip away.
    pub combined: bool,
    /// Speed that guards slip and slip angle at rest, m/s.
    pub guard: f64,
    /// Wheel speed at which brakes fade out, rad/s.
    pub brake_fade: f64,
}

/// Lateral force of a tyre, with loads in units of the nominal one.
#[derive(Clone, Debug, PartialEq)]
pub struct TireLaw {
    /// Cornering stiffness at the nominal load, N/rad.
    pub stiffness: f64,
    /// Nominal load, N.
    pub nominal: f64,
    /// Load of the greatest stiffness over the nominal load; 0: proportional.
    pub sensitivity: f64,
    /// Shape.
    pub shape: f64,
    /// Friction.
    pub friction: f64,
    /// Change of the friction per relative change of load.
    pub friction_slope: f64,
    /// Curvature.
    pub curvature: f64,
}

/// What the driver does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Controls {
    /// Steering angle, rad.
    pub steering: f64,
    /// Drive torques, N m.
    pub drive: [f64; 4],
    /// Brake torques, N m.
    pub brake: [f64; 4],
}

/// State: `vx, vy, r` and four wheel speeds.
pub type State = [f64; 7];

/// What the sensors would read without noise, and the forces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Longitudinal wheel forces, N.
    pub force_x: [f64; 4],
    /// Lateral wheel forces, N.
    pub force_y: [f64; 4],
    /// Wheel loads, N.
    pub load: [f64; 4],
    /// Specific force at the centre of gravity, m/s².
    pub accel: [f64; 2],
    /// Yaw acceleration, rad/s².
    pub yaw_acceleration: f64,
}

/// The motion of a wheel over the ground.
struct Contact {
    /// Where it stands, ahead and to the left of the centre of gravity, m.
    place: [f64; 2],
    /// Its direction.
    forward: [f64; 2],
    /// Longitudinal force over grip.
    pull: f64,
    /// Slip angle, rad.
    drift: f64,
}

/// 1 for wheels on the left, -1 on the right.
fn side(wheel: usize) -> f64 {
    if wheel.is_multiple_of(2) { 1.0 } else { -1.0 }
}

const WEIGHT_PER_MASS: f64 = super::ROUNDED_GRAVITY;

impl TireLaw {
    fn grip(&self, load: f64, ground: f64) -> f64 {
        let excess = load / self.nominal - 1.0;
        ground * (self.friction + self.friction_slope * excess).max(0.05 * self.friction)
    }

    fn lateral(&self, angle: f64, load: f64, ground: f64) -> f64 {
        if load <= 0.0 {
            return 0.0;
        }
        let relative = load / self.nominal;
        let stiffness = if self.sensitivity > 0.0 {
            // sin(2 atan(z)) = 2 z / (1 + z^2), of which the ratio to that at the nominal load is taken
            let bend = |q: f64| q / (self.sensitivity * self.sensitivity + q * q);
            self.stiffness * bend(relative) / bend(1.0)
        } else {
            self.stiffness * relative
        };
        let peak = self.grip(load, ground) * load;
        let x = stiffness / (self.shape * peak) * angle;
        let x = (1.0 - self.curvature) * x + self.curvature * x.atan();
        peak * (self.shape * x.atan()).sin()
    }
}

impl Machine {
    /// Rolling without slip at a speed.
    pub fn rolling_at(&self, speed: f64) -> State {
        let wheel = speed / self.radius;
        [speed, 0.0, 0.0, wheel, wheel, wheel, wheel]
    }

    /// Forces in a state.
    pub fn truth(&self, x: &State, controls: &Controls) -> Truth {
        self.truth_near(x, controls, [0.0, 0.0])
    }

    /// The same, sought from specific forces that are near.
    fn truth_near(&self, x: &State, controls: &Controls, accel: [f64; 2]) -> Truth {
        let base = self.arms[0] + self.arms[1];
        let weight = self.mass * WEIGHT_PER_MASS;
        let mut truth = Truth { accel, ..Truth::default() };
        let contacts: [Contact; 4] = std::array::from_fn(|i| self.contact(x, controls, i));
        // The loads follow from the accelerations that they cause: repeat until they no longer move.
        for _ in 0..40 {
            let [ax, ay] = truth.accel;
            let axle_front = (weight * self.arms[1] / base - self.mass * ax * self.height / base).clamp(0.0, weight);
            let axles = [axle_front, weight - axle_front];
            let (mut force, mut moment) = ([0.0, 0.0], 0.0);
            for (i, Contact { place, forward, pull, drift }) in contacts.iter().enumerate() {
                let (axle, side) = (i / 2, side(i));
                let roll = self.mass * ay * self.height / self.tracks[axle] * self.arms[1 - axle] / base;
                let load = 0.5 * axles[axle] - side * roll.clamp(-0.5 * axles[axle], 0.5 * axles[axle]);
                let tire = &self.tires[axle];
                let grip = tire.grip(load, self.ground[i]) * load;
                let fx = grip * pull;
                let mut fy = tire.lateral(*drift, load, self.ground[i]);
                if self.combined && grip > 0.0 {
                    fy *= (1.0 - (fx / grip).powi(2)).max(0.0).sqrt();
                }
                let body = [fx * forward[0] - fy * forward[1], fx * forward[1] + fy * forward[0]];
                force[0] += body[0];
                force[1] += body[1];
                moment += place[0] * body[1] - place[1] * body[0];
                (truth.force_x[i], truth.force_y[i], truth.load[i]) = (fx, fy, load);
            }
            let next = [force[0] / self.mass, force[1] / self.mass];
            truth.yaw_acceleration = moment / self.yaw_inertia;
            let change = (next[0] - truth.accel[0]).abs() + (next[1] - truth.accel[1]).abs();
            truth.accel = next;
            if change < 1e-11 {
                break;
            }
        }
        truth
    }

    /// What a wheel does on the ground, whatever its load.
    fn contact(&self, x: &State, controls: &Controls, wheel: usize) -> Contact {
        let [vx, vy, r, ..] = *x;
        let axle = wheel / 2;
        let angle = if axle == 0 { controls.steering } else { 0.0 };
        let place = [if axle == 0 { self.arms[0] } else { -self.arms[1] }, side(wheel) * 0.5 * self.tracks[axle]];
        let hub = [vx - r * place[1], vy + r * place[0]];
        let forward = [angle.cos(), angle.sin()];
        let along = hub[0] * forward[0] + hub[1] * forward[1];
        let across = hub[1] * forward[0] - hub[0] * forward[1];
        let rim = self.radius * x[3 + wheel];
        let slip = (rim - along) / along.abs().max(rim.abs()).max(self.guard);
        Contact {
            place,
            forward,
            pull: (self.slip_law[0] * (self.slip_law[1] * slip).atan()).sin(),
            drift: -(across / along.abs().max(self.guard)).atan(),
        }
    }

    /// Rates of the state; `accel` holds the specific forces a moment ago, and then those of now.
    fn rates(&self, x: &State, controls: &Controls, accel: &mut [f64; 2]) -> State {
        let truth = self.truth_near(x, controls, *accel);
        *accel = truth.accel;
        let mut rates = [0.0; 7];
        rates[0] = truth.accel[0] + x[2] * x[1];
        rates[1] = truth.accel[1] - x[2] * x[0];
        rates[2] = truth.yaw_acceleration;
        for i in 0..4 {
            let turn = x[3 + i];
            let brake = controls.brake[i] * (turn / self.brake_fade).clamp(-1.0, 1.0);
            let rolling = self.rolling * truth.load[i] * self.radius * (turn / 0.1).tanh();
            let torque = controls.drive[i] - brake - rolling - self.radius * truth.force_x[i];
            rates[3 + i] = torque / self.wheel_inertia;
        }
        rates
    }

    /// The state `dt` seconds later; `controls` gives the controls at a time within the step.
    pub fn advance(&self, x: &State, dt: f64, controls: impl Fn(f64) -> Controls) -> State {
        let steps = (dt / 1e-3).ceil().max(1.0);
        let h = dt / steps;
        let mut x = *x;
        let mut accel = [0.0, 0.0];
        for k in 0..steps as usize {
            let t = k as f64 * h;
            let at = |rates: &State, h: f64| std::array::from_fn(|i| x[i] + h * rates[i]);
            let k1 = self.rates(&x, &controls(t), &mut accel);
            let k2 = self.rates(&at(&k1, 0.5 * h), &controls(t + 0.5 * h), &mut accel);
            let k3 = self.rates(&at(&k2, 0.5 * h), &controls(t + 0.5 * h), &mut accel);
            let k4 = self.rates(&at(&k3, h), &controls(t + h), &mut accel);
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        x
    }
}
