//! What a run is worth, in words.

use super::chi_square::chi_square_quantile;
use super::{Run, Sampling};
use crate::log::Log;
use serde::Serialize;
use std::collections::BTreeMap;
use wheelstate::Status;

/// What can be said of a run without looking at it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Assessment {
    /// What the user must know before using the estimates; not empty means exit code 1.
    pub warnings: Vec<String>,
    /// What is good to know.
    pub notes: Vec<String>,
    /// Share of the rows with samples that are healthy, 0 to 1.
    pub healthy: f64,
    /// Mean of the normalised innovation squared per channel; 1 if noise and model fit.
    pub nis: f64,
    /// Share of the samples whose NIS lies within the 95 % interval of its chi-square distribution, 0 to 1.
    pub nis_within: f64,
    /// When the measurements contradicted the model.
    pub contradicted: Vec<Span>,
    /// Longest time between two rows of the log, s.
    pub largest_gap: f64,
    /// The filter's channels.
    pub channels: Vec<ChannelFit>,
    /// Estimates against the `true_*` columns of the log, where it has them.
    pub truth: Vec<Truth>,
}

/// A time during which the measurements contradicted the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Span {
    /// Begin, s.
    pub from: f64,
    /// End, s.
    pub to: f64,
    /// The channels with the largest innovations in it, the worst first.
    pub channels: Vec<&'static str>,
}

/// How a channel was predicted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelFit {
    /// The channel.
    pub name: &'static str,
    /// Share of the rows without a sample, 0 to 1.
    pub missing: f64,
    /// Mean innovation in its standard deviations; 0 without an offset.
    pub mean: f64,
    /// Root mean square of the innovation in its standard deviations; 1 if noise and model fit.
    pub rms: f64,
    /// Share of the innovations within two standard deviations, 0 to 1.
    pub within: f64,
}

/// An estimate against a truth that is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// The estimate.
    pub name: String,
    /// Root mean square error of all rows.
    pub rmse: f64,
    /// Share of the healthy rows within two standard deviations, 0 to 1; NaN without a healthy row.
    pub within: f64,
    /// Share of the healthy rows beyond three.
    pub beyond: f64,
    /// Root mean square error of the smoothed estimates, NaN without any.
    pub rmse_smoothed: f64,
    /// Share of the healthy rows whose smoothed estimate is within two of its standard deviations.
    pub within_smoothed: f64,
}

/// Warnings or notes.
pub type Remark = String;

/// NIS per channel beyond which a ride as a whole is called overconfident: the innovations are a fifth larger than their
/// standard deviations say.
const OVERCONFIDENT: f64 = 1.5;
/// Below this it is called cautious.
const CAUTIOUS: f64 = 0.5;
/// Share of a channel's innovations within two standard deviations below which it is named.
const FEW: f64 = 0.85;
/// Mean of a channel's innovations, in standard deviations, that is called an offset.
const OFFSET: f64 = 0.5;
/// Share of the samples without a channel that is worth a note.
const MISSING: f64 = 0.01;
/// A step of more than so many periods is a gap.
const GAP: f64 = 1.5;
/// The monitor needs this long to see a contradiction, s: the channels of that time are named.
const BEFORE: f64 = 2.0;
/// Spans of a contradiction that are told one by one.
const TOLD: usize = 5;

/// The 95 % interval of the normalised innovation squared per channel, for a number of channels.
pub fn nis_bounds(channels: usize) -> (f64, f64) {
    let n = channels.max(1);
    (chi_square_quantile(0.025, n) / n as f64, chi_square_quantile(0.975, n) / n as f64)
}

/// Judges a run of a log.
pub fn assess(run: &Run, log: &Log) -> Assessment {
    let column = |name: &str| run.column(name).unwrap_or(&[]);
    let (nis, count) = (column("nis"), column("nis_channels"));
    let (healthy, status) = (column("healthy"), column("status"));
    // Before the first sample nothing is estimated.
    let first = usize::from(run.sampling == Sampling::AsFmu);
    let rows = first..run.time.len();
    let mut all = Assessment {
        healthy: share(rows.clone().map(|k| healthy.get(k).is_some_and(|h| *h != 0.0))),
        largest_gap: log.time.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max),
        ..Assessment::default()
    };
    let mut bounds = BTreeMap::new();
    let (mut sum, mut channels) = (0.0, 0.0);
    let within = rows.clone().filter(|&k| count.get(k).is_some_and(|n| *n > 0.0)).map(|k| {
        sum += nis[k] * count[k];
        channels += count[k];
        let (low, high) = *bounds.entry(count[k] as usize).or_insert_with(|| nis_bounds(count[k] as usize));
        (low..=high).contains(&nis[k])
    });
    all.nis_within = share(within);
    all.nis = sum / channels;
    all.channels = run.channels.iter().filter_map(|name| channel(run, name, rows.clone())).collect();
    all.contradicted = spans(run, status);
    all.truth = truths(run, log, healthy);
    words(&mut all, run, log);
    all
}

