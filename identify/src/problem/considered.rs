//! What a log cannot show and still may be wrong: gains, biases and delays of the sensors, and known values.
//!
//! Each cause has a standard deviation, by default that of a good industrial sensor or of a careful measurement. Its
//! effect on the estimates is the difference between two fits, as the log is and with the cause one step off, scaled
//! to one standard deviation. The effects widen the intervals (a consider covariance): independent causes add their
//! squares, and one cause moves all estimates together.

use super::findings::Offset;
use super::{Declared, FitRequest, Known};
use crate::log::{Channel, Log, Series};
use std::collections::BTreeMap;
use wheelstate::Variable;

/// One cause of error.
#[derive(Clone, Debug)]
pub struct Cause {
    /// In words, with the standard deviation: `gain of drive_force (+-1.5 %)`.
    pub name: String,
    /// How many standard deviations the step of [`Cause::apply`] is.
    pub steps: f64,
    change: Change,
}

#[derive(Clone, Debug)]
enum Change {
    /// Channels times `1 + step`.
    Gain(Vec<String>, f64),
    /// Channels plus `step`.
    Bias(Vec<String>, f64),
    /// Channels later by so many samples.
    Delay(Vec<String>, usize),
    /// A known value plus `step`.
    Known(String, f64),
}

/// Standard deviations of a sensor: of its gain, relative; of its bias, in the channel's unit; of its delay, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Gain.
    pub gain: f64,
    /// Bias.
    pub bias: f64,
    /// Delay.
    pub delay: f64,
}

/// What a good industrial sensor keeps, by the unit of its channel and, for angles, by what they are angles of.
/// Encoders and wheel speeds count teeth: their scale is the radius of the wheel, a known value, and what is left is the
/// clock of each of them.
pub fn quality(channel: &str, unit: &str) -> Option<Quality> {
    let some = |gain: f64, bias: f64, delay: f64| Some(Quality { gain, bias, delay });
    match unit {
        _ if counts(channel) => some(0.0, 0.0, 0.0075),
        "N" | "N.m" => some(0.015, 0.0, 0.0075),
        "m/s" => some(0.005, 0.0, 0.0075),
        "m/s2" => some(0.003, 0.025, 0.0075),
        "rad/s" => some(0.003, 0.002, 0.0075),
        "rad" if channel == "steering_angle" => some(0.005, 0.005, 0.0075),
        "rad" => some(0.003, 0.0075, 0.0075),
        _ => None,
    }
}

/// Whether a channel counts the teeth of a wheel. Wheels are compared with each other, so that each of them is late alone:
/// all of them together are the others early.
fn counts(channel: &str) -> bool {
    channel.starts_with("encoder") || channel.starts_with("wheel_speed")
}

/// Standard deviation of a known value, relative: masses 3 %, inertias 5 %, lengths 2 %.
pub fn known_std(variable: &Variable, value: f64) -> Option<f64> {
    const PARTS: [&str; 8] = ["robot.", "human.", "loader.", "vehicle.", "wheel.", "chair.", "body.", "imu."];
    let name = variable.name.as_str();
    if !PARTS.iter().any(|part| name.starts_with(part)) || name.ends_with("_std") || value == 0.0 {
        return None;
    }
    let relative = match variable.unit {
        "kg" => 0.03,
        "kg.m2" => 0.05,
        "m" => 0.02,
        _ if name.ends_with("_fraction") => 0.03,
        _ => return None,
    };
    Some(relative * value.abs())
}

/// Channels of one device: `torque_left` and `torque_right`, `tilt` and `tilt_rate` are wrong together.
pub fn device(channel: &str) -> &str {
    match channel {
        "accel_x" | "accel_y" | "accel_z" | "gyro_x" | "gyro_y" | "gyro_z" => "imu",
        name if name.starts_with("wheel_speed") => "wheel_speed",
        name if name.starts_with("spading_force") => "spading_force",
        name if name.starts_with("drive_") && !name.contains("torque") => name,
        name if name.starts_with("base_") => "base",
        name => name.split('_').next().unwrap_or(name),
    }
}

/// The standard deviations that the user gave with `--sensor`, or what is wrong with them.
fn given(request: &FitRequest, present: &[(&str, &str)]) -> Result<BTreeMap<(String, String), f64>, String> {
    let mut all = BTreeMap::new();
    for (key, value) in &request.sensors {
        let Some((channel, what)) =
            key.rsplit_once('.').filter(|(_, what)| matches!(*what, "gain_std" | "bias_std" | "delay_std"))
        else {
            return Err(format!("--sensor {key}: CHANNEL.gain_std, CHANNEL.bias_std or CHANNEL.delay_std is expected"));
        };
        if !present.iter().any(|(name, _)| *name == channel || device(name) == channel) {
            let names: Vec<&str> = present.iter().map(|(name, _)| *name).collect();
            return Err(format!("--sensor {key}: the logs have no such channel; there are {}", names.join(", ")));
        }
        if !(value.is_finite() && *value >= 0.0) {
            return Err(format!("--sensor {key}: {value} is no standard deviation"));
        }
        all.insert((channel.to_owned(), what.to_owned()), *value);
    }
    Ok(all)
}

