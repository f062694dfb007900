//! A run as a page: verdicts, status, NIS, estimates, measured beside predicted, innovations. One file, no network; the
//! plots show without a script, which only zooms them and reads them off.

use super::chart::{Axis, Band, Line, Plot, number};
use super::html::HtmlError;
use super::table::significant;
use crate::log::Log;
use crate::run::{Assessment, Run, Sampling, nis_bounds};
use askama::Template;
use std::collections::BTreeMap;
use wheelstate::variable::Kind;
use wheelstate::{Status, Variable};

#[derive(Template)]
#[template(path = "run.html")]
struct Page<'a> {
    run: &'a Run,
    all: &'a Assessment,
    lead: String,
    facts: Vec<(&'static str, String)>,
    channels: Vec<[String; 5]>,
    truth: Vec<[String; 6]>,
    smoothed: bool,
    status: String,
    nis: String,
    estimates: Vec<String>,
    measured: Vec<String>,
    innovations: Vec<String>,
    others: Vec<String>,
    first: f64,
    last: f64,
}

/// The page's text.
pub fn run(run: &Run, log: &Log, all: &Assessment) -> Result<String, HtmlError> {
    let axis = Axis::new(shown(run, &run.time));
    let (first, last) = axis.ends();
    let percent = |share: f64| if share.is_finite() { format!("{:.1} %", 100.0 * share) } else { "-".to_owned() };
    let contradicted = all.contradicted.iter().fold(0.0, |time, span| time + span.to - span.from);
    let facts = vec![
        ("healthy", percent(all.healthy)),
        ("NIS per channel, 1 would fit", significant(all.nis, 3)),
        ("NIS within its 95 % bounds", percent(all.nis_within)),
        ("contradicted", format!("{contradicted:.1} s")),
        ("longest time between two rows", format!("{} s", number((all.largest_gap * 1e6).round() / 1e6))),
        ("sample period", format!("{} s", number(run.sample_period))),
    ];
    let channels = all.channels.iter().map(|channel| {
        [
            channel.name.to_owned(),
            percent(channel.missing),
            percent(channel.within),
            significant(channel.rms, 3),
            significant(channel.mean, 2),
        ]
    });
    let truth = all.truth.iter().map(|truth| {
        [
            truth.name.clone(),
            significant(truth.rmse, 3),
            percent(truth.within),
            percent(truth.beyond),
            significant(truth.rmse_smoothed, 3),
            percent(truth.within_smoothed),
        ]
    });
    let sampled = match run.sampling {
        Sampling::AsFmu => "sampled as the FMU in a host; estimates from the samples before each time",
        Sampling::EveryRow => "every row a sample; estimates after it",
    };
    let page = Page {
        lead: format!("{}, {:.1} s, {} rows; {sampled}.", run.source, last - first, run.time.len()),
        facts,
        channels: channels.collect(),
        truth: truth.collect(),
        smoothed: run.column("smoothed").is_some(),
        status: status(run, &axis),
        nis: nis(run, &axis),
        estimates: estimates(run, log, &axis),
        measured: measured(run, &axis),
        innovations: innovations(run, &axis),
        others: others(run, &axis),
        first,
        last,
        run,
        all,
    };
    Ok(page.render()?)
}

/// The rows that are drawn: in a host the first one is from before the first sample, and only what was known before.
fn shown<'a>(run: &Run, values: &'a [f64]) -> &'a [f64] {
    values.get(usize::from(run.sampling == Sampling::AsFmu)..).unwrap_or(&[])
}

/// The drawn rows of a column.
fn column<'a>(run: &'a Run, name: &str) -> Option<&'a [f64]> {
    run.column(name).map(|values| shown(run, values))
}

/// Every condition that ever held, and `healthy`.
fn status(run: &Run, axis: &Axis) -> String {
    let column = |name: &str| column(run, name).unwrap_or(&[]);
    let mut rows = vec![("healthy", "good", column("healthy").iter().map(|value| *value != 0.0).collect())];
    for (bit, word, _) in Status::ALL {
        let holds: Vec<bool> = column("status").iter().map(|status| *status as u32 >> bit & 1 == 1).collect();
        if holds.contains(&true) {
            let class = if *word == "contradicted" { "bad" } else { "some" };
            rows.push((word, class, holds));
        }
    }
    axis.timeline("status", &rows)
}

/// NIS per channel in decades, with the 95 % bounds of its chi-square distribution.
fn nis(run: &Run, axis: &Axis) -> String {
    let (Some(nis), Some(count)) = (column(run, "nis"), column(run, "nis_channels")) else { return String::new() };
    if count.iter().all(|count| *count == 0.0) {
        return String::new();
    }
    let mut known = BTreeMap::new();
    let bounds: Vec<(f64, f64)> = count
        .iter()
        .map(|count| match *count as usize {
            0 => (f64::NAN, f64::NAN),
            n => *known.entry(n).or_insert_with(|| nis_bounds(n)),
        })
        .collect();
    // Less than a thousandth tells no more than a thousandth.
    let decades = |value: f64| value.max(1e-3).log10();
    let values: Vec<f64> =
        nis.iter().zip(count).map(|(nis, count)| if *count > 0.0 { decades(*nis) } else { f64::NAN }).collect();
    let band = Band {
        class: "bounds",
        low: bounds.iter().map(|(low, _)| if low.is_nan() { f64::NAN } else { decades(*low) }).collect(),
        high: bounds.iter().map(|(_, high)| if high.is_nan() { f64::NAN } else { decades(*high) }).collect(),
    };
    let lines = vec![Line { name: "NIS per channel", class: "estimate", values: &values }];
    axis.plot(&Plot { title: "NIS per channel".to_owned(), unit: "1", lines, bands: vec![band], logarithmic: true })
}

