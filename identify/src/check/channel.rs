//! Each channel by itself: there at all, alive, within its range, fine enough, not clipped, not wrapped.

use super::relation::HARMLESS;
use super::signals::moves;
use super::{Accelerometer, Finding, Severity, Subject, finding, scan, short};
use crate::log::columns::fits;
use crate::log::{Channel, Log, Series};
use std::cell::OnceCell;
use std::collections::BTreeMap;
use wheelstate::Variable;

/// Share of the samples beyond the declared range from which it is the unit and not a spike.
const OUTSIDE: f64 = 0.01;
/// Shortest time that a sensor with noise may repeat its last digit, s and samples.
const FROZEN: (f64, usize) = (0.5, 20);
/// The same for a channel that repeats itself now and then.
const FROZEN_COARSE: f64 = 5.0;
/// Probability that a run is chance.
const CHANCE: f64 = 1e-6;
/// A channel moves while its values spread over this share of their whole spread.
const MOVES: f64 = 0.1;
/// Samples at one end of the range, and their share, from which it is a clipped sensor.
const CLIPPED: (usize, f64) = (10, 0.005);
/// Steps of a channel over its changes within a second beyond which they hide the motion.
const COARSE: f64 = 0.2;
/// Least number of changes of a channel whose values are repeated, the share of them that come at even times, and their size in
/// steps of its resolution.
const REPEATED: (usize, f64, f64) = (50, 0.9, 4.0);
/// Time in which an encoder must count some steps, because its slope is needed, s.
const ENCODER_WINDOW: f64 = 0.15;
/// Specific force of a machine that carries people, on average, over gravity.
const GRAVITY: (f64, f64) = (0.8, 1.25);
const G: f64 = 9.80665;
/// Samples that are looked at together.
const STRETCH: usize = 64;

/// What is wrong with the channels of a log of this period.
pub fn check(subject: &Subject, log: &Log, period: f64) -> Vec<Finding> {
    let mut found = missing(subject, log);
    // Of a long log one channel after the other is in memory.
    let mut room = Vec::new();
    for channel in log.channels.iter().filter(|channel| subject.reads(&channel.name)) {
        found.extend(one(subject, log, period, (&channel.name, channel.values.look(&mut room))));
    }
    for sensor in subject.checks.gravity {
        found.extend(gravity(log, sensor));
    }
    found
}

/// Whether the fit cannot do without this channel: it is required, and nothing else of its group is there.
fn depends_on(subject: &Subject, log: &Log, name: &str) -> bool {
    let other = |pattern: &str| usable(log, pattern, Some(name));
    subject.checks.required.iter().any(|group| group.iter().any(|p| fits(p, name)) && !group.iter().any(|p| other(p)))
}

/// Whether a channel of this name, but not `except`, holds a sample.
fn usable(log: &Log, pattern: &str, except: Option<&str>) -> bool {
    let mut channels = log.channels.iter().filter(|c| fits(pattern, &c.name) && Some(c.name.as_str()) != except);
    channels.any(|channel| channel.values.any(f64::is_finite))
}

/// Channels that the fit needs or could use and that are not there.
fn missing(subject: &Subject, log: &Log) -> Vec<Finding> {
    let mut found = Vec::new();
    let absent = |names: &&&[&str]| !names.iter().any(|name| usable(log, name, None));
    for names in subject.checks.required.iter().filter(absent) {
        let there = log.channels.iter().any(|channel| names.iter().any(|name| fits(name, &channel.name)));
        let name = names.join("' or '");
        let message = if there { format!("no sample of '{name}'") } else { format!("no channel '{name}'") };
        let known: Vec<&str> = log.names().filter(|name| !name.starts_with("true_")).collect();
        let hint = crate::log::columns::hint(names[0], &known);
        let found_here = finding(log, "missing-channel", Severity::Refusal, names.join("' or '"));
        let stop = if hint.ends_with('?') { "" } else { "." };
        let what = format!("{hint}{stop} The fit cannot do without it: name its column in a column map");
        found.push(found_here.says(message, what));
    }
    for (name, purpose) in subject.checks.optional {
        if !usable(log, name, None) {
            let found_here = finding(log, "optional-channel-missing", Severity::Note, *name);
            found.push(found_here.says(format!("is not in the log: {purpose}"), "record it if you can"));
        }
    }
    found
}

/// Identical values one after the other.
struct Run {
    from: usize,
    to: usize,
}