/// Share of what is true; NaN of nothing.
fn share(values: impl Iterator<Item = bool>) -> f64 {
    let (yes, all) = values.fold((0.0, 0.0), |(yes, all), value| (yes + f64::from(u8::from(value)), all + 1.0));
    yes / all
}

/// Innovations of a channel in their standard deviations, NaN without a sample.
fn normalised(run: &Run, name: &str) -> Option<Vec<f64>> {
    let innovation = run.column(&format!("innovation_{name}"))?;
    let std = run.column(&format!("innovation_{name}_std"))?;
    Some(innovation.iter().zip(std).map(|(innovation, std)| innovation / std).collect())
}

fn channel(run: &Run, name: &'static str, rows: std::ops::Range<usize>) -> Option<ChannelFit> {
    let all = normalised(run, name)?;
    let there: Vec<f64> = all.get(rows.clone())?.iter().copied().filter(|value| value.is_finite()).collect();
    let count = there.len() as f64;
    Some(ChannelFit {
        name,
        missing: 1.0 - count / rows.len() as f64,
        mean: there.iter().sum::<f64>() / count,
        rms: (there.iter().map(|value| value * value).sum::<f64>() / count).sqrt(),
        within: share(there.iter().map(|value| value.abs() <= 2.0)),
    })
}

/// When the measurements contradicted the model, and which channels.
fn spans(run: &Run, status: &[f64]) -> Vec<Span> {
    let contradicted: Vec<bool> =
        status.iter().map(|status| *status as u32 & Status::CONTRADICTED.bits() != 0).collect();
    let normalised: Vec<_> = run.channels.iter().filter_map(|name| Some((*name, normalised(run, name)?))).collect();
    let mut spans = Vec::new();
    let mut k = 0;
    while k < contradicted.len() {
        if !contradicted[k] {
            k += 1;
            continue;
        }
        let end = contradicted[k..].iter().position(|c| !c).map_or(contradicted.len(), |n| k + n) - 1;
        let from = run.time[..k].partition_point(|time| *time < run.time[k] - BEFORE);
        let mut channels: Vec<(&str, f64)> = normalised
            .iter()
            .map(|(name, values)| {
                let there = values[from..=end].iter().filter(|value| value.is_finite());
                let (sum, n) = there.fold((0.0, 0.0), |(sum, n), value| (sum + value * value, n + 1.0));
                (*name, if n > 0.0 { sum / n } else { 0.0 })
            })
            .filter(|(_, square)| *square > 2.0)
            .collect();
        channels.sort_by(|a, b| b.1.total_cmp(&a.1));
        // What is much smaller than the worst follows it.
        let worst = channels.first().map_or(0.0, |(_, square)| *square);
        let channels = channels.into_iter().filter(|(_, square)| *square > 0.25 * worst).map(|(name, _)| name);
        spans.push(Span { from: run.time[k], to: run.time[end], channels: channels.collect() });
        k = end + 1;
    }
    spans
}

/// Estimates against the log's `true_*` columns; their rows are the log's, the last one of a host apart.
fn truths(run: &Run, log: &Log, healthy: &[f64]) -> Vec<Truth> {
    let known = |column: &super::Column| {
        let name = &column.variable.name;
        let truth = log.channel(&format!("true_{name}"))?;
        let std = run.column(&format!("{name}_std"))?;
        let judge = |values: &[f64], std: &[f64]| {
            let errors: Vec<(f64, f64, bool)> = (0..truth.len().min(values.len()))
                .map(|k| (values[k] - truth[k], std[k], healthy[k] != 0.0))
                .filter(|(error, ..)| error.is_finite())
                .collect();
            let mean = errors.iter().map(|(error, ..)| error * error).sum::<f64>() / errors.len() as f64;
            let sure = || errors.iter().filter(|(_, _, healthy)| *healthy);
            let within = |most: f64| share(sure().map(|(error, std, _)| error.abs() <= most * std));
            (mean.sqrt(), within(2.0), 1.0 - within(3.0))
        };
        let (rmse, within, beyond) = judge(&column.values, std);
        let smoothed = run.column(&format!("{name}_smoothed")).zip(run.column(&format!("{name}_smoothed_std")));
        let (rmse_smoothed, within_smoothed, _) =
            smoothed.map_or((f64::NAN, f64::NAN, f64::NAN), |(values, std)| judge(values, std));
        let name = name.clone();
        rmse.is_finite().then_some(Truth { name, rmse, within, beyond, rmse_smoothed, within_smoothed })
    };
    run.columns.iter().filter_map(known).collect()
}

