//! What can be set in a simulation, and the machine and patient that are drawn for it.

use crate::simulate::{Request, SimulateError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use wheelstate::estimator::nursing_robot::Parameters;
use wheelstate::model::nursing_robot::Human;
use wheelstate::plant::nursing_robot::{Chassis, Person};
use wheelstate::{Variables, variables};

variables! {
    /// The plant beyond the parameters that the estimator knows.
    pub struct PlantSettings {
        /// Length of the log; 0 takes that of the scenario.
        duration: f64 = 0.0, "s", [0.0, 86400.0];
        /// Force and yaw rate beside the speed as a multiple of the scenario's.
        effort: f64 = 1.0, "1", [0.0, 10.0];
        /// Yaw moment of inertia of the robot.
        yaw_inertia: f64 = 20.0, "kg.m2", [1e-3, 1e5];
        /// Largest wheel torque of a motor.
        torque_limit: f64 = 21.0, "N.m", [0.1, 1e5];
        /// Time constant of the motors.
        motor_lag: f64 = 0.01, "s", [0.0, 1.0];
        /// Largest relative error of the rolling coefficient that the estimator assumes, where the scenario has one.
        rolling_error: f64 = 0.1, "1", [0.0, 0.9];
        /// Whether patients are drawn; off takes human.* as they are set or declared.
        draw_patient: bool = true, "1";
    }
}

variables! {
    /// The sensors.
    pub struct NoiseSettings {
        /// Standard deviation of the speed.
        speed: f64 = 0.005, "m/s", [0.0, 1.0];
        /// Resolution of the speed; 0 for none.
        speed_step: f64 = 0.001, "m/s", [0.0, 1.0];
        /// Standard deviation of the yaw rate.
        yaw_rate: f64 = 0.005, "rad/s", [0.0, 1.0];
        /// Standard deviation of each wheel's torque.
        torque: f64 = 0.3, "N.m", [0.0, 1e3];
        /// Largest relative error of the torque scale, where the scenario has one.
        torque_gain: f64 = 0.01, "1", [0.0, 0.5];
        /// Standard deviation of tilt and roll.
        tilt: f64 = 0.01, "rad", [0.0, 1.0];
        /// Standard deviation of tilt rate and roll rate.
        tilt_rate: f64 = 0.01, "rad/s", [0.0, 1.0];
        /// Offset of the tilt.
        tilt_bias: f64 = 0.0, "rad", [-1.0, 1.0];
        /// Offset of the tilt rate.
        tilt_rate_bias: f64 = 0.0, "rad/s", [-1.0, 1.0];
        /// Standard deviation of the longitudinal specific force.
        accel: f64 = 0.05, "m/s2", [0.0, 10.0];
    }
}

variables! {
    /// All that is not a parameter of the machine.
    pub struct Settings {
        /// The plant.
        plant: PlantSettings;
        /// The sensors.
        noise: NoiseSettings;
    }
}

/// The settings of a request, sorted.
pub struct Chosen {
    /// Parameters of the machine as declared or set.
    pub machine: Parameters,
    /// Names of those that were set.
    pub fixed: Vec<String>,
    /// The rest.
    pub settings: Settings,
}

impl Chosen {
    /// Checks the settings of a request.
    pub fn of(request: &Request) -> Result<Self, SimulateError> {
        let mut chosen = Self { machine: Parameters::default(), fixed: Vec::new(), settings: Settings::default() };
        for (name, value) in &request.settings {
            if name.starts_with("plant.") || name.starts_with("noise.") {
                chosen.settings.set(name, *value)?;
            } else {
                chosen.machine.set(name, *value)?;
                chosen.fixed.push(name.clone());
            }
        }
        chosen.machine.validate()?;
        Ok(chosen)
    }

    /// Draws a patient into `machine`: mass 50..100 kg, stature 1.55..1.85 m (unless `weighed`), pitch
    /// sway 0.7..1.3 Hz and roll sway 0.8..1.6 Hz with damping ratios 0.2..0.5. What was set stays.
    pub fn draw_patient(
        &self,
        rng: &mut ChaCha8Rng,
        weighed: bool,
        machine: &mut Parameters,
    ) -> Result<(), SimulateError> {
        let mut draw = |low: f64, high: f64| rng.random_range(low..high);
        let (mass, stature) = (draw(50.0, 100.0), draw(1.55, 1.85));
        let (pitch, pitch_ratio) = (TAU * draw(0.7, 1.3), draw(0.2, 0.5));
        let (roll, roll_ratio) = (TAU * draw(0.8, 1.6), draw(0.2, 0.5));
        if !self.settings.plant.draw_patient {
            return Ok(());
        }
        let mut offers = Vec::new();
        if !weighed {
            // Winter's table: head, arms and trunk of a sitting person.
            offers.push(("human.nominal_mass", mass));
            offers.push(("human.com_height", 0.180 * stature));
            offers.push(("human.gyration_radius", 0.1428 * stature));
        }
        self.offer_all(&offers, machine)?;
        let (human, mass) = (&machine.human, machine.human.nominal_mass);
        let (inertia, toppling) = (human.hip_inertia(mass), human.toppling_stiffness(mass));
        self.offer_all(
            &[
                ("human.stiffness_pitch", inertia * pitch * pitch + toppling),
                ("human.damping_pitch", 2.0 * pitch_ratio * inertia * pitch),
                ("human.stiffness_roll", inertia * roll * roll + toppling),
                ("human.damping_roll", 2.0 * roll_ratio * inertia * roll),
            ],
            machine,
        )
    }

    /// Another patient after `first`: mass and stature drawn anew, sway frequencies within 10 % and damping
    /// ratios within 20 % of those of the first, who has been identified.
    pub fn successor(&self, rng: &mut ChaCha8Rng, first: &Parameters) -> Parameters {
        let mut draw = |low: f64, high: f64| rng.random_range(low..high);
        let mut next = first.clone();
        let stature = draw(1.55, 1.85);
        let human = &mut next.human;
        human.nominal_mass = draw(50.0, 100.0);
        (human.com_height, human.gyration_radius) = (0.180 * stature, 0.1428 * stature);
        let (old, new) = (first.human, next.human);
        let of = |human: &Human| (human.hip_inertia(human.nominal_mass), human.toppling_stiffness(human.nominal_mass));
        let ((old_inertia, old_toppling), (new_inertia, new_toppling)) = (of(&old), of(&new));
        let spring = |k: f64, factor: f64| {
            let stiffness = (k - old_toppling) / old_inertia;
            new_inertia * stiffness * factor * factor + new_toppling
        };
        let damper = |c: f64, factor: f64| c / old_inertia * new_inertia * factor;
        next.human.stiffness_pitch = spring(old.stiffness_pitch, draw(0.9, 1.1));
        next.human.stiffness_roll = spring(old.stiffness_roll, draw(0.9, 1.1));
        next.human.damping_pitch = damper(old.damping_pitch, draw(0.8, 1.2));
        next.human.damping_roll = damper(old.damping_roll, draw(0.8, 1.2));
        next
    }

    /// Sets parameters of the machine, except those that the request has set.
    pub fn offer_all(&self, offers: &[(&str, f64)], machine: &mut Parameters) -> Result<(), SimulateError> {
        for (name, value) in offers.iter().filter(|(name, _)| !self.fixed.iter().any(|fixed| fixed == name)) {
            machine.set(name, *value)?;
        }
        Ok(())
    }

    /// The chassis of a machine.
    pub fn chassis(&self, p: &Parameters) -> Chassis {
        Chassis {
            mass: p.robot.mass,
            track: p.robot.track,
            wheel_radius: p.robot.wheel_radius,
            wheel_inertia: p.robot.wheel_inertia,
            rotating_mass: p.robot.rotating_mass,
            yaw_inertia: self.settings.plant.yaw_inertia,
            efficiency: p.robot.drive_efficiency,
            rolling: p.rolling.coefficient,
            smoothing_speed: p.rolling.smoothing_speed,
            torque_limit: self.settings.plant.torque_limit,
            motor_lag: self.settings.plant.motor_lag,
        }
    }
}

/// The person of a machine.
pub fn person(p: &Parameters) -> Person {
    let human = &p.human;
    Person {
        mass: human.nominal_mass,
        swaying: human.swaying_fraction,
        height: human.com_height,
        gyration: human.gyration_radius,
        stiffness: [human.stiffness_roll, human.stiffness_pitch],
        damping: [human.damping_roll, human.damping_pitch],
        rest: [human.rest_roll, human.rest_pitch],
    }
}
