//! Channels that say the same in two ways.
//!
//! A relation is a linear equation between signals, `y = b_1 x_1 + ... + b_n x_n`, each one a channel, a product of
//! channels or a derivative of one: `tilt_rate = d tilt/dt`, `accel_x = d speed/dt + slope`, `F = M dv/dt + ...`. All
//! signals pass the same symmetric window, which delays none. Slow parts (slopes, biases) are taken off by a constant
//! per block of the log where the relation says so.
//!
//! *Gain.* With noise on both sides the proportion of `y` to `x_1` lies between the two regressions, `b_yx` and
//! `1/b_xy`, that is between `|rho| g` and `g/|rho|` with `g` the ratio of their sizes and `rho` their (partial)
//! correlation. It is a fault if this whole interval lies outside what physics allows.
//!
//! *Delay.* Some of the signals are shifted against the others by every lag; the lag with the largest share of explained
//! variance is the delay. Its standard error is the jackknife's over the blocks of the log, which needs no model of the
//! noise: a delay that is one shows in all parts of a log alike.

use super::regression::Answer;
use super::{Finding, Severity, finding, short};
use crate::log::{Log, Series};

/// Correlation from which a relation says something about gain and sign; share of explained variance from which it says
/// something about a delay.
pub(super) const CLEAR: f64 = 0.7;
const EXPLAINED: f64 = 0.5;
/// Delays up to this are what good sensors' own filters have, s; those below a sample period anyhow.
pub(crate) const HARMLESS: f64 = 0.015;
/// What is left unexplained without a delay over what is left with it: of one signal against others, and of the parts of
/// a motion together, whose free coefficients a delay trades with.
const WORTH: (f64, f64) = (1.1, 1.5);
/// Standard errors that a delay must be away from what is harmless.
const SURE: f64 = 3.0;

/// On which side of a delay a term stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// It stays where it is.
    Model,
    /// It is shifted.
    Late,
}

/// A signal of a relation.
#[derive(Clone, Debug)]
pub struct Term {
    /// The channels that it is made of.
    pub channels: Vec<String>,
    /// What it is the sum of: samples on even steps, and the time derivatives that are to be taken of them, 0, 1 or 2.
    pub parts: Vec<(Series, usize)>,
    /// Whether it is shifted when a delay is looked for.
    pub side: Side,
}

impl Term {
    /// The same, to be shifted.
    pub fn late(mut self) -> Self {
        self.side = Side::Late;
        self
    }

    /// The same times a constant.
    pub fn times(mut self, factor: f64) -> Self {
        self.parts.iter_mut().flat_map(|(values, _)| values).for_each(|value| *value *= factor);
        self
    }

    /// The sum with another one, if there is one.
    pub fn plus(mut self, other: Option<Self>) -> Self {
        if let Some(other) = other {
            self.parts.extend(other.parts);
            self.channels.extend(other.channels);
        }
        self
    }

    fn names(&self) -> String {
        self.channels.join(", ")
    }
}

/// What is known of the proportion `b_1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gain {
    /// Both sides are the same quantity in the same unit: 1, within a factor that covers lengths as given.
    Same(f64),
    /// Positive and about this, within a factor: masses and lengths as given.
    About(f64, f64),
    /// Nothing.
    Any,
}

/// A linear equation between signals.
#[derive(Clone, Debug)]
pub struct Relation {
    /// What both sides are, in words.
    pub what: &'static str,
    /// The left side.
    pub y: Term,
    /// The right side: the first one has the gain, the others are there because physics has them.
    pub x: Vec<Term>,
    /// The gain of the first one.
    pub gain: Gain,
    /// The known parameters that it takes as right, in words; empty if there are none.
    pub given: &'static str,
    /// Whether every block of the log has a constant of its own.
    pub constant: bool,
    /// Whether a delay between the sides would be a fault: no dynamics lie between them.
    pub delay: bool,
}

impl Relation {
    /// `y = constant + x_1 b_1 + ...` with a constant for every block and no dynamics between the sides.
    pub fn new(what: &'static str, y: Term, x: Vec<Term>, gain: Gain) -> Self {
        Self { what, y, x, gain, given: "", constant: true, delay: true }
    }

    /// The same, and it takes these known parameters as right.
    pub fn given(self, given: &'static str) -> Self {
        Self { given, ..self }
    }

    /// The same; a delay is a fault only if `delay` says so.
    pub fn with_delay(self, delay: bool) -> Self {
        Self { delay, ..self }
    }

