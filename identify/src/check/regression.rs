//! Regressions between the signals of a relation at every lag.
//!
//! All signals pass the same symmetric window, which delays none; products of them are summed by block of the log and by lag, and
//! each block leaves its sums only. Of a long log one block after the other is in memory. The lag with the largest share of
//! explained variance is the delay, and its standard error is the jackknife's over the blocks.

use super::gram::Gram;
use super::relation::{CLEAR, Relation, Side, Term};
use super::window::{Filter, taps};
use super::{Signals, Subject};
use crate::log::Log;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// Largest delay that is looked for, s, and in samples at least.
const REACH: (f64, usize) = (0.6, 5);
/// Time between two lags, s.
const LAG: f64 = 0.01;
/// Blocks of a log: their number and their least length, s.
const BLOCKS: (usize, usize) = (8, 30);
const BLOCK: f64 = 4.0;
/// At most so many instants enter the sums, and none closer than a tenth of the window that all of them pass, s, unless a
/// block would have too few.
const INSTANTS: usize = 40_000;
const APART: f64 = 0.03;
const ENOUGH: usize = 40;
/// What the sums say.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Correlation of both sides at the best lag.
    pub correlation: f64,
    /// The same without a delay.
    pub correlation_now: f64,
    /// Ratio of their sizes.
    pub gain: f64,
    /// Its sign and size hold in every part of the log.
    pub steady: bool,
    /// Share of explained variance at the best lag.
    pub explained: f64,
    /// The same without a delay.
    pub explained_now: f64,
    /// How late the late ones are, s, and the standard error.
    pub delay: f64,
    /// Standard error of the delay, s.
    pub delay_std: f64,
}

/// What stands within `reach` of increasing numbers, as ranges that do not touch.
fn around(numbers: &[usize], reach: usize) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for number in numbers {
        let range = number - reach..number + reach + 1;
        match ranges.last_mut() {
            Some(last) if last.end >= range.start => last.end = range.end,
            _ => ranges.push(range),
        }
    }
    ranges
}

/// The sums over some instants for every lag of the late terms, from `-reach` to `reach`. At each instant all lags are
/// taken together: they stand side by side.
#[multiversion(targets("x86_64+avx+avx2"))]
fn by_lag(terms: &[&Term], values: &[Vec<f64>], instants: &[usize], reach: usize) -> Vec<Gram> {
    let (n, lags) = (terms.len(), 2 * reach + 1);
    let late = |i: usize| terms[i].side == Side::Late;
    // By term or pair of terms, and lag; what no lag changes stands at the first one.
    let mut sums = vec![vec![0.0; lags]; n];
    let mut products = vec![vec![0.0; lags]; n * n];
    for &k in instants {
        let shifted = |i: usize| &values[i][k - reach..=k + reach];
        for i in 0..n {
            if late(i) {
                sums[i].iter_mut().zip(shifted(i)).for_each(|(sum, a)| *sum += a);
            } else {
                sums[i][0] += values[i][k];
            }
            for j in 0..=i {
                let product = &mut products[i * n + j];
                match (late(i), late(j)) {
                    (true, true) => {
                        let pairs = shifted(i).iter().zip(shifted(j));
                        product.iter_mut().zip(pairs).for_each(|(sum, (a, b))| *sum += a * b);
                    }
                    (true, false) => add_scaled(product, shifted(i), values[j][k]),
                    (false, true) => add_scaled(product, shifted(j), values[i][k]),
                    (false, false) => product[0] += values[i][k] * values[j][k],
                }
            }
        }
    }
    let of_lag = |lag: usize| {
        let mut gram = Gram::new(n);
        gram.count = instants.len() as f64;
        for i in 0..n {
            gram.sums[i] = sums[i][if late(i) { lag } else { 0 }];
            for j in 0..=i {
                gram.products[i * n + j] = products[i * n + j][if late(i) || late(j) { lag } else { 0 }];
            }
        }
        gram
    };
    (0..lags).map(of_lag).collect()
}

fn add_scaled(to: &mut [f64], values: &[f64], factor: f64) {
    to.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * factor);
}

/// How the values of a log's signals are taken into sums.
#[derive(Clone, Copy, Debug)]
struct Grid {
    /// Samples and time, s, from one value to the next.
    stride: usize,
    step: f64,
    /// Values that lags reach to both sides.
    reach: usize,
    /// Blocks, and the values of each of them.
    blocks: usize,
    block: usize,
    /// Values from one instant to the next.
    every: usize,
}