/// What one pass over a channel yields.
struct Profile {
    samples: usize,
    low: f64,
    high: f64,
    /// Samples whose neighbours are both missing.
    lonely: usize,
    /// Pairs of neighbours, and those that are equal and in no long run.
    pairs: usize,
    equal: usize,
    /// Smallest change that is one.
    step: f64,
    /// Runs that last long enough to be suspicious.
    runs: Vec<Run>,
}

impl Profile {
    fn of(values: &[f64], long: usize) -> Self {
        let extent = scan::extent(values);
        let mut profile = Self {
            samples: extent.count,
            low: extent.low,
            high: extent.high,
            lonely: 0,
            pairs: 0,
            equal: 0,
            step: f64::INFINITY,
            runs: Vec::new(),
        };
        let least = 1e-9 * (profile.high - profile.low).max(1e-3 * profile.high.abs().max(profile.low.abs()));
        let whole = profile.samples == values.len();
        // First of the present run of equal values.
        let mut start = 0;
        let mut from = 0;
        while from < values.len() {
            let to = (from + STRETCH).min(values.len());
            if whole && from > 0 {
                let (step, equal) = scan::smallest_change(&values[from - 1..to], least);
                profile.step = profile.step.min(step);
                profile.pairs += to - from;
                // Most stretches have no equal neighbours, the value before them included.
                if equal == 0 && start + 1 == from && to < values.len() {
                    start = to - 1;
                    from = to;
                    continue;
                }
            } else {
                (from..to).for_each(|k| profile.compare(values, k, least));
            }
            (from..to).for_each(|k| profile.run(values, k, long, &mut start));
            from = to;
        }
        profile
    }

    /// Compares a value with its neighbours.
    fn compare(&mut self, values: &[f64], k: usize, least: f64) {
        let missing = |k: usize| values.get(k).is_none_or(|value| value.is_nan());
        if !missing(k) && (k == 0 || missing(k - 1)) && missing(k + 1) {
            self.lonely += 1;
        }
        if k > 0 && !missing(k) && !missing(k - 1) {
            self.pairs += 1;
            let change = (values[k] - values[k - 1]).abs();
            if change > least {
                self.step = self.step.min(change);
            }
        }
    }

    /// Ends the run of equal values that starts at `start` before a value that differs.
    fn run(&mut self, values: &[f64], k: usize, long: usize, start: &mut usize) {
        let repeats = k > 0 && values[k] == values[k - 1];
        if !repeats || k + 1 == values.len() {
            let end = if repeats { k + 1 } else { k };
            if end - *start >= long {
                self.runs.push(Run { from: *start, to: end });
                self.pairs -= end - *start - 1;
            } else {
                self.equal += (end - *start).saturating_sub(1);
            }
            *start = k;
        }
    }

    /// Samples in a row that are not equal by chance, if neighbours are equal as often as they usually are: a sensor
    /// whose noise shows in every sample needs few, one with coarse steps many.
    fn dead_from(&self, period: f64) -> usize {
        let share = ((self.equal + 1) as f64 / (self.pairs + 2) as f64).min(0.99);
        let chance = ((self.samples as f64).ln() - CHANCE.ln()) / -share.ln();
        let seconds = if share < 0.05 { FROZEN.0 } else { FROZEN_COARSE };
        (chance.max(seconds / period).ceil() as usize).max(FROZEN.1)
    }
}

fn is_force(variable: Option<&Variable>) -> bool {
    variable.is_some_and(|variable| matches!(variable.unit, "N" | "N.m"))
}

fn is_command(variable: Option<&Variable>) -> bool {
    variable.is_some_and(|variable| variable.held)
}

/// Whether no sensor of the log changes.
fn at_rest(subject: &Subject, log: &Log) -> bool {
    let measured =
        |c: &&Channel| subject.input(&c.name).is_some_and(|input| input.measured && !input.unit.starts_with('N'));
    !log.channels.iter().filter(measured).any(|channel| moves(&channel.values))
}

/// An angle without end.
fn is_encoder(variable: Option<&Variable>) -> bool {
    variable.is_some_and(|variable| variable.unit == "rad" && variable.range.1 > 1e3)
}

