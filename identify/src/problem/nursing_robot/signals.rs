//! From logs and known parameters to signals on a uniform time base.

use super::rows::{self, Body, Signals};
use crate::log::Log;
use crate::problem::{FitError, Known};

/// Steps may differ by this share of the period before a log is resampled.
const UNIFORM: f64 = 0.01;

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
        drag: 0.5 * get("aero.air_density") * get("aero.drag_area"),
    }
}

/// The signals of a log.
///
/// A log whose steps vary by more than 1 % is interpolated linearly onto its median period; across gaps
/// of more than one and a half periods everything counts as missing. Infinite samples are missing.
pub fn signals(log: &Log, known: &Known) -> Result<Signals, FitError> {
    log.require("speed")?;
    log.require("torque_left")?;
    log.require("torque_right")?;
    let period = log.period();
    let even = log.time.windows(2).all(|pair| ((pair[1] - pair[0]) - period).abs() <= UNIFORM * period);
    let resampled;
    let log = if even || log.len() < 3 {
        log
    } else {
        resampled = log.resample(period, 1.5 * period);
        &resampled
    };
    // Times written with few digits: the mean step is closer to the truth than the median one.
    let period = if log.len() > 1 { log.duration() / (log.len() - 1) as f64 } else { period };
    let channel = |name: &str| -> Vec<f64> {
        let finite = |value: &f64| if value.is_finite() { *value } else { f64::NAN };
        log.channel(name).map(|values| values.iter().map(finite).collect()).unwrap_or_default()
    };
    // A column that never holds a number is as good as none.
    let present = |name: &str| Some(channel(name)).filter(|values| values.iter().any(|value| !value.is_nan()));
    let radius = known.get("robot.wheel_radius");
    let (left, right) = (channel("torque_left"), channel("torque_right"));
    let pitch = present("tilt").unwrap_or_default();
    let pitch_rate = if pitch.is_empty() {
        vec![0.0; log.len()]
    } else {
        present("tilt_rate").unwrap_or_else(|| rows::slope(&pitch, period))
    };
    Ok(Signals {
        period,
        start: log.time.first().copied().unwrap_or(0.0),
        force: left.iter().zip(&right).map(|(l, r)| (l + r) / radius).collect(),
        speed: channel("speed"),
        yaw_rate: present("yaw_rate").unwrap_or_else(|| vec![0.0; log.len()]),
        pitch,
        pitch_rate,
        roll: present("roll").unwrap_or_default(),
        accel: present("accel_x").unwrap_or_default(),
    })
}

/// Standard deviation of the white noise of a signal: from its third differences, in which any smooth
/// motion vanishes. NaN samples are left out; 0 if there are too few samples.
pub fn noise(x: &[f64]) -> f64 {
    let third = |w: &[f64]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs();
    let mut sizes: Vec<f64> = x.windows(4).map(third).filter(|value| value.is_finite()).collect();
    if sizes.len() < 10 {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    if *median > 0.0 {
        return 1.4826 * *median / 20f64.sqrt();
    }
    // Coarse quantisation: most differences vanish, the mean square still tells.
    (sizes.iter().map(|size| size * size).sum::<f64>() / sizes.len() as f64 / 20.0).sqrt()
}
