//! Drives of the plant with noise, and the estimator's errors on them.
#![allow(dead_code)]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use wheelstate::Estimator;
use wheelstate::estimator::wheelchair::{Inputs, Outputs, Parameters, Wheelchair};
use wheelstate::plant::wheelchair::{Actuation, Body, Course, Noise, Plant, Ramp, Reading, Sensors, Truth};

pub struct Normal(ChaCha8Rng);

impl Normal {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }
    pub fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
    /// Uniform in -1..1.
    pub fn uniform(&mut self) -> f64 {
        Uniform::new(-1.0, 1.0).unwrap().sample(&mut self.0)
    }
}

/// Sensor noise per sample: encoder, gyro, accelerometer.
#[derive(Clone, Copy)]
pub struct NoiseLevel(pub f64, pub f64, pub f64);

pub const NOMINAL: NoiseLevel = NoiseLevel(3e-3, 5e-3, 0.05);

impl NoiseLevel {
    pub fn draw(&self, normal: &mut Normal) -> Noise {
        let mut scaled = |std: f64| std * normal.draw();
        Noise {
            encoder_left: scaled(self.0),
            encoder_right: scaled(self.0),
            gyro_pitch: scaled(self.1),
            accel: [scaled(self.2), scaled(self.2), scaled(self.2)],
        }
    }
}

pub struct Drive {
    pub body: Body,
    pub course: Course,
    pub ramp: Ramp,
    pub actuation: Actuation,
    pub sensors: Sensors,
    pub noise: NoiseLevel,
    /// Of somebody who pushes from 3 to 4 s and from 5 to 5.5 s, N.
    pub push: f64,
}

impl Drive {
    pub fn nominal(course: Course) -> Self {
        Self {
            body: Body::default(),
            course,
            ramp: course.ramp(),
            actuation: Actuation::default(),
            sensors: Sensors::default(),
            noise: NOMINAL,
            push: 0.0,
        }
    }
}

/// One sample of a drive: time, what is true, what the estimator gets.
pub struct Row {
    pub time: f64,
    pub truth: Truth,
    pub inputs: Inputs,
}

pub fn inputs(reading: &Reading, command: [f64; 2]) -> Inputs {
    Inputs {
        encoder_left: reading.encoder_left,
        encoder_right: reading.encoder_right,
        gyro_pitch: reading.gyro_pitch,
        accel_x: reading.accel[0],
        accel_y: reading.accel[1],
        accel_z: reading.accel[2],
        drive_force: command[0],
        drive_moment: command[1],
    }
}

/// Samples every 10 ms.
pub fn drive(setup: &Drive, normal: &mut Normal) -> Vec<Row> {
    let heading = setup.course.heading();
    let mut plant = Plant::new(setup.body, setup.ramp, setup.actuation, setup.sensors, heading);
    let samples = (setup.course.duration() / 0.01).round() as usize;
    (0..=samples)
        .map(|k| {
            let time = 0.01 * k as f64;
            let command = setup.course.command(time, plant.truth().speed);
            let pushed = (3.0..4.0).contains(&time) || (5.0..5.5).contains(&time);
            let acting = [command[0] + if pushed { setup.push } else { 0.0 }, command[1]];
            let reading = plant.measure(acting, &setup.noise.draw(normal));
            let row = Row { time, truth: plant.truth(), inputs: inputs(&reading, command) };
            plant.advance(acting, 0.01);
            row
        })
        .collect()
}

/// The estimator's parameters for a course, its start drawn as uncertain as it believes.
pub fn parameters(course: Course, normal: &mut Normal) -> Parameters {
    let mut parameters = Parameters::default();
    let p = &mut parameters.initial;
    p.heading = course.heading();
    p.speed = p.speed_std * normal.draw();
    p.slope = p.slope_std * normal.draw();
    parameters
}

/// Posterior estimates at every sample.
pub fn estimate(parameters: &Parameters, rows: &[Row]) -> Vec<Outputs> {
    let mut estimator = Wheelchair::new(parameters).unwrap();
    rows.iter()
        .map(|row| {
            estimator.step(&row.inputs, 0.01);
            let mut outputs = Outputs::default();
            estimator.outputs(&row.inputs, 0.0, &mut outputs);
            outputs
        })
        .collect()
}

/// Root mean square and largest magnitude.
pub fn rms_max(errors: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut sum, mut largest, mut count) = (0.0, 0.0_f64, 0);
    for error in errors {
        sum += error * error;
        largest = largest.max(error.abs());
        count += 1;
    }
    ((sum / count as f64).sqrt(), largest)
}

/// Seconds after the ramp's begin from which the slope is right to `share` of 0.08 rad for 0.5 s, counted
/// once the true slope is above half; `None` if that does not happen while the slope lasts.
pub fn found_after(rows: &[Row], outputs: &[Outputs], share: f64) -> Option<f64> {
    let good: Vec<bool> =
        rows.iter().zip(outputs).map(|(row, o)| (o.slope.value - row.truth.slope).abs() < share * 0.08).collect();
    let first = (0..rows.len()).find(|&k| {
        (2.0..=6.0).contains(&rows[k].time)
            && rows[k].truth.slope > 0.04
            && k + 50 < rows.len()
            && good[k..k + 50].iter().all(|g| *g)
    })?;
    Some(rows[first].time - 2.0)
}