fn one(subject: &Subject, log: &Log, period: f64, (name, values): (&str, &[f64])) -> Vec<Finding> {
    let variable = subject.input(name);
    let long = ((FROZEN.0 / period).ceil() as usize).max(FROZEN.1);
    let profile = Profile::of(values, long);
    let needed = depends_on(subject, log, name);
    let severity = if needed { Severity::Refusal } else { Severity::Warning };
    let mut found = Vec::new();
    if profile.samples < 2 {
        return found;
    }
    if let Some(variable) = variable {
        found.extend(outside(log, variable, values, &profile));
    }
    if profile.low == profile.high {
        if !is_command(variable) {
            // A machine at rest is no dead sensor, only a log that says nothing.
            let severity = if is_force(variable) || at_rest(subject, log) { Severity::Warning } else { severity };
            let message = format!("is {} in every sample", short(profile.low));
            let what = "a working sensor shows noise: check its cable, or leave the channel out";
            found.push(finding(log, "constant-channel", severity, name).says(message, what));
        }
        return found;
    }
    if 2 * profile.lonely > profile.samples && 2 * profile.samples <= values.len() {
        let share = 100.0 * profile.samples as f64 / values.len() as f64;
        let message = format!("has samples at {share:.0} % of the times only, each alone between missing ones");
        let what = format!("a column map carries them over: {name} = {{ column = \"...\", between = \"linear\" }}");
        found.push(finding(log, "sparse-channel", Severity::Warning, name).says(message, what));
        return found;
    }
    if is_command(variable) {
        return found;
    }
    found.extend(frozen(subject, log, period, name, values, &profile));
    found.extend(repeated(log, period, name, values, &profile));
    if !is_force(variable) {
        found.extend(clipped(log, name, values, &profile));
        let reach = if is_encoder(variable) { ENCODER_WINDOW } else { 1.0 };
        found.extend(coarse(log, name, values, &profile, (reach / period).round() as usize));
    }
    if is_encoder(variable) {
        found.extend(wrapped(log, name, values, &profile));
    }
    found
}

/// Values that the declaration of the input excludes.
fn outside(log: &Log, variable: &Variable, values: &[f64], profile: &Profile) -> Option<Finding> {
    let (low, high) = variable.range;
    if low <= profile.low && profile.high <= high {
        return None;
    }
    let beyond = |value: &f64, scale: f64| value.is_finite() && !(low..=high).contains(&(value * scale));
    let count = values.iter().filter(|value| beyond(value, 1.0)).count();
    if (count as f64) < OUTSIDE * profile.samples as f64 {
        return None;
    }
    let first = values.iter().position(|value| beyond(value, 1.0))?;
    let message = format!(
        "{:.0} % of the samples lie outside {} to {} {}; the largest is {}",
        100.0 * count as f64 / profile.samples as f64,
        short(low),
        short(high),
        variable.unit,
        short(if profile.high > -profile.low { profile.high } else { profile.low })
    );
    let degrees = variable.unit.starts_with("rad") && {
        let left = values.iter().filter(|value| beyond(value, std::f64::consts::PI / 180.0)).count();
        (left as f64) < OUTSIDE * profile.samples as f64
    };
    let what = if degrees {
        let unit = variable.unit.replacen("rad", "deg", 1);
        format!(
            "if it is in {unit}, a column map says so: {} = {{ column = \"...\", unit = \"{unit}\" }}",
            variable.name
        )
    } else {
        "check its unit".to_owned()
    };
    let found = finding(log, "out-of-range", Severity::Refusal, variable.name.as_str());
    Some(found.at(log.time.at(first)).says(message, what))
}

