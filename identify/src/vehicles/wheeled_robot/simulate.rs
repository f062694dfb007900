//! Four-wheeled robot: manoeuvres with noisy sensors.

use crate::log::Log;
use crate::simulate::{Knob, Manoeuvres, Request, Scenario, SimulateError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use wheelstate::estimator::wheeled_robot::Parameters;
use wheelstate::model::tire::Tire;
use wheelstate::plant::wheeled_robot::{Controls, Machine, State, TireLaw, Truth};
use wheelstate::{Variables, variables};

/// The scenarios.
pub const SCENARIOS: &[Scenario] = &[
    Scenario { name: "sine", about: "sine steering while the robot accelerates and brakes in turn" },
    Scenario { name: "vector", about: "straight steering, left and right wheels driven against each other" },
    Scenario { name: "lane-change", about: "double lane change at held speed" },
    Scenario { name: "step-steer", about: "steering step at held speed" },
    Scenario { name: "accelerate-brake", about: "hard acceleration, coasting, braking, with little steering" },
    Scenario { name: "low-friction", about: "double lane change on slippery ground (friction 0.35 instead of 0.8)" },
];

/// What can be driven on purpose.
pub const MANOEUVRES: Manoeuvres = Manoeuvres {
    scenarios: &["sine", "vector", "lane-change", "step-steer", "accelerate-brake"],
    knobs: &[
        Knob { name: "plant.duration", scenarios: &[] },
        Knob { name: "plant.speed", scenarios: &[] },
        Knob { name: "plant.lateral", scenarios: &["sine", "lane-change", "step-steer", "accelerate-brake"] },
        Knob { name: "plant.longitudinal", scenarios: &["sine", "accelerate-brake"] },
    ],
    commands: &[
        "steering_angle",
        "drive_torque_fl",
        "drive_torque_fr",
        "drive_torque_rl",
        "drive_torque_rr",
        "brake_torque_fl",
        "brake_torque_fr",
        "brake_torque_rl",
        "brake_torque_rr",
    ],
    settings: Simulation::declare,
    plant: |values| values.to_vec(),
    supposed: &[("rolling.coefficient", 0.0, 0.03)],
    unforeseen: &[],
};

variables! {
    /// The plant beyond the estimator's parameters.
    struct Plant {
        /// Ground friction over that of the tyres' parameters.
        friction: f64 = 1.0, "1", [0.01, 3.0];
        /// Shape of the slip law Fx = mu Fz sin(shape atan(stiffness slip)).
        slip_shape: f64 = 1.6, "1", [1.0, 2.2];
        /// Stiffness of the slip law.
        slip_stiffness: f64 = 12.0, "1", [1.0, 100.0];
        /// Time constant of the drives, s.
        drive_lag: f64 = 0.02, "s", [0.0, 1.0];
        /// Speed at the start.
        speed: f64 = 3.0, "m/s", [0.0, 100.0];
        /// Lateral acceleration that the steering asks for.
        lateral: f64 = 2.5, "m/s2", [0.0, 50.0];
        /// Longitudinal acceleration that the drives ask for.
        longitudinal: f64 = 0.8, "m/s2", [0.0, 50.0];
        /// Duration.
        duration: f64 = 10.0, "s", [0.1, 3600.0];
    }
}

variables! {
    /// Sensors: standard deviations of white noise, and constant errors.
    struct Noise {
        /// Of the accelerations.
        accel: f64 = 0.1, "m/s2", [0.0, 100.0];
        /// Of the yaw rate.
        gyro: f64 = 0.01, "rad/s", [0.0, 10.0];
        /// Of the wheel speeds.
        wheel_speed: f64 = 0.03, "rad/s", [0.0, 100.0];
        /// Of the torques.
        torque: f64 = 0.05, "N.m", [0.0, 1e5];
        /// Of the steering angle.
        steering: f64 = 0.003, "rad", [0.0, 1.0];
        /// Of speed_x and speed_y.
        speed: f64 = 0.02, "m/s", [0.0, 10.0];
        /// Constant error of every drive torque.
        torque_bias: f64 = 0.0, "N.m", [-1e5, 1e5];
        /// Constant error of the yaw rate.
        gyro_bias: f64 = 0.0, "rad/s", [-1.0, 1.0];
        /// Constant error of the accelerations.
        accel_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
    }
}

variables! {
    /// All settings of the simulation.
    struct Simulation {
        /// Plant.
        plant: Plant;
        /// Sensors.
        noise: Noise;
    }
}

const WHEELS: [&str; 4] = ["fl", "fr", "rl", "rr"];

/// Runs a scenario.
pub fn simulate(request: &Request) -> Result<Log, SimulateError> {
    if !SCENARIOS.iter().any(|scenario| scenario.name == request.scenario) {
        return Err(SimulateError::unknown(&request.scenario, SCENARIOS));
    }
    let (mut parameters, mut simulation) = (Parameters::default(), Simulation::default());
    match request.scenario.as_str() {
        "low-friction" => simulation.plant.friction = 0.4375,
        "accelerate-brake" => (simulation.plant.speed, simulation.plant.longitudinal) = (1.5, 1.4),
        _ => {}
    }
    for (name, value) in &request.settings {
        if name.starts_with("plant.") || name.starts_with("noise.") {
            simulation.set(name, *value)?;
        } else {
            parameters.set(name, *value)?;
        }
    }
    Ok(run(request, &parameters, &simulation))
}

fn machine(p: &Parameters, plant: &Plant) -> Machine {
    let tire = |t: &Tire| TireLaw {
        stiffness: t.stiffness,
        nominal: t.nominal_load,
        sensitivity: t.load_sensitivity,
        shape: t.shape,
        friction: t.friction,
        friction_slope: t.friction_slope,
        curvature: t.curvature,
    };
    let v = &p.vehicle;
    Machine {
        mass: v.mass,
        yaw_inertia: v.yaw_inertia,
        arms: [v.cg_to_front, v.cg_to_rear],
        tracks: [v.track_front, v.track_rear],
        height: v.cg_height,
        radius: p.wheel.radius,
        wheel_inertia: p.wheel.inertia,
        tires: [tire(&p.tire.front), tire(&p.tire.rear)],
        ground: [plant.friction; 4],
        slip_law: [plant.slip_shape, plant.slip_stiffness],
        rolling: p.rolling.coefficient,
        combined: p.tire.combined,
        guard: p.filter.minimum_speed,
        brake_fade: 0.5,
    }
}

/// Steering angle and, for each wheel, the longitudinal force asked for, N; positive is driving.
fn demand(scenario: &str, t: f64, x: &State, p: &Parameters, plant: &Plant) -> (f64, [f64; 4]) {
    let v = &p.vehicle;
    let speed = plant.speed.max(0.5);
    let angle = (plant.lateral * (v.cg_to_front + v.cg_to_rear) / (speed * speed)).min(0.5);
    let quarter = 0.25 * v.mass * plant.longitudinal;
    let hold = 0.25 * v.mass * (2.0 * (plant.speed - x[0])).clamp(-2.0, 2.0);
    let wave = |frequency: f64| (TAU * frequency * t).sin();
    let lane_change = |size: f64| {
        let swing = |start: f64| if (start..start + 2.0).contains(&t) { (0.5 * TAU * (t - start)).sin() } else { 0.0 };
        size * (swing(2.0) - swing(5.5))
    };
    match scenario {
        "sine" => (angle * wave(0.4), [quarter * (TAU * 0.125 * t).cos(); 4]),
        "vector" => {
            let twist = 13.3 / 60.0 * v.mass * wave(0.4);
            (0.0, [hold - twist, hold + twist, hold - twist, hold + twist])
        }
        "lane-change" => (lane_change(0.6 * angle), [hold; 4]),
        "low-friction" => (lane_change(0.3 * angle), [hold; 4]),
        "step-steer" => (0.5 * angle * ((t - 2.0) / 0.2).clamp(0.0, 1.0), [hold; 4]),
        _ => {
            let force = match t {
                t if t < 1.0 => 0.0,
                t if t < 3.0 => quarter,
                t if t < 5.0 => 0.0,
                t if t < 6.5 => -1.35 * quarter,
                t if t < 8.0 => 0.7 * quarter,
                _ => 0.0,
            };
            (0.06 * angle * wave(0.25), [force; 4])
        }
    }
}

fn run(request: &Request, p: &Parameters, simulation: &Simulation) -> Log {
    let (plant, noise) = (&simulation.plant, &simulation.noise);
    let machine = machine(p, plant);
    let dt = p.sample_period;
    let count = (plant.duration / dt).round() as usize + 1;
    let mut rng = ChaCha8Rng::seed_from_u64(request.seed);
    let mut normal = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let mut names: Vec<String> = vec!["steering_angle".into()];
    let four = |name: &str| WHEELS.map(|wheel| format!("{name}_{wheel}"));
    for group in ["drive_torque", "brake_torque", "wheel_speed"] {
        names.extend(four(group));
    }
    names.extend(["accel_x", "accel_y", "gyro_z", "speed_x", "speed_y"].map(str::to_owned));
    names.extend(["true_speed_x", "true_speed_y", "true_yaw_rate", "true_sideslip"].map(str::to_owned));
    for group in ["true_wheel_force_x", "true_wheel_force_y", "true_wheel_load"] {
        names.extend(four(group));
    }
    let mut columns: Vec<Vec<f64>> = vec![Vec::with_capacity(count); names.len()];

    let mut x = machine.rolling_at(plant.speed);
    let mut torque = [0.0; 4];
    for k in 0..count {
        let t = k as f64 * dt;
        let (steering, force) = demand(&request.scenario, t, &x, p, plant);
        // Braking beyond a third of the demand is done by the brakes, the rest by the drives.
        let wanted = force.map(|f| if f < 0.0 && request.scenario == "accelerate-brake" { f / 3.0 } else { f });
        let brake: [f64; 4] = std::array::from_fn(|i| (wanted[i] - force[i]) * p.wheel.radius);
        let before = torque;
        let settled = if plant.drive_lag > 0.0 { (-dt / plant.drive_lag).exp() } else { 0.0 };
        let target = wanted.map(|f| f * p.wheel.radius);
        torque = std::array::from_fn(|i| target[i] + (before[i] - target[i]) * settled);
        let controls = Controls { steering, drive: torque, brake };
        let truth: Truth = machine.truth(&x, &controls);
        let (dx, dy, r2) = (p.imu.x, p.imu.y, x[2] * x[2]);
        let mut row = vec![steering + normal(noise.steering)];
        row.extend(torque.map(|torque| torque + noise.torque_bias + normal(noise.torque)));
        row.extend(brake);
        row.extend([x[3], x[4], x[5], x[6]].map(|speed| speed + normal(noise.wheel_speed)));
        let turn = truth.yaw_acceleration;
        row.push(truth.accel[0] - r2 * dx - turn * dy + noise.accel_bias + normal(noise.accel));
        row.push(truth.accel[1] - r2 * dy + turn * dx + noise.accel_bias + normal(noise.accel));
        row.push(x[2] + noise.gyro_bias + normal(noise.gyro));
        row.extend([x[0] + normal(noise.speed), x[1] + normal(noise.speed)]);
        let moving = x[0].hypot(x[1]) > p.filter.minimum_speed;
        row.extend([x[0], x[1], x[2], if moving { x[1].atan2(x[0]) } else { 0.0 }]);
        row.extend(truth.force_x.into_iter().chain(truth.force_y).chain(truth.load));
        columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        // steering between the samples follows the manoeuvre, torques are held
        let at = x;
        x = machine.advance(&x, dt, |later| Controls {
            steering: demand(&request.scenario, t + later, &at, p, plant).0,
            ..controls
        });
    }
    let mut log = Log {
        source: format!("{} (seed {})", request.scenario, request.seed),
        time: (0..count).map(|k| k as f64 * dt).collect(),
        ..Log::default()
    };
    for (name, values) in names.iter().zip(columns) {
        log.push(name, values);
    }
    log
}