/// `12.3 s to 14.0 s`
fn span(from: f64, to: f64) -> String {
    format!("{from:.1} s to {to:.1} s")
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn words(all: &mut Assessment, run: &Run, log: &Log) {
    let mut warnings = Vec::new();
    let mut notes = run.notes.clone();
    let factor = all.nis.sqrt();
    if all.nis > OVERCONFIDENT {
        warnings.push(format!(
            "overconfident: the innovations are {factor:.1} times as large as the filter expects (NIS {:.1} per channel, \
             1 would fit), so the standard deviations are too small; noise settings (identify tune) or parameters \
             (identify fit) are wrong",
            all.nis
        ));
    } else if all.nis < CAUTIOUS {
        notes.push(format!(
            "cautious: the innovations are only {factor:.1} times as large as the filter expects (NIS {:.2} per channel); \
             less noise in the settings would make it quicker (identify tune)",
            all.nis
        ));
    }
    if all.nis.is_nan() {
        notes.push("no sample has an innovation: nothing shows whether model and noise fit".to_owned());
    }
    let time = all.contradicted.iter().fold(0.0, |time, span| time + span.to - span.from);
    for Span { from, to, channels } in all.contradicted.iter().take(TOLD) {
        let which = if channels.is_empty() { String::new() } else { format!(": {}", channels.join(", ")) };
        warnings.push(format!("contradicted from {}{which}", span(*from, *to)));
    }
    if all.contradicted.len() > TOLD {
        let (more, count) = (all.contradicted.len() - TOLD, all.contradicted.len());
        warnings.push(format!("contradicted {more} more times; {count} times, {time:.1} s in all"));
    }
    for channel in &all.channels {
        let ChannelFit { name, missing, mean, within, .. } = channel;
        if *missing >= 1.0 {
            notes.push(format!("{name}: no sample"));
            continue;
        }
        if *missing > MISSING {
            notes.push(format!("{name}: no sample in {} of the rows", percent(*missing)));
        }
        if *within < FEW {
            warnings.push(format!(
                "{name}: {} of its innovations are within two standard deviations, 95 % are expected",
                percent(*within)
            ));
        }
        if mean.abs() > OFFSET {
            let side = if *mean > 0.0 { "more" } else { "less" };
            warnings.push(format!(
                "{name} measures {side} than predicted, by {:.1} standard deviations on average: an offset, or a wrong \
                 parameter",
                mean.abs()
            ));
        }
    }
    for Truth { name, within, beyond, .. } in &all.truth {
        if *within < FEW {
            warnings.push(format!(
                "overconfident: {name} is within two standard deviations of true_{name} in {} of the healthy time and \
                 beyond three in {}",
                percent(*within),
                percent(*beyond)
            ));
        }
    }
    gaps(run, log, &mut warnings, &mut notes);
    if all.healthy == 0.0 {
        warnings.push("the estimates are never healthy".to_owned());
    }
    (all.warnings, all.notes) = (warnings, notes);
}

/// Steps that are too long, and rows that count more than once or not at all.
fn gaps(run: &Run, log: &Log, warnings: &mut Vec<Remark>, notes: &mut Vec<Remark>) {
    let period = log.period();
    let gaps: Vec<_> = log.time.windows(2).filter(|pair| pair[1] - pair[0] > GAP * period).collect();
    let Some(longest) = gaps.iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))) else { return };
    let (count, length) = (gaps.len(), longest[1] - longest[0]);
    let text = format!(
        "{count} gap{} in the log, the longest from {} ({length:.2} s)",
        if count == 1 { "" } else { "s" },
        span(longest[0], longest[1])
    );
    if run.sampling == Sampling::AsFmu {
        warnings.push(format!(
            "{text}: as in a host the last row holds meanwhile and counts again and again; --clock log takes gaps for gaps"
        ));
    } else {
        notes.push(text);
    }
}
