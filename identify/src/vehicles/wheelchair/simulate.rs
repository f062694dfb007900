//! Wheelchair: drives over a ramp, and a drive for the identification.
//!
//! Settings that are parameters of the estimator describe the plant too: `chair.mass=120` is a heavier
//! chair. `plant.*` makes the plant differ from what an estimator with these parameters assumes.

use crate::log::Log;
use crate::simulate::{Knob, Manoeuvres, Request, Scenario, SimulateError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use wheelstate::estimator::wheelchair::Parameters;
use wheelstate::plant::wheelchair::{Actuation, Body, Course, Noise, Plant, Ramp, Sensors};
use wheelstate::{Variables, variables};

/// The scenarios.
pub const SCENARIOS: &[Scenario] = &[
    Scenario {
        name: "climb",
        about: "straight up a ramp of 0.08 rad and, without force, down again; initial.heading = 1.5708",
    },
    Scenario {
        name: "oblique",
        about: "onto the ramp at 60 degrees to its contour line, where gravity turns it; initial.heading = 1.0472",
    },
    Scenario {
        name: "yaw-moment",
        about: "straight up the ramp with a yaw moment of 3 N m for half a second; initial.heading = 1.5708",
    },
    Scenario {
        name: "identification",
        about: "40 s of pushes in both directions and turns, for the fit; initial.heading = 1",
    },
];

/// What can be driven on purpose.
pub const MANOEUVRES: Manoeuvres = Manoeuvres {
    scenarios: &["climb", "oblique", "yaw-moment", "identification"],
    knobs: &[
        Knob { name: "plant.duration", scenarios: &[] },
        Knob { name: "plant.effort", scenarios: &[] },
        Knob { name: "plant.slope", scenarios: &["climb", "oblique", "yaw-moment"] },
    ],
    commands: &["drive_force", "drive_moment"],
    settings: Settings::declare,
    plant: |values| values.to_vec(),
    // A hard floor to a soft carpet, and casters.
    supposed: &[("rolling.coefficient", 0.0, 0.02), ("chair.yaw_friction", 0.0, 1.5)],
    unforeseen: &[],
};

variables! {
    /// The plant beyond the estimator's parameters.
    struct PlantSettings {
        /// Mass of chair and user; chair.mass unless set.
        mass: f64 = 100.0, "kg", [1.0, 1e4];
        /// Yaw inertia about the centre of mass; chair.yaw_inertia unless set.
        yaw_inertia: f64 = 7.0, "kg.m2", [1e-3, 1e5];
        /// Forward position of the centre of mass, from the axle; chair.com_ahead unless set.
        com_ahead: f64 = 0.12, "m", [-2.0, 2.0];
        /// Viscous drag; chair.drag unless set.
        drag: f64 = 12.0, "N.s/m", [0.0, 1e4];
        /// Viscous yaw drag; chair.yaw_drag unless set.
        yaw_drag: f64 = 3.0, "N.m.s/rad", [0.0, 1e4];
        /// Dry yaw friction; chair.yaw_friction unless set.
        yaw_friction: f64 = 0.0, "N.m", [0.0, 1e3];
        /// Rolling resistance coefficient; rolling.coefficient unless set.
        rolling_coefficient: f64 = 0.0, "1", [0.0, 1.0];
        /// Force that acts over force that is reported.
        force_gain: f64 = 1.0, "1", [0.0, 10.0];
        /// Moment that acts over moment that is reported.
        moment_gain: f64 = 1.0, "1", [0.0, 10.0];
        /// Force that is not reported.
        force_bias: f64 = 0.0, "N", [-1e4, 1e4];
        /// Moment that is not reported.
        moment_bias: f64 = 0.0, "N.m", [-1e4, 1e4];
        /// Bias of the gyro.
        gyro_bias: f64 = 0.0, "rad/s", [-10.0, 10.0];
        /// Bias of the forward accelerometer.
        accel_x_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Bias of the accelerometer to the left.
        accel_y_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Bias of the accelerometer upward.
        accel_z_bias: f64 = 0.0, "m/s2", [-10.0, 10.0];
        /// Steps per turn of the encoders; 0 = continuous.
        encoder_counts: f64 = 0.0, "1", [0.0, 1e9];
        /// Heading at the start; that of the scenario unless set.
        heading: f64 = 0.0, "rad", [-100.0, 100.0];
        /// Tilt of the ground before and after the ramp.
        slope_base: f64 = 0.0, "rad", [-1.0, 1.0];
        /// Tilt of the ramp.
        slope: f64 = 0.08, "rad", [-1.0, 1.0];
        /// Time at which the ramp begins.
        slope_from: f64 = 2.0, "s", [0.0, 1e6];
        /// Time at which it ends.
        slope_to: f64 = 6.0, "s", [0.0, 1e6];
        /// Duration of its edges; 0 = steps.
        slope_edge: f64 = 0.5, "s", [0.0, 1e6];
        /// Duration.
        duration: f64 = 10.0, "s", [0.1, 36000.0];
        /// Force and moment as a multiple of the scenario's.
        effort: f64 = 1.0, "1", [0.0, 10.0];
    }
}

variables! {
    /// Standard deviations of white noise, and outliers.
    struct NoiseSettings {
        /// Of one wheel angle.
        encoder: f64 = 3e-3, "rad", [0.0, 10.0];
        /// Of the gyro.
        gyro: f64 = 5e-3, "rad/s", [0.0, 10.0];
        /// Of the accelerometer, per axis.
        accel: f64 = 0.05, "m/s2", [0.0, 100.0];
        /// Share of the accelerometer's samples that are outliers.
        outliers: f64 = 0.0, "1", [0.0, 1.0];
        /// Largest outlier.
        outlier_size: f64 = 10.0, "m/s2", [0.0, 1e3];
    }
}

variables! {
    /// All settings of the simulation.
    struct Settings {
        /// Plant.
        plant: PlantSettings;
        /// Sensors.
        noise: NoiseSettings;
    }
}

/// Runs a scenario.
pub fn simulate(request: &Request) -> Result<Log, SimulateError> {
    let course = match request.scenario.as_str() {
        "climb" => Course::Climb,
        "oblique" => Course::Oblique,
        "yaw-moment" => Course::YawMoment,
        "identification" => Course::Identification,
        _ => return Err(SimulateError::unknown(&request.scenario, SCENARIOS)),
    };
    let mut assumed = Parameters::default();
    if course == Course::Identification {
        // Something to be found: resistance that the estimator's defaults do not know.
        (assumed.rolling.coefficient, assumed.chair.yaw_friction) = (0.012, 0.6);
    }
    assumed.initial.heading = course.heading();
    let own = |name: &str| name.starts_with("plant.") || name.starts_with("noise.");
    for (name, value) in request.settings.iter().filter(|(name, _)| !own(name)) {
        assumed.set(name, *value)?;
    }
    let mut settings = defaults(course, &assumed);
    for (name, value) in request.settings.iter().filter(|(name, _)| own(name)) {
        settings.set(name, *value)?;
    }
    Ok(run(request, course, &assumed, &settings))
}

/// A plant as the estimator's parameters say.
fn defaults(course: Course, assumed: &Parameters) -> Settings {
    let mut settings = Settings::default();
    let (ramp, chair) = (course.ramp(), &assumed.chair);
    settings.plant = PlantSettings {
        mass: chair.mass,
        yaw_inertia: chair.yaw_inertia,
        com_ahead: chair.com_ahead,
        drag: chair.drag,
        yaw_drag: chair.yaw_drag,
        yaw_friction: chair.yaw_friction,
        rolling_coefficient: assumed.rolling.coefficient,
        heading: assumed.initial.heading,
        slope_base: ramp.base,
        slope: ramp.slope,
        slope_from: ramp.from,
        slope_to: ramp.to,
        slope_edge: ramp.edge,
        duration: course.duration(),
        ..settings.plant
    };
    if course == Course::Identification {
        settings.plant.encoder_counts = 4096.0;
        settings.noise.encoder = 0.0;
    }
    settings
}

fn plant(assumed: &Parameters, p: &PlantSettings) -> Plant {
    let chair = &assumed.chair;
    let body = Body {
        mass: p.mass,
        yaw_inertia: p.yaw_inertia,
        com_ahead: p.com_ahead,
        drag: p.drag,
        yaw_drag: p.yaw_drag,
        yaw_friction: p.yaw_friction,
        rolling_coefficient: p.rolling_coefficient,
        smoothing_speed: assumed.rolling.smoothing_speed,
        smoothing_yaw_rate: assumed.rolling.smoothing_yaw_rate,
        wheel_radius: chair.wheel_radius,
        wheel_inertia: chair.wheel_inertia,
        track: chair.reference_to_right + chair.reference_to_left,
        imu: [assumed.imu.x, assumed.imu.y, assumed.imu.z],
        gravity: assumed.gravity,
    };
    let ramp = Ramp { base: p.slope_base, slope: p.slope, from: p.slope_from, to: p.slope_to, edge: p.slope_edge };
    let actuation = Actuation {
        force_gain: p.force_gain,
        moment_gain: p.moment_gain,
        force_bias: p.force_bias,
        moment_bias: p.moment_bias,
    };
    let sensors = Sensors {
        gyro_bias: p.gyro_bias,
        accel_bias: [p.accel_x_bias, p.accel_y_bias, p.accel_z_bias],
        encoder_counts: p.encoder_counts,
        encoder_on_frame: assumed.encoder.counts_body_pitch,
    };
    let mut plant = Plant::new(body, ramp, actuation, sensors, p.heading);
    plant.push(assumed.initial.speed, 0.0);
    plant
}

const CHANNELS: [&str; 15] = [
    "encoder_left",
    "encoder_right",
    "gyro_pitch",
    "accel_x",
    "accel_y",
    "accel_z",
    "drive_force",
    "drive_moment",
    "true_distance",
    "true_heading",
    "true_speed",
    "true_yaw_rate",
    "true_slope",
    "true_slope_rate",
    "true_pitch",
];

fn run(request: &Request, course: Course, assumed: &Parameters, settings: &Settings) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(request.seed);
    let mut plant = plant(assumed, &settings.plant);
    let period = assumed.sample_period;
    let samples = (settings.plant.duration / period).round() as usize + 1;
    let mut columns = CHANNELS.map(|_| Vec::with_capacity(samples));
    for _ in 0..samples {
        let truth = plant.truth();
        let command = course.command(plant.time(), truth.speed).map(|each| settings.plant.effort * each);
        let reading = plant.measure(command, &draw(&settings.noise, &mut rng));
        let row = [
            reading.encoder_left,
            reading.encoder_right,
            reading.gyro_pitch,
            reading.accel[0],
            reading.accel[1],
            reading.accel[2],
            command[0],
            command[1],
            truth.distance,
            truth.heading,
            truth.speed,
            truth.yaw_rate,
            truth.slope,
            truth.slope_rate,
            truth.pitch,
        ];
        columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        plant.advance(command, period);
    }
    let mut log = Log {
        source: format!("{} (seed {})", request.scenario, request.seed),
        time: (0..samples).map(|k| k as f64 * period).collect(),
        ..Log::default()
    };
    for (name, values) in CHANNELS.iter().zip(columns) {
        log.push(name, values);
    }
    // What the identification can find, as constant channels.
    let p = &settings.plant;
    for (name, value) in [
        ("chair.mass", p.mass),
        ("chair.yaw_inertia", p.yaw_inertia),
        ("chair.com_ahead", p.com_ahead),
        ("chair.drag", p.drag),
        ("chair.yaw_drag", p.yaw_drag),
        ("chair.yaw_friction", p.yaw_friction),
        ("rolling.coefficient", p.rolling_coefficient),
    ] {
        log.push(&format!("true_{name}"), vec![value; samples]);
    }
    log
}

fn draw(noise: &NoiseSettings, rng: &mut ChaCha8Rng) -> Noise {
    let mut normal = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, rng);
    let (encoder_left, encoder_right) = (normal(noise.encoder), normal(noise.encoder));
    let gyro_pitch = normal(noise.gyro);
    let mut accel = [normal(noise.accel), normal(noise.accel), normal(noise.accel)];
    let mut uniform = |low: f64, high: f64| Uniform::new(low, high).map_or(0.0, |range| range.sample(rng));
    for axis in &mut accel {
        // Drawn in any case, so that the share of outliers does not change the rest of the noise.
        let (chance, size) = (uniform(0.0, 1.0), uniform(-1.0, 1.0));
        if chance < noise.outliers {
            *axis += size * noise.outlier_size;
        }
    }
    Noise { encoder_left, encoder_right, gyro_pitch, accel }
}