/// A sensor with noise that repeats one value while the machine moves.
fn frozen(subject: &Subject, log: &Log, period: f64, name: &str, values: &[f64], profile: &Profile) -> Option<Finding> {
    if profile.pairs < 50 {
        return None;
    }
    let dead_from = profile.dead_from(period);
    let unit = |name: &str| subject.input(name).map_or("", |variable| variable.unit);
    let is_rate = |name: &str| matches!(unit(name), "m/s" | "rad/s");
    let measured = |c: &Channel| c.name != name && subject.input(&c.name).is_some_and(|v| v.measured);
    let spans: Vec<OnceCell<f64>> = vec![OnceCell::new(); log.channels.len()];
    let span = |values: &[f64]| {
        let finite = values.iter().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
        (high - low).max(0.0)
    };
    let size = profile.high.abs().max(profile.low.abs());
    let alive = |run: &&Run| {
        // The ends of the range are for `clipped`.
        if run.to - run.from < dead_from || values[run.from] == profile.high || values[run.from] == profile.low {
            return false;
        }
        let moves = |(c, whole): (&Channel, &OnceCell<f64>)| {
            span(&c.values.part(run.from..run.to)) > MOVES * whole.get_or_init(|| span(&c.values.clone()))
        };
        let mut others = log.channels.iter().zip(&spans).filter(|(c, _)| measured(c));
        if is_rate(name) {
            // A speed of exactly 0 is a rest, unless another speed says otherwise; any other one is motion itself.
            values[run.from].abs() > MOVES * size || others.any(|other| is_rate(&other.0.name) && moves(other))
        } else {
            others.any(moves)
        }
    };
    let dead: Vec<&Run> = profile.runs.iter().filter(alive).collect();
    let longest = dead.iter().max_by_key(|run| run.to - run.from)?;
    let seconds = log.time.at(longest.to - 1) - log.time.at(longest.from);
    let message = format!(
        "stands at {} for {} s while the machine moves{}",
        short(values[longest.from]),
        short(seconds),
        if dead.len() > 1 { format!(", the longest of {} such stretches", dead.len()) } else { String::new() }
    );
    let what = format!(
        "cut the log there, or mark these samples as missing in a column map: {name} = {{ column = \"...\", missing_if = \"...\" }}"
    );
    Some(finding(log, "stuck-channel", Severity::Warning, name).at(log.time.at(longest.from)).says(message, what))
}

/// A sensor with a slower clock, of which every value is held until the next one: on average it is late by half its period less
/// half a sample. What moves by single steps of its resolution repeats values, too, and is no such sensor.
fn repeated(log: &Log, period: f64, name: &str, values: &[f64], profile: &Profile) -> Option<Finding> {
    // How often a value lasts for so many samples.
    let mut lasts: BTreeMap<usize, usize> = BTreeMap::new();
    let (mut length, mut ones) = (0, 0);
    for pair in values.windows(2) {
        length += 1;
        if pair[0] != pair[1] {
            match length {
                _ if !(pair[0].is_finite() && pair[1].is_finite()) => {}
                1 => ones += 1,
                _ => *lasts.entry(length).or_default() += 1,
            }
            length = 0;
        }
    }
    lasts.insert(1, ones);
    let count: usize = lasts.values().sum();
    if count < REPEATED.0 {
        return None;
    }
    let mut up_to = 0;
    let median = lasts.iter().find(|(_, often)| {
        up_to += **often;
        up_to > count / 2
    });
    let times = *median?.0;
    let late = 0.5 * (times - 1) as f64 * period;
    // Clocks that are no multiples of each other differ by a sample; two equal values in a row are one long one.
    let even = |length: usize| (length % times).min(times - length % times) <= usize::from(times > 2);
    let regular: usize = lasts.iter().filter(|(length, _)| even(**length)).map(|(_, often)| often).sum();
    if regular as f64 <= REPEATED.1 * count as f64 || late <= HARMLESS.max(period) {
        return None;
    }
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let mut changes: Vec<f64> = changes.filter(|change| change.is_finite() && *change != 0.0).collect();
    let middle = changes.len() / 2;
    if *changes.select_nth_unstable_by(middle, f64::total_cmp).1 < REPEATED.2 * profile.step {
        return None;
    }
    let message = format!(
        "repeats every value {times} times: it is sampled every {} s, held in between, and so {:.0} ms late on average",
        short(times as f64 * period),
        1e3 * late
    );
    let what = format!(
        "log it at its own times: a column map carries it over in a straight line, {name} = {{ column = \"...\", between = \"linear\" }}"
    );
    Some(finding(log, "held-channel", Severity::Warning, name).says(message, what))
}

/// Many samples at exactly one end of the range and hardly any beside it.
fn clipped(log: &Log, name: &str, values: &[f64], profile: &Profile) -> Option<Finding> {
    let near = 0.02 * (profile.high - profile.low);
    for (end, word) in [(profile.high, "largest"), (profile.low, "smallest")] {
        // With few steps many samples are at the end of the range by chance.
        if end == 0.0 || profile.step > 0.01 * (profile.high - profile.low) {
            continue;
        }
        let exact = values.iter().filter(|value| **value == end).count();
        if exact < CLIPPED.0 || (exact as f64) < CLIPPED.1 * profile.samples as f64 {
            continue;
        }
        let beside = values.iter().filter(|value| **value != end && (**value - end).abs() < near).count();
        let in_runs = values.windows(3).filter(|w| w.iter().all(|value| *value == end)).count();
        if exact < 3 * beside {
            continue;
        }
        // One long stretch is a frozen sensor or a rest, not a clipped one.
        let stretches = values.windows(2).filter(|pair| pair[0] != end && pair[1] == end).count();
        if 2 * in_runs < exact / 2 || stretches < 2 {
            continue;
        }
        let first = values.iter().position(|value| *value == end)?;
        let share = 100.0 * exact as f64 / profile.samples as f64;
        let message = format!("{share:.1} % of the samples are exactly {}, the {word} value", short(end));
        let what = "the sensor seems to be at the end of its range: use a wider one, or mark these samples as missing";
        return Some(
            finding(log, "saturated-channel", Severity::Warning, name).at(log.time.at(first)).says(message, what),
        );
    }
    None
}

