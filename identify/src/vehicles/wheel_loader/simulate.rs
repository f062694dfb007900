//! The wheel loader's scenarios: rough roads, spading, constant torque, accelerating and braking.

use crate::log::Log;
use crate::simulate::{Knob, Manoeuvres, Request, Scenario, SimulateError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::model::wheel_loader::{Loader, Rolling, Tire};
use wheelstate::plant::road::{Road, class};
use wheelstate::plant::wheel_loader::{self as plant, Action, Plant};
use wheelstate::{Variables, variables};

/// What there is.
pub const SCENARIOS: &[Scenario] = &[
    Scenario { name: "bumpy-c", about: "10 s at constant torque on an average road (ISO 8608 class C)" },
    Scenario { name: "bumpy-d", about: "10 s at constant torque on a poor road (ISO 8608 class D)" },
    Scenario { name: "spade", about: "as bumpy-c, with 600 N against the bucket from 5.0 to 7.2 s" },
    Scenario { name: "spade-heavy", about: "as bumpy-c, with 6 kN against and 2.5 kN down on the bucket" },
    Scenario { name: "constant-torque", about: "20 s: standstill, 10 s of small constant torque, braking" },
    Scenario { name: "accelerate-brake", about: "30 s of accelerating, braking and coasting on a good road" },
];

/// What can be driven on purpose.
pub const MANOEUVRES: Manoeuvres = Manoeuvres {
    scenarios: &["bumpy-c", "bumpy-d", "spade", "spade-heavy", "constant-torque", "accelerate-brake"],
    knobs: &[
        Knob { name: "plant.length", scenarios: &[] },
        Knob { name: "plant.torque", scenarios: &[] },
        Knob { name: "plant.grade", scenarios: &[] },
        Knob { name: "plant.roughness", scenarios: &[] },
    ],
    commands: &["torque_front", "torque_rear", "brake_front", "brake_rear", "spading_force_x", "spading_force_z"],
    settings: Settings::declare,
    plant: |values| {
        let known = Settings::declare();
        let of = |(name, value): &(String, f64)| {
            let name = name.strip_prefix("initial.").map_or(name.clone(), |unknown| format!("plant.{unknown}"));
            known.iter().any(|setting| setting.name == name).then_some((name, *value))
        };
        values.iter().filter_map(of).collect()
    },
    supposed: &[],
    unforeseen: &[],
};

/// Reduction from the motors, whose torques the scenarios are stated in, to the wheels.
const REDUCTION: f64 = 20.0;
/// Integration step of the plant, s.
const STEP: f64 = 1e-3;
const HARMONICS: usize = 400;
/// Length of the tyre's contact, m.
const CONTACT: f64 = 0.3;

variables! {
    /// The truth behind the log.
    pub struct Truth {
        /// Distance of the centre of gravity to the rear axle over the wheelbase.
        cg_ratio: f64 = 0.45, "1", [0.05, 0.95];
        /// Height of the centre of gravity above ground.
        cg_height: f64 = 0.95, "m", [0.1, 5.0];
        /// Slip stiffness at half the weight.
        slip_stiffness: f64 = 19.0, "1", [1.0, 200.0];
        /// Relative loss of slip stiffness when the load doubles.
        load_sensitivity: f64 = 0.05, "1", [-0.5, 0.5];
        /// Shape factor of the magic formula.
        shape: f64 = 1.5, "1", [1.0, 2.0];
        /// Curvature factor of the magic formula.
        curvature: f64 = 0.3, "1", [-5.0, 1.0];
        /// Relaxation length of the tyres.
        relaxation_length: f64 = 0.35, "m", [0.02, 2.0];
        /// Vertical stiffness of an axle's tyres.
        tire_stiffness: f64 = 7e5, "N/m", [1e4, 1e8];
        /// Vertical damping of an axle's tyres.
        tire_damping: f64 = 7e3, "N.s/m", [0.0, 1e6];
        /// Pitch inertia.
        pitch_inertia: f64 = 6200.0, "kg.m2", [1.0, 1e7];
        /// Relative error of the front rolling radius as given.
        wheel_radius_front_error: f64 = 0.0, "1", [-0.05, 0.05];
        /// Relative error of the rear rolling radius as given.
        wheel_radius_rear_error: f64 = 0.0, "1", [-0.05, 0.05];
        /// Loss of rolling radius per tyre deflection.
        radius_softness: f64 = 0.0, "1", [0.0, 1.0];
        /// Share of the wheels' own moments (rolling, spinning up) that counts in the pitch balance.
        wheel_moments: f64 = 0.0, "1", [0.0, 1.0];
        /// Relative error of the mass as given.
        mass_error: f64 = 0.0, "1", [-0.5, 0.5];
        /// Error of the rolling resistance coefficient as given.
        rolling_error: f64 = 0.0, "1", [-0.1, 0.1];
        /// Roughness of the road as a multiple of the scenario's.
        roughness: f64 = 1.0, "1", [0.0, 100.0];
        /// Grade, positive uphill.
        grade: f64 = 0.0, "rad", [-0.3, 0.3];
        /// Torque as a multiple of the scenario's.
        torque: f64 = 1.0, "1", [0.0, 10.0];
        /// Length of the log as a multiple of the scenario's.
        length: f64 = 1.0, "1", [0.1, 100.0];
    }
}

variables! {
    /// White noise of the sensors.
    pub struct Noise {
        /// Of the speed.
        speed: f64 = 0.02, "m/s", [0.0, 10.0];
        /// Of the wheel speeds.
        wheel_speed: f64 = 0.02, "rad/s", [0.0, 100.0];
        /// Of the torques.
        torque: f64 = 10.0, "N.m", [0.0, 1e5];
        /// Of the slope.
        slope: f64 = 0.003, "rad", [0.0, 0.5];
    }
}

variables! {
    /// What `--set` may name.
    pub struct Settings {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-3, 0.5];
        /// The machine as its user knows it.
        loader: Loader;
        /// Rolling resistance.
        rolling: Rolling;
        /// The tyres.
        tire: Tire;
        /// The truth.
        plant: Truth;
        /// Sensor noise.
        noise: Noise;
    }
}