impl Grid {
    /// For signals of so many samples, of which windows take some.
    fn new(samples: usize, taken: usize, period: f64) -> Option<Self> {
        if !(period.is_finite() && period > 0.0) {
            return None;
        }
        let stride = ((LAG / period).round() as usize).max(1);
        let step = period * stride as f64;
        let count = samples.saturating_sub(taken).div_ceil(stride);
        let reach = ((REACH.0 / step).round() as usize).max(REACH.1);
        let blocks = ((count as f64 * step / BLOCK) as usize).clamp(BLOCKS.0, BLOCKS.1);
        let block = count / blocks;
        let apart = ((APART / step).round() as usize).min(block / ENOUGH);
        let every = count.div_ceil(INSTANTS).max(apart).max(1);
        (block >= 4).then_some(Self { stride, step, reach, blocks, block, every })
    }
}

/// The signals of a relation through their windows.
struct Filtered<'a> {
    terms: Vec<&'a Term>,
    filters: Vec<Filter<'a>>,
    /// Values that lags reach to both sides, by term.
    reaches: Vec<usize>,
    constant: bool,
    /// The values of a block, and as many before and after it as lags reach; only those that instants need are filled.
    values: Vec<Vec<f64>>,
}

impl<'a> Filtered<'a> {
    fn new(relation: &'a Relation, period: f64, grid: &Grid) -> Self {
        let terms: Vec<&Term> = relation.x.iter().chain([&relation.y]).collect();
        let filters = terms.iter().map(|term| Filter::new(&term.parts, period, grid.stride)).collect();
        let reaches = terms.iter().map(|term| if term.side == Side::Late { grid.reach } else { 0 }).collect();
        Self { values: vec![Vec::new(); terms.len()], terms, filters, reaches, constant: relation.constant }
    }

    fn len(&self) -> usize {
        self.filters[0].len()
    }

    fn farthest(&self) -> usize {
        self.reaches.iter().copied().max().unwrap_or(0)
    }

    /// The sums over a block of values by lag.
    fn sums(&mut self, block: Range<usize>, grid: &Grid) -> Vec<Gram> {
        let farthest = self.farthest();
        self.values.iter_mut().for_each(|values| values.resize(block.len() + 2 * farthest, f64::NAN));
        let first = block.start.saturating_sub(farthest);
        let inside = farthest..self.len().saturating_sub(farthest);
        let mut instants: Vec<usize> = block.step_by(grid.every).filter(|k| inside.contains(k)).collect();
        for ((filter, values), reach) in self.filters.iter().zip(&mut self.values).zip(&self.reaches) {
            for range in around(&instants, *reach) {
                filter.fill(range.start, &mut values[range.start - first..range.end - first]);
            }
        }
        instants.iter_mut().for_each(|k| *k -= first);
        let there = |k: usize| {
            self.values.iter().zip(&self.reaches).all(|(values, reach)| {
                // To count them all is faster than to stop at the first.
                values[k - reach..=k + reach].iter().filter(|value| !value.is_finite()).count() == 0
            })
        };
        instants.retain(|k| there(*k));
        let grams = by_lag(&self.terms, &self.values, &instants, grid.reach).into_iter();
        grams.map(|gram| if self.constant { gram.centred() } else { gram }).collect()
    }
}

/// Works a relation out on a log.
pub fn answer(signals: &Signals, relation: &Relation) -> Option<Answer> {
    let grid = Grid::new(signals.len() + 1, taps(signals.period), signals.period)?;
    let mut filtered = Filtered::new(relation, signals.period, &grid);
    let block = |b: usize| b * grid.block..(b + 1) * grid.block;
    let sums = (0..grid.blocks).map(|b| filtered.sums(block(b), &grid)).collect();
    concluded(sums, &grid)
}

/// What a relation says of a long log, from the sums over its blocks.
struct Summed {
    /// The relation without its samples.
    relation: Relation,
    sums: Vec<Vec<Gram>>,
}