/// All causes that may move estimates from these logs, which show some `offsets` of channels: a bias is as likely as not
/// as large as its channel's.
pub fn causes(
    logs: &[Log],
    declared: &Declared,
    known: &Known,
    request: &FitRequest,
    wanted: &[String],
    offsets: &[Offset],
) -> Result<Vec<Cause>, String> {
    let holds = |name: &str| {
        let of = |log: &Log| log.channels.iter().any(|c| c.name == name && c.values.any(f64::is_finite));
        logs.iter().any(of)
    };
    let present: Vec<(&str, &str)> = declared
        .inputs
        .iter()
        .filter(|input| holds(&input.name))
        .map(|input| (input.name.as_str(), input.unit))
        .collect();
    let given = given(request, &present)?;
    let std_of = |channel: &str, what: &str, usual: f64| {
        let of = |name: &str| given.get(&(name.to_owned(), what.to_owned())).copied();
        of(channel).or_else(|| of(device(channel))).unwrap_or(usual)
    };
    // Exact sensors are taken at their word until a log contradicts it.
    let apparent =
        |channel: &str| Offset::size(offsets.iter().filter(|o| o.channel == channel && (o.shows() || !request.exact)));
    let mut devices: Vec<(&str, Vec<(&str, Quality)>)> = Vec::new();
    for (name, unit) in &present {
        let exact = Quality { gain: 0.0, bias: 0.0, delay: 0.0 };
        let usual = if request.exact { exact } else { quality(name, unit).unwrap_or(exact) };
        let quality = Quality {
            gain: std_of(name, "gain_std", usual.gain),
            bias: std_of(name, "bias_std", usual.bias).hypot(apparent(name)),
            delay: std_of(name, "delay_std", usual.delay),
        };
        match devices.iter_mut().find(|(device_name, _)| *device_name == device(name)) {
            Some((_, channels)) => channels.push((*name, quality)),
            None => devices.push((device(name), vec![(*name, quality)])),
        }
    }
    let period = logs.iter().map(Log::period).fold(f64::NAN, f64::min);
    let mut all = Vec::new();
    for (device, channels) in &devices {
        let label = if let [(only, _)] = channels.as_slice() { only } else { device };
        let names = |of: &dyn Fn(&Quality) -> f64| -> Vec<String> {
            channels.iter().filter(|(_, quality)| of(quality) > 0.0).map(|(name, _)| (*name).to_owned()).collect()
        };
        let largest =
            |of: &dyn Fn(&Quality) -> f64| channels.iter().map(|(_, quality)| of(quality)).fold(0.0, f64::max);
        let gain = largest(&|quality| quality.gain);
        if gain > 0.0 {
            let change = Change::Gain(names(&|quality| quality.gain), gain);
            all.push(Cause { name: format!("gain of {label} (+-{:.3} %)", 100.0 * gain), steps: 1.0, change });
        }
        let mut late = |label: &str, names: Vec<String>, delay: f64| {
            if delay > 0.0 && period > 0.0 {
                // A whole sample: interpolation in between would smooth the noise.
                let samples = (delay / period).round().max(1.0);
                let name = format!("delay of {label} (+-{} ms)", 1e3 * delay);
                all.push(Cause {
                    name,
                    steps: samples * period / delay,
                    change: Change::Delay(names, samples as usize),
                });
            }
        };
        if channels.iter().all(|(name, _)| counts(name)) {
            channels.iter().for_each(|(name, quality)| late(name, vec![(*name).to_owned()], quality.delay));
        } else {
            late(label, names(&|quality| quality.delay), largest(&|quality| quality.delay));
        }
        // Each channel has a bias of its own; those of many joints act on one joint each and are tried together.
        let bias = largest(&|quality| quality.bias);
        if channels.len() > MANY && bias > 0.0 {
            let change = Change::Bias(names(&|quality| quality.bias), bias);
            all.push(Cause { name: format!("bias of {label} (+-{})", (1e4 * bias).round() / 1e4), steps: 1.0, change });
            continue;
        }
        for (channel, quality) in channels.iter().filter(|(_, quality)| quality.bias > 0.0) {
            let change = Change::Bias(vec![(*channel).to_owned()], quality.bias);
            all.push(Cause {
                name: format!("bias of {channel} (+-{})", (1e4 * quality.bias).round() / 1e4),
                steps: 1.0,
                change,
            });
        }
    }
    for variable in declared.parameters.iter().filter(|variable| !wanted.contains(&variable.name)) {
        let value = known.get(&variable.name);
        let told = request.known.iter().find(|(name, ..)| *name == variable.name).map(|(_, _, std)| *std);
        let usual = if request.exact { None } else { known_std(variable, value) };
        let Some(std) = told.or(usual).filter(|std| *std > 0.0) else { continue };
        let unit = if variable.unit == "1" { String::new() } else { format!(" {}", variable.unit) };
        let name = format!("known value {} ({value} +-{std:.3}{unit})", variable.name);
        all.push(Cause { name, steps: 1.0, change: Change::Known(variable.name.clone(), std) });
    }
    Ok(all)
}

