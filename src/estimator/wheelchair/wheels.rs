//! From wheel angles to the encoder rows: zero, missing wheels, counters that restart.

use super::ekf::Sample;
use super::parameters::Zero;
use crate::estimator::sampled::LONG_AGO;
use crate::filter::bounded;
use crate::model::wheelchair::{Chair, Output, wheel_travel};
use serde::{Deserialize, Serialize};

/// A first reading this near to zero is the encoders' own zero in the mode `auto`, rad.
const NEAR_ZERO: f64 = 0.05;
/// How fast the prediction of a wheel angle may go wrong without samples, rad/s.
const DRIFT: f64 = 5.0;
/// So many implausible readings in a row are a counter that has restarted.
const PATIENCE: u32 = 10;
/// A reading that repeats exactly is an old one if the wheel should have turned by this share of the last change since, and by
/// so much, rad, at no less than so many rad/s: encoders of few steps repeat theirs between two steps.
const OVERDUE: f64 = 0.7;
const LEAST_TURN: f64 = 0.01;
const TURNING: f64 = 0.15;
/// A wheel whose reading repeats for longer than this stands, whatever is expected of it, s.
pub(super) const LONGEST_REPEAT: f64 = 0.5;

/// One wheel's counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Wheel {
    /// Reading at the zero of distance and heading, rad.
    zero: f64,
    /// Last angle since that zero, rad.
    angle: f64,
    /// Time since that angle, s.
    age: f64,
    /// Last reading, how far it had changed, rad, and for how long it repeats, s.
    reading: f64,
    step: f64,
    repeats_for: f64,
    /// How far the wheel should have turned meanwhile, rad.
    overdue: f64,
    implausible: u32,
    started: bool,
}

/// Both wheels' counters, right and left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wheels([Wheel; 2]);

/// What became of the readings of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// Wheel angles right and left since the zero, rad; NaN = missing.
    pub angles: [f64; 2],
    /// A reading was implausible and left out.
    pub implausible: bool,
    /// A counter had restarted; its zero was moved.
    pub restarted: bool,
    /// A zero was put where the filter expected it, so long after the last reading, s.
    pub guessed: Option<f64>,
    /// A reading was an old one and left out.
    pub old: bool,
    /// A wheel stands from now on that was expected to turn until now: it was stopped at once, or its encoder says nothing any more.
    pub stopped: bool,
}

impl Wheel {
    /// The angle since the zero; `speed` is the wheel's estimated speed, rad/s.
    fn read(&mut self, reading: f64, speed: f64, dt: f64, step_limit: f64, mode: Zero, readings: &mut Readings) -> f64 {
        self.age += dt;
        if !reading.is_finite() {
            return f64::NAN;
        }
        if self.is_old(reading, speed, dt, readings) {
            return f64::NAN;
        }
        let expected = self.angle + speed * self.age;
        if !self.started {
            let moved = match mode {
                Zero::Absolute => false,
                Zero::FirstSample => true,
                Zero::Auto => (reading - expected).abs() > NEAR_ZERO,
            };
            self.zero = if moved { reading - expected } else { 0.0 };
            readings.guessed = moved.then_some(self.age).or(readings.guessed);
        } else if (reading - self.zero - expected).abs() > step_limit + DRIFT * self.age {
            readings.implausible = true;
            self.implausible += 1;
            if self.implausible <= PATIENCE {
                return f64::NAN;
            }
            self.zero = reading - expected;
            (readings.restarted, readings.guessed) = (true, Some(self.age));
        }
        *self = Self { angle: reading - self.zero, age: 0.0, implausible: 0, started: true, ..*self };
        self.angle
    }

    /// Whether a reading is the last one again of a wheel that turns: an encoder that is read more slowly than the other sensors, or
    /// frozen.
    fn is_old(&mut self, reading: f64, speed: f64, dt: f64, readings: &mut Readings) -> bool {
        if !self.started || reading != self.reading {
            let step = if self.started { (reading - self.reading).abs() } else { 0.0 };
            *self = Self { reading, step, repeats_for: 0.0, overdue: 0.0, ..*self };
            return false;
        }
        let before = self.repeats_for;
        self.repeats_for = (before + dt).min(LONG_AGO);
        self.overdue = if speed.abs() > TURNING { self.overdue + speed * dt } else { 0.0 };
        let old = self.overdue.abs() > LEAST_TURN.max(OVERDUE * self.step);
        readings.stopped |= old && before <= LONGEST_REPEAT && self.repeats_for > LONGEST_REPEAT;
        let left_out = old && self.repeats_for <= LONGEST_REPEAT;
        readings.old |= left_out;
        left_out
    }
}

impl Wheels {
    /// Distance, m, and heading, rad, where both wheels have been read.
    pub fn pose(&self, chair: &Chair) -> Option<[f64; 2]> {
        let [right, left] = self.0;
        let (travel, heading) = wheel_travel(chair, right.angle, left.angle);
        let pose = [travel + chair.reference_offset() * (heading - chair.heading_reference), heading];
        (right.started && left.started && pose.iter().all(|value| bounded(*value))).then_some(pose)
    }

