//! The result as a page: one file, plots inline, no scripts, no network.

use super::plot::{self, PlotError};
use super::table::{self, significant};
use crate::result::{FitReport, Trace};
use askama::Template;
use std::ops::Range;

/// Predicted signals that are drawn at most.
const DRAWN: usize = 12;
/// Samples in the enlarged part of a long signal.
const PART: usize = 800;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum HtmlError {
    /// A plot could not be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// The page could not be put together.
    #[error("the report page: {0}")]
    Page(#[from] askama::Error),
}

#[derive(Template)]
#[template(path = "page.html")]
struct Page<'a> {
    report: &'a FitReport,
    vehicle: &'a str,
    summary: String,
    rows: Vec<ParameterRow>,
    intervals: Option<String>,
    profiles: Vec<String>,
    correlation: String,
    condition: String,
    held_out: String,
    signals: Vec<SignalRow>,
    traces: Vec<TracePlots>,
    left_out: usize,
}

struct ParameterRow {
    name: String,
    value: String,
    unit: String,
    interval: String,
    noise: String,
    t: String,
    truth: String,
    verdict: &'static str,
    class: String,
}

struct SignalRow {
    name: String,
    fit: String,
    training: String,
    rmse: String,
    samples: usize,
    correlation: String,
}

struct TracePlots {
    title: String,
    signal: String,
    /// A part of a long signal, large enough to see its shape.
    part: Option<String>,
    histogram: String,
    autocorrelation: String,
}

/// The page's text.
pub fn html(report: &FitReport) -> Result<String, HtmlError> {
    let rows = report.parameters.iter().map(|(name, parameter)| {
        let [name, value, unit, interval, noise, t, truth, _] =
            table::row(name, parameter, report.references.get(name));
        let verdict = parameter.verdict.words();
        ParameterRow { name, value, unit, interval, noise, t, truth, verdict, class: verdict.replace(' ', "-") }
    });
    let percent = |value: f64| if value.is_finite() { format!("{value:.1} %") } else { "-".to_owned() };
    let signals = report.validation.signals.iter().map(|signal| SignalRow {
        name: signal.name.clone(),
        fit: percent(signal.fit_percent),
        training: percent(signal.fit_percent_training),
        rmse: format!("{} {}", significant(signal.rmse, 3), if signal.unit == "1" { "" } else { &signal.unit }),
        samples: signal.samples,
        correlation: significant(signal.residual_correlation, 2),
    });
    let profiles: Result<Vec<_>, PlotError> = report
        .profiles
        .iter()
        .map(|of| plot::profile(of, report.parameters.get(&of.parameter).map_or("1", |p| &p.unit)))
        .collect();
    let drawn = order(&report.traces);
    let left_out = drawn.len().saturating_sub(DRAWN);
    let traces: Result<Vec<_>, PlotError> = drawn.into_iter().take(DRAWN).map(draw).collect();
    let page = Page {
        vehicle: &report.vehicle,
        summary: table::summary(report),
        rows: rows.collect(),
        intervals: plot::intervals(report)?,
        profiles: profiles?,
        correlation: report.correlation_worst_pair.as_ref().map_or(String::new(), |p| format!("{:+.3}", p.correlation)),
        condition: significant(report.condition_number, 3),
        held_out: format!("{:.0}", 100.0 * report.validation.held_out),
        signals: signals.collect(),
        traces: traces?,
        left_out,
        report,
    };
    Ok(page.render()?)
}

/// One trace of every signal first, so that many logs do not hide a signal.
fn order(traces: &[Trace]) -> Vec<&Trace> {
    let first = |index: usize| !traces[..index].iter().any(|other| other.name == traces[index].name);
    let mut indices: Vec<usize> = (0..traces.len()).collect();
    indices.sort_by_key(|index| !first(*index));
    indices.into_iter().map(|index| &traces[index]).filter(|trace| trace.time.len() > 1).collect()
}

/// The stretch of a long trace in which the measured signal moves most.
fn liveliest(trace: &Trace) -> Option<Range<usize>> {
    if trace.time.len() < 4 * PART {
        return None;
    }
    let power = |part: &Range<usize>| {
        let values = || trace.measured[part.clone()].iter().copied().filter(|value| value.is_finite());
        let count = values().count();
        if count < PART / 2 {
            return f64::NEG_INFINITY;
        }
        let mean = values().sum::<f64>() / count as f64;
        values().map(|value| (value - mean).powi(2)).sum::<f64>() / count as f64
    };
    let parts = (0..trace.time.len() / PART).map(|k| k * PART..(k + 1) * PART);
    parts.max_by(|a, b| power(a).total_cmp(&power(b)))
}

fn draw(trace: &Trace) -> Result<TracePlots, PlotError> {
    let residual: Vec<f64> = trace.measured.iter().zip(&trace.predicted).map(|(m, p)| m - p).collect();
    Ok(TracePlots {
        title: format!("{}, {}", trace.name, trace.log),
        signal: plot::signal(trace, 0..trace.time.len())?,
        part: liveliest(trace).map(|part| plot::signal(trace, part)).transpose()?,
        histogram: plot::histogram(&residual, &trace.unit)?,
        autocorrelation: plot::autocorrelation(&residual)?,
    })
}