/// Steps that are a good part of what the channel does within so many samples.
fn coarse(log: &Log, name: &str, values: &[f64], profile: &Profile, samples: usize) -> Option<Finding> {
    let samples = samples.clamp(1, values.len());
    let (squares, count) = scan::squared_changes(values, samples);
    let usual = (squares / count as f64).sqrt();
    if count < 100 || !profile.step.is_finite() || profile.step < COARSE * usual || usual == 0.0 {
        return None;
    }
    let message = format!(
        "changes in steps of {}, and within {} s by {} only (root mean square)",
        short(profile.step),
        short(samples as f64 * log.period()),
        short(usual)
    );
    let what = "record it with more digits or a finer sensor: the steps hide the motion";
    Some(finding(log, "coarse-channel", Severity::Warning, name).says(message, what))
}

/// An angle that jumps from one end of its range to the other.
fn wrapped(log: &Log, name: &str, values: &[f64], profile: &Profile) -> Option<Finding> {
    let range = profile.high - profile.low;
    let jumps = |k: usize| (values[k + 1] - values[k]).abs() > 0.8 * range;
    let last = values.len() - 1;
    // What jumps back at once is a spike.
    let wraps = |k: &usize| jumps(*k) && !(*k > 0 && jumps(k - 1)) && !(k + 1 < last && jumps(k + 1));
    let places: Vec<usize> = (0..last).filter(wraps).collect();
    let first = *places.first()?;
    let turn = (values[first + 1] - values[first]).abs();
    let message = format!("jumps by {} rad, {} times in all: its counter wraps", short(turn), places.len());
    let what = "unwrap it: add the counter's range at each jump, or map a speed with integrate = true";
    Some(finding(log, "wrapped-channel", Severity::Refusal, name).at(log.time.at(first + 1)).says(message, what))
}

/// Specific force on average: gravity.
fn gravity(log: &Log, sensor: &Accelerometer) -> Option<Finding> {
    let axes = sensor.axes;
    let values: Option<Vec<Series>> = axes.iter().map(|axis| log.series(axis)).collect();
    let values = values?;
    let norm = |k: usize| values.iter().map(|axis| axis[k] * axis[k]).sum::<f64>().sqrt();
    let mut norms: Vec<f64> = (0..log.len()).map(norm).filter(|norm| norm.is_finite()).collect();
    if norms.is_empty() {
        return None;
    }
    let middle = norms.len() / 2;
    let usual = *norms.select_nth_unstable_by(middle, f64::total_cmp).1;
    let name = axes.join(", ");
    let ratio = usual / G;
    if (GRAVITY.0..=GRAVITY.1).contains(&ratio) {
        let mut up: Vec<f64> = values[2].iter().copied().filter(|value| value.is_finite()).collect();
        let middle = up.len() / 2;
        let median = *up.select_nth_unstable_by(middle, f64::total_cmp).1;
        if sensor.upright && median < 0.0 {
            let message =
                format!("is {} m/s2 on average, but the specific force at rest points up, +9.81", short(median));
            let what = "the axes seem to be forward, right, down (SAE); here they are forward, left, up: change signs in a column map, scale = -1";
            return Some(finding(log, "sign-mismatch", Severity::Refusal, axes[2]).says(message, what));
        }
        return None;
    }
    let message = format!("have the size {} on average, but gravity alone is 9.81 m/s2", short(usual));
    let (code, what) = if (GRAVITY.0 / G..=GRAVITY.1 / G).contains(&ratio) {
        ("unit-mismatch", "if they are in g, a column map says so: unit = \"g\"")
    } else if ratio < 0.3 {
        ("unit-mismatch", "gravity seems to have been taken off: specific force with gravity is needed")
    } else {
        ("unit-mismatch", "check their unit")
    };
    Some(finding(log, code, Severity::Refusal, name).says(message, what))
}