    /// The same without constants: both sides are zero together.
    pub fn without_constant(self) -> Self {
        Self { constant: false, ..self }
    }

    /// Whether it has a channel that is known to be bad.
    pub(super) fn is_spoilt(&self, spoilt: &[String]) -> bool {
        self.channels().any(|channel| spoilt.iter().any(|list| list.split(", ").any(|name| name == channel)))
    }

    /// Whether it is the same of another block.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.what == other.what && self.channels().eq(other.channels())
    }

    /// The same without its samples.
    pub(super) fn without_samples(&self) -> Self {
        let mut bare = self.clone();
        let parts = bare.x.iter_mut().chain([&mut bare.y]).flat_map(|term| &mut term.parts);
        parts.for_each(|(samples, _)| *samples = Series::default());
        bare
    }

    /// Every channel of it.
    fn channels(&self) -> impl Iterator<Item = &String> {
        self.x.iter().chain([&self.y]).flat_map(|term| &term.channels)
    }
}

/// How late channels are against others.
#[derive(Clone, Debug)]
pub struct Delay {
    /// The channels that are late, or early if the delay is negative.
    pub late: Vec<String>,
    /// Those that they are compared with.
    pub against: Vec<String>,
    /// s
    pub delay: f64,
    /// Its standard error, s.
    pub std: f64,
    /// How they are compared, in words.
    pub what: &'static str,
}

impl Delay {
    /// Whether it is more than good sensors, sampled with this period, have.
    fn shows(&self, period: f64) -> bool {
        self.delay.abs() - SURE * self.std > HARMLESS.max(period)
    }

    /// Whether something else that is wrong with its channels explains it, or says the same.
    pub(super) fn is_said_by(&self, finding: &Finding) -> bool {
        let its = |name: &str| self.late.iter().chain(&self.against).any(|channel| channel == name);
        finding.severity >= Severity::Warning && finding.channel.split(", ").any(its)
    }

    pub(super) fn finding(&self, log: &Log) -> Finding {
        let (mut late, mut early) = (&self.late, &self.against);
        if self.delay < 0.0 {
            std::mem::swap(&mut late, &mut early);
        }
        let (ms, std) = (1e3 * self.delay.abs(), 1e3 * self.std);
        let message = format!(
            "arrives {ms:.0} ms ({:.0} to {:.0}) later than {} ({})",
            ms - 2.0 * std,
            ms + 2.0 * std,
            early.join(", "),
            self.what
        );
        let what = "give the channels one clock, or shift the late ones back before the fit (a file or group of its own: offset in join)";
        finding(log, "delayed-channel", Severity::Warning, late.join(", ")).says(message, what)
    }
}

/// Proportions that a wrong unit makes, its words, and what a map must say.
const FACTORS: [(f64, &str); 12] = [
    (std::f64::consts::PI / 180.0, "degrees instead of radians"),
    (std::f64::consts::TAU, "turns instead of radians"),
    (1.0 / 9.80665, "g instead of m/s2"),
    (9.80665e-3, "mg instead of m/s2"),
    (1.0 / 3.6, "km/h instead of m/s"),
    (0.44704, "mph instead of m/s"),
    (std::f64::consts::PI / 30.0, "rpm instead of rad/s"),
    (1e-3, "thousandths (mm, ms, milli...) instead of the SI unit"),
    (1e3, "thousands (km, kN.m, ...) instead of the SI unit"),
    (1e-6, "millionths instead of the SI unit"),
    (60.0, "per minute or in minutes instead of seconds"),
    (1e-2, "hundredths (cm, %) instead of the SI unit"),
];

/// What the relations say is wrong with a log of this period.
pub fn check(log: &Log, period: f64, answers: &[(Relation, Answer)]) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut spoilt = Vec::new();
    for (relation, answer) in answers {
        if let Some(finding) = gain(log, relation, answer) {
            spoilt.extend(relation.y.channels.iter().chain(&relation.x[0].channels).cloned());
            found.push((relation.what, finding));
        }
    }
    let channels = |relation: &Relation| {
        let mut all: Vec<String> = relation.channels().cloned().collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    for (relation, answer) in answers {
        let own = channels(relation);
        // Of several ways to explain the same signals by a delay the best one counts.
        let better = |other: &(Relation, Answer)| channels(&other.0) == own && other.1.explained > answer.explained;
        if own.iter().any(|channel| spoilt.contains(channel)) || answers.iter().any(better) {
            continue;
        }
        if let Some(late) = delay(log, period, relation, answer)
            && !found.iter().any(|(_, other)| other.code == late.code && other.channel == late.channel)
        {
            found.push((relation.what, late));
        }
    }
    merged(found)
}