/// Runs a scenario.
pub fn simulate(request: &Request) -> Result<Log, SimulateError> {
    let mut settings = Settings::default();
    for (name, value) in &request.settings {
        settings.set(name, *value)?;
    }
    let Some(course) = Course::named(&request.scenario) else {
        return Err(SimulateError::unknown(&request.scenario, SCENARIOS));
    };
    Ok(drive(course, &settings, request))
}

fn machine(settings: &Settings) -> plant::Machine {
    let (given, truth) = (&settings.loader, &settings.plant);
    let rolling = settings.rolling.coefficient + truth.rolling_error;
    // The given radius is the one at zero torque; the kinematic one is smaller by the slip that the
    // rolling moment causes.
    let radius = |given: f64, error: f64| given * (1.0 + error) / (1.0 + rolling / truth.slip_stiffness);
    plant::Machine {
        mass: given.mass * (1.0 + truth.mass_error),
        pitch_inertia: truth.pitch_inertia,
        to_axle: [(1.0 - truth.cg_ratio) * given.wheelbase, truth.cg_ratio * given.wheelbase],
        cg_height: truth.cg_height,
        wheel_radius: [
            radius(given.wheel_radius_front, truth.wheel_radius_front_error),
            radius(given.wheel_radius_rear, truth.wheel_radius_rear_error),
        ],
        radius_softness: truth.radius_softness,
        axle_inertia: [given.axle_inertia_front, given.axle_inertia_rear],
        tire_stiffness: truth.tire_stiffness,
        tire_damping: truth.tire_damping,
        slip_stiffness: truth.slip_stiffness,
        load_sensitivity: truth.load_sensitivity,
        friction: settings.tire.friction,
        shape: truth.shape,
        curvature: truth.curvature,
        relaxation_length: truth.relaxation_length,
        rolling: rolling.max(0.0),
        wheel_moments: truth.wheel_moments,
        bucket: [given.bucket_reach, given.bucket_height],
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Course {
    Bumpy { roughness: f64, spading: [f64; 2] },
    ConstantTorque,
    AccelerateBrake,
}

impl Course {
    fn named(name: &str) -> Option<Self> {
        let bumpy = |roughness, spading| Some(Self::Bumpy { roughness, spading });
        match name {
            "bumpy-c" => bumpy(class::C, [0.0; 2]),
            "bumpy-d" => bumpy(class::D, [0.0; 2]),
            "spade" => bumpy(class::C, [600.0, 0.0]),
            "spade-heavy" => bumpy(class::C, [6000.0, 2500.0]),
            "constant-torque" => Some(Self::ConstantTorque),
            "accelerate-brake" => Some(Self::AccelerateBrake),
            _ => None,
        }
    }

    /// Roughness of the road, start speed, duration.
    fn frame(self) -> (f64, f64, f64) {
        match self {
            Self::Bumpy { roughness, .. } => (roughness, 1.0, 10.0),
            Self::ConstantTorque => (class::A, 0.0, 20.0),
            Self::AccelerateBrake => (class::A, 1.0, 30.0),
        }
    }

    /// What acts at time `t` and speed `v`.
    fn action(self, t: f64, v: f64, grade: f64) -> Action {
        let mut action = Action { grade, ..Action::default() };
        match self {
            Self::Bumpy { spading, .. } => {
                action.torque = [50.0 * REDUCTION; 2];
                action.spading = spading.map(|force| force * between(t, 5.0, 7.2, 0.2));
            }
            Self::ConstantTorque => {
                action.torque = [32.0 * REDUCTION * between(t, 4.0, 14.0, 0.1); 2];
                action.brake = [150.0 * rise(t, 15.0, 0.1); 2];
            }
            Self::AccelerateBrake => {
                let phase = t.rem_euclid(6.0);
                // The limits act smoothly: torque that chatters at a limit would alias in the log.
                let drive = 90.0 * between(phase, 0.0, 3.2, 0.2) * (1.0 - rise(v, 5.4, 0.6));
                let brake = -70.0 * between(phase, 3.5, 5.6, 0.2) * rise(v, 0.9, 0.4);
                action.torque = [(drive + brake) * REDUCTION; 2];
            }
        }
        action
    }
}

/// 0 before `start`, 1 after `start + ramp`, smooth in between.
fn rise(x: f64, start: f64, ramp: f64) -> f64 {
    let s = ((x - start) / ramp).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// 1 between `start` and `end` with ramps inside.
fn between(x: f64, start: f64, end: f64, ramp: f64) -> f64 {
    rise(x, start, ramp) * (1.0 - rise(x, end - ramp, ramp))
}

fn drive(course: Course, settings: &Settings, request: &Request) -> Log {
    let mut random = ChaCha8Rng::seed_from_u64(request.seed);
    let (roughness, speed, duration) = course.frame();
    let truth = &settings.plant;
    let duration = duration * truth.length;
    let phases: Vec<f64> = (0..HARMONICS).map(|_| random.random::<f64>() * std::f64::consts::TAU).collect();
    let road = Road::iso8608(roughness * truth.roughness, &phases, CONTACT, 8.0 * duration + 20.0);
    let machine = machine(settings);
    let mut plant = Plant::new(machine, road, speed);

    let period = settings.sample_period;
    let samples = (duration / period).round() as usize + 1;
    let mut columns: Vec<Vec<f64>> = vec![Vec::with_capacity(samples); COLUMNS.len()];
    let noise = &settings.noise;
    let add = |value: f64, std: f64, random: &mut ChaCha8Rng| {
        let draw: f64 = StandardNormal.sample(random);
        value + std * draw
    };
    let act = |t: f64, v: f64| {
        let mut action = course.action(t, v, truth.grade);
        action.torque = action.torque.map(|torque| torque * truth.torque);
        action
    };
    let substeps = (period / STEP).ceil().max(1.0) as usize;
    let h = period / substeps as f64;
    for k in 0..samples {
        let start = k as f64 * period;
        let action = act(start, plant.speed());
        let (loads, wheels) = (plant.loads(), plant.wheel_speeds());
        let row = [
            add(action.torque[0], noise.torque, &mut random),
            add(action.torque[1], noise.torque, &mut random),
            action.brake[0],
            action.brake[1],
            add(plant.slope(truth.grade), noise.slope, &mut random),
            action.spading[0],
            action.spading[1],
            add(plant.speed(), noise.speed, &mut random),
            add(wheels[0], noise.wheel_speed, &mut random),
            add(wheels[1], noise.wheel_speed, &mut random),
            truth.cg_ratio,
            truth.cg_height,
            truth.slip_stiffness,
            loads[0] / (loads[0] + loads[1]),
            loads[0],
            loads[1],
            plant.speed(),
            wheels[0],
            wheels[1],
            settings.loader.wheel_radius_front * (1.0 + truth.wheel_radius_front_error),
            settings.loader.wheel_radius_rear * (1.0 + truth.wheel_radius_rear_error),
            settings.rolling.coefficient + truth.rolling_error,
        ];
        for (column, value) in columns.iter_mut().zip(row) {
            column.push(value);
        }
        for i in 0..substeps {
            let t = start + i as f64 * h;
            // Midpoint in time; the speed limiter sees the speed at the step's begin.
            plant.advance(&act(t + 0.5 * h, plant.speed()), h);
        }
    }
    let mut log = Log {
        source: format!("simulated wheel-loader {}", request.scenario),
        time: (0..samples).map(|k| k as f64 * period).collect(),
        ..Log::default()
    };
    for (name, values) in COLUMNS.iter().zip(columns) {
        log.push(name, values);
    }
    log
}

const COLUMNS: [&str; 22] = [
    "torque_front",
    "torque_rear",
    "brake_front",
    "brake_rear",
    "slope",
    "spading_force_x",
    "spading_force_z",
    "speed",
    "wheel_speed_front",
    "wheel_speed_rear",
    "true_cg_ratio",
    "true_cg_height",
    "true_slip_stiffness",
    "true_load_ratio",
    "true_load_front",
    "true_load_rear",
    "true_speed",
    "true_wheel_speed_front",
    "true_wheel_speed_rear",
    "true_wheel_radius_front",
    "true_wheel_radius_rear",
    "true_rolling_coefficient",
];
