//! Rides of the plant over ground of any tilt, steered by a user, with a chair that may be shaken.

use super::runs::{NOMINAL, Normal, Row, inputs};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use wheelstate::estimator::wheelchair::{Outputs, Parameters};
use wheelstate::plant::wheelchair::{Actuation, Body, Plant, Ramp, Sensors};

/// A ride.
#[derive(Clone, Copy)]
pub struct Ride {
    pub body: Body,
    pub actuation: Actuation,
    pub sensors: Sensors,
    /// Tilt in the direction of heading pi/2, and to its left.
    pub ramp: Ramp,
    pub cross: Ramp,
    /// Heading at the start relative to the ramp, rad, and how fast the user turns from 8 s on, rad/s.
    pub heading: f64,
    pub turning: f64,
    pub speed: f64,
    /// Whether the moment by which the user steers is reported.
    pub moment_reported: bool,
    /// Standard deviation of the vibration while the chair moves, m/s^2, from when to when, s, and how much of it is
    /// left after a sample.
    pub shaken: f64,
    pub shaken_from: f64,
    pub shaken_to: f64,
    pub colour: f64,
    pub duration: f64,
}

impl Default for Ride {
    fn default() -> Self {
        Self {
            body: Body::default(),
            actuation: Actuation::default(),
            sensors: Sensors::default(),
            ramp: Ramp::constant(0.0),
            cross: Ramp::constant(0.0),
            heading: FRAC_PI_2,
            turning: 0.0,
            speed: 1.0,
            moment_reported: true,
            shaken: 0.0,
            shaken_from: 0.0,
            shaken_to: 1e9,
            colour: 0.0,
            duration: 30.0,
        }
    }
}

/// Ground that begins to tilt after so many seconds, within half a second.
pub fn tilted_from(degrees: f64, from: f64) -> Ramp {
    Ramp { base: 0.0, slope: degrees.to_radians(), from, to: 1e9, edge: 0.5 }
}

/// Samples every 10 ms. The user stands for a second, then drives off.
pub fn ride(ride: &Ride, normal: &mut Normal) -> Vec<Row> {
    let mut plant = Plant::new(ride.body, ride.ramp, ride.actuation, ride.sensors, ride.heading).across(ride.cross);
    let (mut turned, mut vibration) = (0.0, [0.0; 3]);
    let mut braked = true;
    (0..(ride.duration / 0.01) as usize)
        .map(|k| {
            let time = 0.01 * k as f64;
            let truth = plant.truth();
            let wanted = ride.speed * ((time - 1.0) / 1.5).clamp(0.0, 1.0);
            let turning = if time > 8.0 { ride.turning } else { 0.0 };
            let (off, weight) = (ride.turning * (time - 8.0).max(0.0) - turned, ride.body.mass * ride.body.gravity);
            braked &= wanted == 0.0;
            plant.braked = braked;
            let force = 150.0 * (wanted - truth.speed) + weight * truth.pitch.sin() + ride.body.drag * wanted;
            let side = truth.heading.cos() * truth.slope.sin();
            let held = weight * ride.body.com_ahead * side;
            let moment = 60.0 * off + 25.0 * (turning - truth.yaw_rate) + held + 12.0 * turning * truth.speed;
            let command = if braked { [0.0; 2] } else { [force, moment] };
            let mut noise = NOMINAL.draw(normal);
            let shaken = truth.speed.abs() > 0.05 && time >= ride.shaken_from && time < ride.shaken_to;
            let level = if shaken { ride.shaken } else { 0.0 };
            for (axis, vibration) in vibration.iter_mut().enumerate() {
                let fresh = (1.0 - ride.colour * ride.colour).sqrt() * normal.draw();
                *vibration = ride.colour * *vibration + fresh;
                noise.accel[axis] += level * *vibration;
            }
            let reading = plant.measure(command, &noise);
            let reported = [command[0], if ride.moment_reported { command[1] } else { 0.0 }];
            let row = Row { time, truth, inputs: inputs(&reading, reported) };
            plant.advance(command, 0.01);
            turned += 0.01 * plant.truth().yaw_rate;
            row
        })
        .collect()
}

pub fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Of one estimate over a ride: root mean square error, share within two standard deviations, share healthy and
/// beyond three.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    pub rms: f64,
    pub within: f64,
    pub wrong_and_sure: f64,
}

fn score(samples: impl Iterator<Item = (f64, f64, bool)>) -> Score {
    let (mut n, mut square, mut within, mut wrong) = (0.0, 0.0, 0.0, 0.0);
    for (error, std, healthy) in samples {
        n += 1.0;
        square += error * error;
        within += f64::from(error.abs() <= 2.0 * std);
        wrong += f64::from(healthy && error.abs() > 3.0 * std);
    }
    if n == 0.0 {
        return Score { rms: f64::NAN, within: f64::NAN, wrong_and_sure: 0.0 };
    }
    Score { rms: (square / n).sqrt(), within: within / n, wrong_and_sure: wrong / n }
}

/// Pitch, slope, heading (where there is a slope) and speed from `from` seconds on, and the share of healthy samples.
#[derive(Clone, Copy, Debug)]
pub struct Scores {
    pub pitch: Score,
    pub slope: Score,
    pub heading: Score,
    pub speed: Score,
    pub healthy: f64,
}

pub fn scores(rows: &[Row], outputs: &[Outputs], from: f64, to: f64) -> Scores {
    let seen = || rows.iter().zip(outputs).filter(|(row, _)| row.time >= from && row.time < to);
    let of = |error: &dyn Fn(&Row, &Outputs) -> (f64, f64)| {
        score(seen().map(|(row, o)| {
            let (error, std) = error(row, o);
            (error, std, o.diagnostics.healthy)
        }))
    };
    let sloped = |row: &Row| row.truth.slope.abs() > 0.01;
    Scores {
        pitch: of(&|r, o| (o.pitch.value - r.truth.pitch, o.pitch.std)),
        slope: of(&|r, o| (o.slope.value.abs() - r.truth.slope.abs(), o.slope.std)),
        // (heading, slope) and (heading + pi, -slope) are the same pose.
        heading: score(seen().filter(|(row, _)| sloped(row)).map(|(r, o)| {
            let turned = if o.slope.value < 0.0 { PI } else { 0.0 };
            (wrapped(o.heading.value + turned - r.truth.heading), o.heading.std, o.diagnostics.healthy)
        })),
        speed: of(&|r, o| (o.speed.value - r.truth.speed, o.speed.std)),
        healthy: seen().filter(|(_, o)| o.diagnostics.healthy).count() as f64 / seen().count() as f64,
    }
}

/// Defaults, but for the heading relative to the ramp.
pub fn with_heading(heading: f64) -> Parameters {
    let mut parameters = Parameters::default();
    parameters.initial.heading = heading;
    parameters
}