/// Works all relations out on a long log, one block after the other in memory. Relations with channels of `spoilt` say nothing.
pub fn answers_by_blocks(subject: &Subject, log: &Log, spoilt: &[String]) -> Vec<(Relation, Answer)> {
    // Steps are even within a block, so that the usual one of some of them will do.
    let period = log.slice(0..log.len() / BLOCKS.1, |_| false).period();
    let Some(grid) = Grid::new(log.len() + 1, taps(period), period) else { return Vec::new() };
    let margin = grid.reach * grid.stride + taps(period) / 2;
    let mut all: Vec<Summed> = Vec::new();
    for b in 0..grid.blocks {
        let (from, to) = (b * grid.block * grid.stride, (b + 1) * grid.block * grid.stride);
        let range = from.saturating_sub(margin)..(to + margin).min(log.len());
        let signals = Signals::new(subject, &log.slice(range, |_| true));
        let relations: Vec<Relation> = (subject.checks.relations)(&signals);
        let sums = |relation: &Relation| {
            let mut filtered = Filtered::new(relation, signals.period, &grid);
            let far = filtered.farthest();
            let block = far..filtered.len().saturating_sub(far).max(far);
            filtered.sums(block, &grid)
        };
        let there: Vec<_> = relations.par_iter().filter(|r| !r.is_spoilt(spoilt)).map(|r| (r, sums(r))).collect();
        for (relation, sums) in there {
            match all.iter_mut().find(|summed| summed.relation.is_like(relation)) {
                Some(summed) => summed.sums.push(sums),
                None => all.push(Summed { relation: relation.without_samples(), sums: vec![sums] }),
            }
        }
    }
    all.into_iter().filter_map(|summed| Some((summed.relation, concluded(summed.sums, &grid)?))).collect()
}

/// What the sums over the blocks of a log say.
fn concluded(mut sums: Vec<Vec<Gram>>, grid: &Grid) -> Option<Answer> {
    let Grid { step, reach, .. } = *grid;
    let lags = 2 * reach + 1;
    let n = sums.first()?[0].n;
    sums.retain(|block| block[0].count >= 4.0);
    if sums.len() < BLOCKS.0 / 2 {
        return None;
    }
    let mut total: Vec<Gram> = (0..lags).map(|_| Gram::new(n)).collect();
    sums.iter().for_each(|block| total.iter_mut().zip(block).for_each(|(sum, gram)| sum.add(gram, 1.0)));
    let mut room = Gram::new(n);
    let mut shares = Vec::with_capacity(lags);
    let mut best = |all: &[Gram]| {
        shares.clear();
        shares.extend(all.iter().map(|gram| gram.explained(&mut room)));
        let (top, share) = shares.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let inside = top > 0 && top + 1 < lags;
        let shift = if inside {
            let (before, after) = (shares[top - 1], shares[top + 1]);
            let curve = before - 2.0 * share + after;
            if curve < 0.0 { (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { 0.0 }
        } else {
            0.0
        };
        Some((top, share, (top as f64 + shift - reach as f64) * step, inside))
    };
    let (top, explained, delay, inside) = best(&total)?;
    let (correlation, gain) = total[top].first();
    // Jackknife: all blocks but one.
    let mut delays = Vec::with_capacity(sums.len());
    let mut steady = true;
    let mut rest = total.clone();
    for out in &sums {
        rest.iter_mut().zip(&total).zip(out).for_each(|((rest, sum), out)| rest.assign_difference(sum, out));
        let (_, _, delay, _) = best(&rest)?;
        delays.push(delay);
        let (other, size) = rest[top].first();
        steady &= other * correlation > 0.0 && other.abs() > 0.5 * CLEAR && (0.5..2.0).contains(&(size / gain));
    }
    let k = delays.len() as f64;
    let mean = delays.iter().sum::<f64>() / k;
    let variance = delays.iter().map(|delay| (delay - mean).powi(2)).sum::<f64>() * (k - 1.0) / k;
    // Lags are found on a grid: no delay is known better than a part of its step.
    let delay_std = if inside { variance.sqrt().max(0.05 * step) } else { f64::INFINITY };
    let explained_now = total[reach].explained(&mut Gram::new(n));
    let (correlation_now, _) = total[reach].first();
    Some(Answer { correlation, correlation_now, gain, steady, explained, explained_now, delay, delay_std })
}
/// Works all relations out on a log. Relations with channels of `spoilt`, known to be bad, say nothing.
pub fn answers(signals: &Signals, relations: Vec<Relation>, spoilt: &[String]) -> Vec<(Relation, Answer)> {
    let relations = relations.into_par_iter().filter(|relation| !relation.is_spoilt(spoilt));
    relations.filter_map(|relation| answer(signals, &relation).map(|answer| (relation, answer))).collect()
}