    /// How far the wheels right and left have rolled since their zeros, m; NaN for one that was not read at the last sample.
    pub fn rolled(&self, chair: &Chair) -> [f64; 2] {
        self.0.map(
            |wheel| if wheel.started && wheel.age == 0.0 { chair.body.wheel_radius * wheel.angle } else { f64::NAN },
        )
    }

    /// Takes the readings right and left, NaN = missing; `speed` and `yaw_rate` are the estimates.
    pub fn read(
        &mut self,
        chair: &Chair,
        readings: [f64; 2],
        (speed, yaw_rate): (f64, f64),
        dt: f64,
        step_limit: f64,
        mode: Zero,
    ) -> Readings {
        let mut result = Readings::default();
        let half_track = 0.5 * chair.body.track();
        for (k, side) in [half_track, -half_track].into_iter().enumerate() {
            let turning = (speed + side * yaw_rate) / chair.body.wheel_radius;
            let angle = self.0[k].read(readings[k], turning, dt, step_limit, mode, &mut result);
            result.angles[k] = angle;
        }
        result
    }
}

/// Encoders that sit on the frame read the wheels relative to it: where the frame pitches, as over the edge of a ramp, they read
/// `r theta'` more than the axle travels. The source's encoders do not, and nobody says which kind a chair has: the standard
/// deviation of the speed contains it for as long as the filter remembers, that of the distance what the frame has turned so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTurn {
    /// Largest pitch rate of late, rad/s.
    rate: f64,
    /// How far the frame has turned since the start, rad.
    turned: f64,
}

/// How long what the encoders once read is in the speed, s: with the defaults' noise the filter follows a changed speed in
/// a twentieth of a second, swings, and has settled after four.
const REMEMBERED: f64 = 0.2;
/// The gyro's noise is no pitch rate: so many of its standard deviations.
const NOISE: f64 = 2.0;

impl FrameTurn {
    /// Takes a pitch rate, NaN = missing, with the standard deviation `noise`, `dt` seconds after the one before.
    pub fn watch(&mut self, rate: f64, noise: f64, dt: f64) {
        let beyond = (rate * rate - (NOISE * noise).powi(2)).max(0.0).sqrt();
        // NaN vanishes in max
        self.rate = (self.rate * (-dt / REMEMBERED).exp()).max(beyond);
        if beyond > 0.0 {
            self.turned += rate * dt;
        }
    }

    /// Standard deviation of the speed from it, m/s.
    pub fn speed_std(&self, chair: &Chair) -> f64 {
        chair.body.wheel_radius * self.rate
    }

    /// Standard deviation of the distance from it, m.
    pub fn distance_std(&self, chair: &Chair) -> f64 {
        chair.body.wheel_radius * self.turned.abs()
    }
}

/// The measurement rows of these wheel angles and of gyro and accelerometer.
pub fn sample(chair: &Chair, [right, left]: [f64; 2], gyro: f64, accel: [f64; 3]) -> Sample {
    let inertial = |s, alpha| Output::new(s, alpha, gyro, accel[0], accel[1], accel[2]);
    let radius = chair.body.wheel_radius;
    match (right.is_finite(), left.is_finite()) {
        (true, true) => {
            let (travel, heading) = wheel_travel(chair, right, left);
            inertial(travel, heading).into()
        }
        (true, false) => {
            Sample { values: inertial(radius * right, f64::NAN), single_wheel: Some(chair.body.reference_to_right) }
        }
        (false, true) => {
            Sample { values: inertial(radius * left, f64::NAN), single_wheel: Some(-chair.body.reference_to_left) }
        }
        (false, false) => inertial(f64::NAN, f64::NAN).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What becomes of the readings of a wheel that is expected to turn at `speed`, every 10 ms: of each whether it was left out, and
    /// how often the wheel was taken to have stopped.
    fn read(readings: impl Iterator<Item = f64>, speed: f64) -> (Vec<bool>, usize) {
        let (mut wheel, mut stops) = (Wheel::default(), 0);
        let left_out = readings.map(|reading| {
            let mut result = Readings::default();
            let angle = wheel.read(reading, speed, 0.01, 0.5, Zero::Absolute, &mut result);
            stops += usize::from(result.stopped);
            angle.is_nan()
        });
        (left_out.collect(), stops)
    }

    #[test]
    fn a_reading_that_repeats_while_the_wheel_turns_is_left_out_for_half_a_second() {
        // turns at 1.6 rad/s for a second, then the same angle again
        let (left_out, stops) = read((0..200).map(|k| 0.016 * f64::from(k.min(100))), 1.6);
        assert!(left_out[..101].iter().all(|out| !out) && left_out[101..150].iter().all(|out| *out));
        assert!(left_out[152..].iter().all(|out| !out) && stops == 1);
    }

    #[test]
    fn what_stands_or_counts_few_steps_repeats_its_readings() {
        assert_eq!(read((0..200).map(|_| 1.0), 0.0), (vec![false; 200], 0));
        // a hundred steps a turn at 1 rad/s: six samples a step
        let (left_out, stops) = read((0..600).map(|k| 0.063 * (0.01 * f64::from(k) / 0.063).floor()), 1.0);
        assert!(left_out.iter().filter(|out| **out).count() < 300 && stops == 0);
    }
}