/// Estimates with two standard deviations, smoothed ones and the truth, where there are any.
fn estimates(run: &Run, log: &Log, axis: &Axis) -> Vec<String> {
    let mut plots = Vec::new();
    for one in &run.columns {
        let name = &one.variable.name;
        let Some(std) = column(run, &format!("{name}_std")) else { continue };
        let values = shown(run, &one.values);
        let still = values.iter().zip(std).all(|(value, std)| *value == 0.0 && *std == 0.0);
        if still || name.starts_with("innovation_") || name.ends_with("_smoothed") {
            continue;
        }
        let mut bands = vec![Band::about("spread", values, std)];
        let mut lines = vec![Line { name: "estimate", class: "estimate", values }];
        let smoothed = column(run, &format!("{name}_smoothed")).zip(column(run, &format!("{name}_smoothed_std")));
        if let Some((values, std)) = smoothed {
            bands.push(Band::about("spread smooth", values, std));
            lines.push(Line { name: "smoothed", class: "smoothed", values });
        }
        // A truth has the log's rows; a run may have one more.
        let truth = log.channel(&format!("true_{name}")).map(|truth| {
            let mut truth = truth.to_vec();
            truth.resize(run.time.len(), f64::NAN);
            shown(run, &truth).to_vec()
        });
        if let Some(truth) = &truth {
            lines.push(Line { name: "truth", class: "truth", values: truth });
        }
        plots.push(panel(
            axis,
            &one.variable,
            Plot { title: name.clone(), unit: one.variable.unit, lines, bands, logarithmic: false },
        ));
    }
    plots
}

/// Channels with their predictions.
fn measured(run: &Run, axis: &Axis) -> Vec<String> {
    each_channel(run, |name, variable, measured, innovation, _| {
        let predicted: Vec<f64> = measured.iter().zip(innovation).map(|(measured, i)| measured - i).collect();
        let lines = vec![
            Line { name: "measured", class: "measured", values: measured },
            Line { name: "predicted", class: "estimate", values: &predicted },
        ];
        let (title, unit) = (name.to_owned(), variable.unit);
        panel(axis, variable, Plot { title, unit, lines, bands: Vec::new(), logarithmic: false })
    })
}

/// Innovations with two of their standard deviations.
fn innovations(run: &Run, axis: &Axis) -> Vec<String> {
    each_channel(run, |name, variable, _, innovation, std| {
        let zero: Vec<f64> = std.iter().map(|std| std * 0.0).collect();
        let bands = vec![Band::about("bounds", &zero, std)];
        let lines = vec![Line { name: "innovation", class: "estimate", values: innovation }];
        let (title, unit) = (format!("innovation of {name}"), variable.unit);
        panel(axis, variable, Plot { title, unit, lines, bands, logarithmic: false })
    })
}

fn each_channel(run: &Run, plot: impl Fn(&str, &Variable, &[f64], &[f64], &[f64]) -> String) -> Vec<String> {
    let one = |name: &&'static str| {
        let innovation = run.columns.iter().find(|column| column.variable.name == format!("innovation_{name}"))?;
        let (measured, std) =
            (column(run, &format!("measured_{name}"))?, column(run, &format!("innovation_{name}_std"))?);
        let values = shown(run, &innovation.values);
        let any = values.iter().any(|value| value.is_finite());
        any.then(|| plot(name, &innovation.variable, measured, values, std))
    };
    run.channels.iter().filter_map(one).collect()
}

/// Numbers without a standard deviation, as far as they move.
fn others(run: &Run, axis: &Axis) -> Vec<String> {
    let told = ["nis", "log_likelihood", "smoothed"];
    let mut plots = Vec::new();
    for one in &run.columns {
        let Variable { name, kind, unit, .. } = &one.variable;
        let values = shown(run, &one.values);
        let has_std = column(run, &format!("{name}_std")).is_some();
        let moves = values.iter().any(|value| *value != values[0]);
        let of_run = name.ends_with("_std") || name.ends_with("_smoothed") || name.starts_with("measured_");
        if *kind != Kind::Real || has_std || of_run || !moves || told.contains(&name.as_str()) {
            continue;
        }
        let lines = vec![Line { name, class: "estimate", values }];
        let plot = Plot { title: name.clone(), unit, lines, bands: Vec::new(), logarithmic: false };
        plots.push(panel(axis, &one.variable, plot));
    }
    plots
}

/// A plot with its heading and legend.
fn panel(axis: &Axis, variable: &Variable, plot: Plot) -> String {
    let unit = if plot.unit == "1" { String::new() } else { format!(", {}", plot.unit) };
    let legend: String =
        plot.lines.iter().map(|line| format!(r#" <span class="key {}">{}</span>"#, line.class, line.name)).collect();
    let legend = if plot.lines.len() > 1 { legend } else { String::new() };
    let about = variable.description.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
    format!(
        r#"<figure><figcaption><span title="{about}"><b>{}</b>{unit}</span>{legend} <output></output></figcaption>
{}</figure>"#,
        plot.title,
        axis.plot(&plot)
    )
}
