//! From logs and known parameters to signals on a uniform time base.

use super::rows::{self, Body, Signals};
use super::sway::roll_from_turning;
use crate::log::{Log, Series};
use crate::problem::{FitError, Known};

/// Samples that are looked at together, which a processor does several at a time.
const CHUNK: usize = 1024;

/// What is known of robot and person.
pub fn body(known: &Known) -> Body {
    let get = |name: &str| known.get(name);
    let (mu, h, rho) = (get("human.swaying_fraction"), get("human.com_height"), get("human.gyration_radius"));
    let human_mass = get("human.nominal_mass");
    Body {
        robot_mass: get("robot.mass"),
        rotating_mass: get("robot.rotating_mass")
            + 2.0 * get("robot.wheel_inertia") / get("robot.wheel_radius").powi(2),
        human_mass,
        lever: mu * h,
        b: mu * human_mass * h,
        j: mu * human_mass * (h * h + rho * rho),
        efficiency: get("robot.drive_efficiency"),
        smoothing_speed: get("rolling.smoothing_speed"),
        air_density: get("aero.air_density"),
        drag_area: get("aero.drag_area"),
    }
}

/// The signals of a log on even steps (see [`Log::on_even_steps`]). Samples that are infinite or
/// beyond what any machine does (200 m/s, 1e6 N.m, 1.5 rad, 100 m/s2 or rad/s) are missing.
pub fn signals(log: &Log, known: &Known) -> Result<Signals, FitError> {
    log.require("speed")?;
    log.require("torque_left")?;
    log.require("torque_right")?;
    let (log, period) = log.on_even_steps();
    let channel = |name: &str| -> Series {
        // A spike in a regressor is not bounded by a robust loss: what no machine does is missing.
        let largest = match name {
            "speed" => 200.0,
            "torque_left" | "torque_right" => 1e6,
            "tilt" | "roll" => 1.5,
            _ => 100.0,
        };
        let mut values = log.series(name).unwrap_or_default();
        // Most channels are as they should be, and need no copy.
        let some_beyond = |values: &[f64]| values.iter().filter(|value| value.abs() > largest).count() > 0;
        if values.chunks(CHUNK).any(some_beyond) {
            values.iter_mut().filter(|value| value.abs() > largest).for_each(|value| *value = f64::NAN);
        }
        values
    };
    // A column that never holds a number is as good as none.
    let present = |name: &str| Some(channel(name)).filter(|values| values.iter().any(|value| !value.is_nan()));
    let radius = known.get("robot.wheel_radius");
    let (left, right) = (channel("torque_left"), channel("torque_right"));
    let pitch = present("tilt").unwrap_or_default();
    let pitch_rate = if pitch.is_empty() {
        vec![0.0; log.len()].into()
    } else {
        present("tilt_rate").unwrap_or_else(|| rows::slope(&pitch, period).into())
    };
    let roll = present("roll").unwrap_or_default();
    let roll_rate = if roll.is_empty() {
        Series::default()
    } else {
        present("roll_rate").unwrap_or_else(|| rows::slope(&roll, period).into())
    };
    let mut signals = Signals {
        period,
        start: log.time.first().copied().unwrap_or(0.0),
        force: left.iter().zip(&right).map(|(l, r)| (l + r) / radius).collect(),
        speed: channel("speed"),
        yaw_rate: present("yaw_rate").unwrap_or_else(|| vec![0.0; log.len()].into()),
        pitch,
        pitch_rate,
        roll,
        roll_rate,
        turning: Default::default(),
        accel: present("accel_x").unwrap_or_default(),
    };
    let body = body(known);
    if body.j > 0.0 && signals.yaw_rate.iter().any(|w| *w != 0.0) {
        signals.turning = turning(&signals, &body, known);
    }
    Ok(signals)
}

/// The roll and its rate, measured or else those of a passive person with the known stiffness and damping.
fn turning(signals: &Signals, body: &Body, known: &Known) -> [Series; 2] {
    if signals.roll.is_empty() {
        let (roll, rate) = roll_from_turning(signals, body, super::side(known));
        [roll.into(), rate.into()]
    } else {
        [signals.roll.clone(), signals.roll_rate.clone()]
    }
}