/// One finding for all joints that say the same.
fn merged(found: Vec<(&str, Finding)>) -> Vec<Finding> {
    let mut all: Vec<(&str, Finding)> = Vec::new();
    for (what, finding) in found {
        match all.iter_mut().find(|(other, first)| *other == what && first.code == finding.code) {
            Some((_, first)) => first.channel = format!("{}, {}", first.channel, finding.channel),
            None => all.push((what, finding)),
        }
    }
    all.into_iter().map(|(_, finding)| finding).collect()
}

/// A proportion or a sign that cannot be.
fn gain(log: &Log, relation: &Relation, answer: &Answer) -> Option<Finding> {
    let (expected, factor, severity) = match relation.gain {
        Gain::Same(factor) => (1.0, factor, Severity::Refusal),
        Gain::About(size, factor) => (size, factor, Severity::Warning),
        Gain::Any => return None,
    };
    let rho = answer.correlation.abs();
    if rho < CLEAR || !answer.steady {
        return None;
    }
    let channel = format!("{}, {}", relation.y.names(), relation.x[0].names());
    if answer.correlation < 0.0 {
        // Half a period of an oscillation turns the sign, too: one that is wrong is so without a delay.
        if answer.correlation_now > -0.5 * CLEAR {
            return None;
        }
        let message = format!("{}: they have opposite signs (correlation {:.2})", relation.what, answer.correlation);
        let what = "one of them has another sign convention (SAE: y right, z down; or a wheel counted backwards): scale = -1 in a column map";
        return Some(finding(log, "sign-mismatch", severity, channel).says(message, what));
    }
    let ratio = answer.gain / expected;
    let (least, most) = (ratio * rho, ratio / rho);
    if most >= 1.0 / factor && least <= factor {
        return None;
    }
    let near = |unit: f64| (ratio / unit).ln().abs() < (1.0 / rho).ln() + 0.18;
    let mut words = Vec::new();
    for (unit, word) in FACTORS {
        // y = true / unit if y is recorded in that unit.
        if near(1.0 / unit) {
            words.push(format!("{} may be in {word}", relation.y.names()));
        } else if near(unit) {
            words.push(format!("{} may be in {word}", relation.x[0].names()));
        }
    }
    let message = format!("{}: their proportion is {}, not {}", relation.what, short(answer.gain), short(expected));
    let order = |term: &Term| term.parts.iter().map(|(_, order)| *order).max();
    if order(&relation.y) != order(&relation.x[0]) {
        words.push("the times may not be in s".to_owned());
    }
    if !relation.given.is_empty() {
        words.push(format!("{} may be another one (--set)", relation.given));
    }
    let guess = if words.is_empty() { "check the units of both".to_owned() } else { words.join("; or ") };
    let what = format!("{guess}; unit = \"...\" in a column map puts it right");
    Some(finding(log, "unit-mismatch", severity, channel).says(message, what))
}

/// Channels that arrive late.
fn delay(log: &Log, period: f64, relation: &Relation, answer: &Answer) -> Option<Finding> {
    let Answer { delay, delay_std: std, explained, .. } = *answer;
    // Signals whose proportion is known to be positive are not delayed into opposite ones.
    let opposite = relation.gain != Gain::Any && answer.correlation < 0.0;
    if !relation.delay || opposite || explained < EXPLAINED {
        return None;
    }
    // A delay that leaves nearly as much unexplained as before explains nothing.
    let shifted = relation.x.iter().chain([&relation.y]).filter(|term| term.side == Side::Late).count();
    let worth = if shifted == 1 { WORTH.0 } else { WORTH.1 };
    if 1.0 - answer.explained_now < worth * (1.0 - explained) {
        return None;
    }
    let of = |side: Side| {
        // Nuisances are not what the relation compares.
        let compared = |term: &&Term| term.side == Side::Late || term.channels == relation.x[0].channels;
        let nuisances = relation.x.iter().filter(compared);
        let terms = nuisances.chain([&relation.y]).filter(|term| term.side == side);
        let mut names: Vec<String> = terms.flat_map(|term| term.channels.iter().cloned()).collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    let delay = Delay { late: of(Side::Late), against: of(Side::Model), delay, std, what: relation.what };
    delay.shows(period).then(|| delay.finding(log))
}
