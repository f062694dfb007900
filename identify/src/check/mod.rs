//! What is wrong with a log, before anything is fitted to it.
//!
//! A fit takes its channels as they are: times in milliseconds, an accelerometer in g or a speed that arrives late give confident
//! nonsense. [`check`] looks for such faults where a log shows them:
//!
//! - [`time`]: the sample period compared with what the machine's estimator and fit can use, gaps, scattered stamps;
//! - [`channel`]: channels that the fit needs and lacks, constant, frozen, clipped, coarse or wrapping ones;
//! - [`relation`]: channels that say the same thing in two ways (the slope of an angle and its rate, wheel speed times
//!   radius and speed over ground, specific force and the derivative of the speed): their proportion shows units and signs,
//!   their cross-correlation a delay;
//! - what a machine itself adds where only a simulation of it tells a delay ([`Checks::delays`]).
//!
//! What a machine's log must hold and which of its channels say the same stands in its record, see [`Checks`]. A
//! relation speaks only where the log excites it: silence is no proof that a channel is right.

pub mod channel;
mod gram;
mod regression;
pub mod relation;
mod scan;
mod signals;
pub mod time;
pub(crate) mod window;

pub use crate::finding::{Finding, Severity};
pub use relation::{Delay, Gain, Relation, Side, Term};
pub use signals::Signals;

use crate::log::columns::fits;
use crate::log::{LONG, Log};
use crate::problem::Known;
use wheelstate::Variable;

/// Three axes of specific force, of a sensor on a machine that hardly accelerates beside gravity.
#[derive(Clone, Copy, Debug)]
pub struct Accelerometer {
    /// Its channels x, y, z.
    pub axes: [&'static str; 3],
    /// Whether z points up, within what a machine tilts.
    pub upright: bool,
}

/// What a machine's logs must be like for its fit.
#[derive(Clone, Copy)]
pub struct Checks {
    /// Channels that the fit cannot do without: one of each group. `*` stands for any text.
    pub required: &'static [&'static [&'static str]],
    /// Channels that the fit uses where there are any, and what for.
    pub optional: &'static [(&'static str, &'static str)],
    /// Longest sample period that still shows what the fit is about, s: a few samples in each of its windows.
    pub slowest: f64,
    /// Samples up to which a fit takes no longer than a look.
    pub quick: usize,
    /// Accelerometers that feel gravity.
    pub gravity: &'static [Accelerometer],
    /// Channels that tell the same in two ways.
    pub relations: fn(&Signals) -> Vec<Relation>,
    /// Delays that no linear equation between signals shows, but a simulation of the machine: those that are a fault. Signals
    /// of a long log are as recorded, and are to be looked at in parts.
    pub delays: fn(&Signals) -> Vec<Delay>,
}

impl Checks {
    /// Of a machine of which nothing is known: times and channels are looked at, relations are not.
    pub const NONE: Self = Self {
        required: &[],
        optional: &[],
        slowest: f64::INFINITY,
        quick: 0,
        gravity: &[],
        relations: |_| Vec::new(),
        delays: |_| Vec::new(),
    };

    /// The channels that it names in full.
    pub fn channels(&self) -> impl Iterator<Item = &'static str> {
        let required = self.required.iter().flat_map(|group| group.iter().copied());
        let optional = self.optional.iter().map(|(name, _)| *name);
        required.chain(optional).filter(|name| !name.contains('*'))
    }
}

/// What is looked at: a machine's declarations and its own checks.
pub struct Subject<'a> {
    /// The inputs of its estimator.
    pub inputs: &'a [Variable],
    /// What is known of its parameters.
    pub known: &'a Known,
    /// Its own checks.
    pub checks: &'a Checks,
}

/// Everything that is found in one log, the worst first.
pub fn check(subject: &Subject, log: &Log) -> Vec<Finding> {
    check_from(LONG, subject, log)
}

/// The same, where a log is long from so many samples on: then never more than a few of its columns, or a block of it, are in
/// memory.
pub(crate) fn check_from(long: usize, subject: &Subject, log: &Log) -> Vec<Finding> {
    let period = log.period();
    let mut findings = time::check(subject, log, period);
    findings.extend(channel::check(subject, log, period));
    // With a wrong clock every slope is wrong: it would only be said again in other words.
    if findings.iter().all(|finding| finding.channel != "time" || finding.severity < Severity::Refusal) {
        let spoilt: Vec<String> =
            findings.iter().filter(|f| f.severity >= Severity::Warning).map(|f| f.channel.clone()).collect();
        let whole = log.len() < long;
        let signals = if whole { Signals::new(subject, log) } else { Signals::of_parts(subject, log, period) };
        let answers = if whole {
            regression::answers(&signals, (subject.checks.relations)(&signals), &spoilt)
        } else {
            regression::answers_by_blocks(subject, log, &spoilt)
        };
        findings.extend(relation::check(log, signals.period, &answers));
        let delays = (subject.checks.delays)(&signals).into_iter();
        let delays = delays.filter(|delay| !findings.iter().any(|finding| delay.is_said_by(finding)));
        findings.extend(delays.map(|delay| delay.finding(log)).collect::<Vec<_>>());
    }
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings
}

impl Subject<'_> {
    /// The declaration of an input.
    fn input(&self, name: &str) -> Option<&Variable> {
        self.inputs.iter().find(|input| input.name == name)
    }

    /// Whether the fit may read a channel.
    pub(crate) fn reads(&self, name: &str) -> bool {
        let required = self.checks.required.iter().flat_map(|group| group.iter());
        let optional = self.checks.optional.iter().map(|(pattern, _)| pattern);
        self.input(name).is_some() || required.chain(optional).any(|pattern| fits(pattern, name))
    }
}

/// Starts a finding about a log.
fn finding(log: &Log, code: &str, severity: Severity, channel: impl Into<String>) -> Finding {
    Finding {
        file: log.source.clone(),
        channel: channel.into(),
        time: None,
        code: code.to_owned(),
        severity,
        message: String::new(),
        suggestion: String::new(),
    }
}

impl Finding {
    fn at(self, time: f64) -> Self {
        // Milliseconds are enough to find the place, and short.
        Self { time: Some((time * 1e3).round() / 1e3), ..self }
    }

    fn says(self, message: String, suggestion: impl Into<String>) -> Self {
        Self { message, suggestion: suggestion.into(), ..self }
    }
}

/// A number for people: three digits.
pub fn short(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !size.is_finite() {
        return value.to_string();
    }
    if !(1e-4..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = (2 - size.log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