/// Standard deviations of a sensor, as the user gave them or else as usual.
pub fn quality_of(sensors: &[(String, f64)], exact: bool, channel: &str, unit: &str) -> Quality {
    let told =
        |name: &str, what: &str| sensors.iter().find(|(key, _)| *key == format!("{name}.{what}")).map(|(_, std)| *std);
    let told = |what: &str| told(channel, what).or_else(|| told(device(channel), what));
    let usual = quality(channel, unit).filter(|_| !exact).unwrap_or(Quality { gain: 0.0, bias: 0.0, delay: 0.0 });
    Quality {
        gain: told("gain_std").unwrap_or(usual.gain),
        bias: told("bias_std").unwrap_or(usual.bias),
        delay: told("delay_std").unwrap_or(usual.delay),
    }
}

impl Cause {
    /// Whether it is the delay of a channel.
    pub fn delays(&self, channel: &str) -> bool {
        matches!(&self.change, Change::Delay(names, _) if names.iter().any(|name| name == channel))
    }

    /// Logs and known values with this cause one step off; `None` where they are as before.
    pub fn apply(&self, logs: &[Log], known: &Known) -> (Option<Vec<Log>>, Option<Known>) {
        let changed = |of: &dyn Fn(&Channel) -> Option<Series>| -> Vec<Log> {
            // What is not changed is not read here, and what is changed goes again.
            let change = |log: &Log| {
                let channels = log.channels.iter().map(|channel| Channel {
                    name: channel.name.clone(),
                    values: of(channel).unwrap_or_else(|| channel.values.clone()),
                });
                Log {
                    channels: channels.collect(),
                    time: log.time.clone(),
                    source: log.source.clone(),
                    ..Log::default()
                }
            };
            logs.iter().map(change).collect()
        };
        match &self.change {
            Change::Gain(names, step) => {
                let of = |channel: &Channel| {
                    names
                        .contains(&channel.name)
                        .then(|| channel.values.clone().iter().map(|v| v * (1.0 + step)).collect())
                };
                (Some(changed(&of)), None)
            }
            Change::Bias(names, step) => {
                let of = |channel: &Channel| {
                    names.contains(&channel.name).then(|| channel.values.clone().iter().map(|v| v + step).collect())
                };
                (Some(changed(&of)), None)
            }
            Change::Delay(names, samples) => {
                let late = |values: &[f64]| (0..values.len()).map(|k| values[k.saturating_sub(*samples)]).collect();
                let of = |channel: &Channel| names.contains(&channel.name).then(|| late(&channel.values.clone()));
                (Some(changed(&of)), None)
            }
            Change::Known(name, step) => {
                let mut known = known.clone();
                known.assume(name, known.get(name) + step);
                (None, Some(known))
            }
        }
    }
}

/// More channels of one device than this are those of a body's joints.
const MANY: usize = 6;

/// Samples of a log that the effects are computed on, at most: they depend on how a machine is driven, not on how
/// long, so that pieces from all over a long log tell them.
const ENOUGH: usize = 16_000;
/// Pieces of a longer log.
const PIECES: usize = 4;

/// The logs, or pieces of the long ones, without the references that no fit looks at.
pub fn pieces(logs: &[Log]) -> Vec<Log> {
    let each = (ENOUGH / logs.len().max(1)).max(2000);
    let mut all = Vec::new();
    for log in logs {
        let keep = |name: &str| !name.starts_with("true_");
        if log.len() <= each {
            all.push(log.slice(0..log.len(), keep));
            continue;
        }
        let length = each / PIECES;
        for piece in 0..PIECES {
            let start = piece * (log.len() - length) / (PIECES - 1);
            all.push(log.slice(start..start + length, keep));
        }
    }
    // Every cause looks at them: they are read once.
    for piece in &all {
        let series = piece.channels.iter().map(|channel| &channel.values).chain([&piece.time]);
        series.for_each(|series| _ = series.as_slice());
    }
    all
}
