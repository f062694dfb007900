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

/// Which channels a log holds samples of that a machine can have; each block of a long one has the same.
#[derive(Clone, Copy, Debug)]
pub struct Has {
    /// `tilt`
    pub tilt: bool,
    /// `roll`
    pub roll: bool,
    /// `accel_x`
    pub accel: bool,
    tilt_rate: bool,
    roll_rate: bool,
    yaw_rate: bool,
}

impl Has {
    /// The channels that signals were made of.
    pub fn of_signals(signals: &Signals) -> Self {
        let [tilt, roll, accel] = [&signals.pitch, &signals.roll, &signals.accel].map(|values| !values.is_empty());
        Self { tilt, roll, accel, tilt_rate: tilt, roll_rate: roll, yaw_rate: true }
    }

    /// The channels of a log.
    pub fn of(log: &Log) -> Self {
        // A column that never holds a number is as good as none.
        let has = |name: &str| {
            let possible = |value: f64| value.abs() <= largest(name);
            log.channels.iter().any(|channel| channel.name == name && channel.values.any(possible))
        };
        Self {
            tilt: has("tilt"),
            roll: has("roll"),
            accel: has("accel_x"),
            tilt_rate: has("tilt_rate"),
            roll_rate: has("roll_rate"),
            yaw_rate: has("yaw_rate"),
        }
    }
}

/// The largest value of a channel. A spike in a regressor is not bounded by a robust loss: what no machine does is missing.
fn largest(name: &str) -> f64 {
    match name {
        "speed" => 200.0,
        "torque_left" | "torque_right" => 1e6,
        "tilt" | "roll" => 1.5,
        _ => 100.0,
    }
}

/// The signals of a log on even steps (see [`Log::on_even_steps`]). Samples that are infinite or
/// beyond what any machine does (200 m/s, 1e6 N.m, 1.5 rad, 100 m/s2 or rad/s) are missing.
pub fn signals(log: &Log, known: &Known) -> Result<Signals, FitError> {
    signals_of(log, known, Scope { look: Look::All, turning: true, has: None })
}

/// What is looked at: other channels are not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Everything.
    All,
    /// What the rows of pitch and roll are made of.
    Joints,
    /// What the longitudinal rows are made of.
    Drive,
}

/// Which signals are made.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    /// What for.
    pub look: Look,
    /// Whether with what roll adds while turning.
    pub turning: bool,
    /// The channels that the log of a block has; of a whole log they are looked for.
    pub has: Option<&'a Has>,
}

/// Some signals of a log, or of a block of it.
pub fn signals_of(log: &Log, known: &Known, scope: Scope) -> Result<Signals, FitError> {
    for name in ["speed", "torque_left", "torque_right"] {
        // What is there is read only if it is looked at.
        if !log.channels.iter().any(|channel| channel.name == name) {
            log.require(name)?;
        }
    }
    let (log, period) = log.on_even_steps();
    let Scope { look, turning: turns, has } = scope;
    let has = has.copied().unwrap_or_else(|| Has::of(&log));
    let (drive, joints) = (look != Look::Joints, look != Look::Drive);
    let channel = |name: &str| -> Series {
        let largest = largest(name);
        let mut values = log.series(name).unwrap_or_default();
        // Most channels are as they should be, and need no copy.
        let some_beyond = |values: &[f64]| values.iter().filter(|value| value.abs() > largest).count() > 0;
        if values.chunks(CHUNK).any(some_beyond) {
            values.iter_mut().filter(|value| value.abs() > largest).for_each(|value| *value = f64::NAN);
        }
        values
    };
    let zeros = || -> Series { vec![0.0; log.len()].into() };
    let radius = known.get("robot.wheel_radius");
    let torques = if drive { ["torque_left", "torque_right"].map(channel) } else { Default::default() };
    let pitch = if has.tilt { channel("tilt") } else { Series::default() };
    let pitch_rate = match (has.tilt, has.tilt_rate) {
        _ if !joints => Series::default(),
        (false, _) => zeros(),
        (true, true) => channel("tilt_rate"),
        (true, false) => rows::slope(&pitch, period).into(),
    };
    let rolls = has.roll && (joints || turns);
    let roll = if rolls { channel("roll") } else { Series::default() };
    let roll_rate = match (rolls, has.roll_rate) {
        (false, _) => Series::default(),
        (true, true) => channel("roll_rate"),
        (true, false) => rows::slope(&roll, period).into(),
    };
    let mut signals = Signals {
        period,
        start: log.time.first().copied().unwrap_or(0.0),
        force: torques[0].iter().zip(&torques[1]).map(|(l, r)| (l + r) / radius).collect(),
        speed: channel("speed"),
        yaw_rate: if has.yaw_rate { channel("yaw_rate") } else { zeros() },
        pitch,
        pitch_rate,
        roll,
        roll_rate,
        turning: Default::default(),
        accel: if has.accel && drive { channel("accel_x") } else { Series::default() },
    };
    let body = body(known);
    if turns && body.j > 0.0 && signals.yaw_rate.iter().any(|w| *w != 0.0) {
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
