//! The channels of a log on even steps, as relations take them.

use super::Subject;
use super::relation::{Side, Term};
use crate::log::{Channel, Log, Series};
use crate::problem::Known;

/// Whether a channel has more than one value. A sensor that never moves is a dead one; a command or a slope may well be constant.
pub(super) fn moves(values: &Series) -> bool {
    let mut first = None;
    let mut differs = |value: &f64| value.is_finite() && *first.get_or_insert(*value) != *value;
    values.pieces().any(|piece| piece.iter().any(&mut differs))
}

/// Channels on even steps with what is known of the machine.
pub struct Signals<'a> {
    /// The log with the channels of the fit only.
    log: Log,
    /// Time between two samples, s.
    pub period: f64,
    /// What is known of the machine.
    pub known: &'a Known,
}

impl<'a> Signals<'a> {
    /// Those channels of a log that the fit may use. What lies beyond an input's declared range is missing.
    pub fn new(subject: &Subject<'a>, log: &Log) -> Self {
        let mut own = log.slice(0..log.len(), |name| subject.reads(name));
        own.channels.retain(|c| subject.input(&c.name).is_some_and(|input| input.held) || moves(&c.values));
        for Channel { name, values } in &mut own.channels {
            let Some(variable) = subject.input(name) else { continue };
            let (low, high) = variable.range;
            let impossible = |value: &f64| *value < low || *value > high;
            // Most channels are as they should be, and need no copy.
            if values.iter().any(impossible) {
                values.iter_mut().filter(|value| impossible(value)).for_each(|value| *value = f64::NAN);
            }
        }
        let (even, period) = own.on_even_steps();
        let log = even.into_owned();
        Self { log, period, known: subject.known }
    }

    /// The same of a long log of this period, of which parts are looked at that are read when they are: as it was recorded.
    pub fn of_parts(subject: &Subject<'a>, log: &Log, period: f64) -> Self {
        let mut own = log.slice(0..log.len(), |name| subject.reads(name));
        own.channels.retain(|c| subject.input(&c.name).is_some_and(|input| input.held) || moves(&c.values));
        Self { log: own, period, known: subject.known }
    }

    /// Its samples.
    pub fn len(&self) -> usize {
        self.log.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.log.is_empty()
    }

    /// The log on even steps.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Whether a channel holds samples.
    pub fn has(&self, name: &str) -> bool {
        self.log.channels.iter().any(|channel| channel.name == name && channel.values.any(f64::is_finite))
    }

    /// A channel that holds samples.
    pub fn channel(&self, name: &str) -> Option<&[f64]> {
        self.log.channel(name).filter(|values| values.iter().any(|value| value.is_finite()))
    }

    /// A channel as a term, its `order`-th derivative to be taken.
    pub fn term(&self, name: &str, order: usize) -> Option<Term> {
        let values = self.channel(name).and(self.log.series(name))?;
        Some(Term { channels: vec![name.to_owned()], parts: vec![(values, order)], side: Side::Model })
    }

    /// A function of channels, sample by sample.
    pub fn of<const N: usize>(
        &self,
        names: [&str; N],
        order: usize,
        function: impl Fn([f64; N]) -> f64,
    ) -> Option<Term> {
        let mut channels = [&[][..]; N];
        for (slot, name) in channels.iter_mut().zip(names) {
            *slot = self.channel(name)?;
        }
        let values = (0..self.len()).map(|k| function(channels.map(|values| values[k]))).collect();
        let channels = names.iter().map(|name| (*name).to_owned()).collect();
        Some(Term { channels, parts: vec![(values, order)], side: Side::Model })
    }

    /// The mean of those of the channels that are there.
    pub fn mean(&self, names: &[&str], order: usize) -> Option<Term> {
        let there: Vec<&str> = names.iter().copied().filter(|name| self.channel(name).is_some()).collect();
        let mut sum = vec![0.0; self.len()];
        for name in &there {
            sum.iter_mut().zip(self.channel(name)?).for_each(|(sum, value)| *sum += value / there.len() as f64);
        }
        let channels: Vec<String> = there.iter().map(|name| (*name).to_owned()).collect();
        (!channels.is_empty()).then_some(Term { channels, parts: vec![(sum.into(), order)], side: Side::Model })
    }

    /// The product of two signals that are no derivatives, sample by sample.
    pub fn product(&self, one: &Term, other: Option<&Term>) -> Option<Term> {
        let other = other?;
        let sum = |term: &Term, k: usize| term.parts.iter().map(|(values, _)| values[k]).sum::<f64>();
        let values = (0..self.len()).map(|k| sum(one, k) * sum(other, k)).collect();
        let channels = one.channels.iter().chain(&other.channels).cloned().collect();
        Some(Term { channels, parts: vec![(values, 0)], side: Side::Model })
    }

    /// The smoothed slope of a signal, as a signal of its own that can be multiplied.
    pub fn slope(&self, term: &Term) -> Term {
        let values = super::window::slope(&term.parts, self.period).into();
        Term { channels: term.channels.clone(), parts: vec![(values, 0)], side: Side::Model }
    }
}
