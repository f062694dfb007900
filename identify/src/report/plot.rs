//! The plots of the report page, as SVG text.

use crate::result::{FitReport, Profile, Trace, Verdict};
use crate::solve::profile::LEVELS;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

const INK: RGBColor = RGBColor(0x1d, 0x27, 0x33);
const GREY: RGBColor = RGBColor(0x8f, 0x9b, 0xaa);
const GRID: RGBColor = RGBColor(0xe6, 0xea, 0xef);
const BLUE: RGBColor = RGBColor(0x1f, 0x6f, 0xc4);
const GREEN: RGBColor = RGBColor(0x2c, 0x8a, 0x4a);
const AMBER: RGBColor = RGBColor(0xd0, 0x8f, 0x00);
const RED: RGBColor = RGBColor(0xc0, 0x39, 0x2b);

/// Points of a line at most; a plot is not wider in pixels.
const POINTS: usize = 1600;
/// Lags of the autocorrelation.
const LAGS: usize = 60;

/// A plot that cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("a plot of the report: {0}")]
pub struct PlotError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for PlotError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self(error.to_string())
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn drawn(size: (u32, u32), draw: impl FnOnce(&Area) -> Result<(), PlotError>) -> Result<String, PlotError> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    // Scales with the page instead of having a size of its own.
    Ok(text.replacen(&format!("width=\"{}\" height=\"{}\" ", size.0, size.1), "", 1))
}

/// Measured and predicted values over time, in a part of the trace that is not empty.
pub fn signal(trace: &Trace, part: Range<usize>) -> Result<String, PlotError> {
    let unit = unit_words(&trace.unit);
    let time = &trace.time[part.clone()];
    let (measured, predicted) = (&trace.measured[part.clone()], &trace.predicted[part]);
    drawn((860, 250), |area| {
        let both = measured.iter().chain(predicted).copied();
        let (low, high) = range(both, 0.05);
        // Room for the legend.
        let high = high + 0.2 * (high - low);
        let (start, end) = (time[0], time[time.len() - 1]);
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .margin_right(16)
            .x_label_area_size(34)
            .y_label_area_size(62)
            .build_cartesian_2d(start..end, low..high)?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(GRID)
            .axis_style(GREY)
            .x_labels(10)
            .x_label_formatter(&|x| plain(*x))
            .y_labels(6)
            .y_label_formatter(&|y| plain(*y))
            .label_style(("sans-serif", 12, &INK))
            .x_desc("time, s")
            .y_desc(unit)
            .draw()?;
        for (values, colour, width, name) in [(measured, GREY, 2, "measured"), (predicted, BLUE, 1, "predicted")] {
            let mut label = Some(name);
            for run in runs(time, values) {
                let series = chart.draw_series(LineSeries::new(run, colour.stroke_width(width)))?;
                if let Some(name) = label.take() {
                    series
                        .label(name)
                        .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2)));
                }
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .label_font(("sans-serif", 12, &INK))
            .draw()?;
        Ok(())
    })
}

/// Histogram of the residual with the normal distribution of the same spread.
pub fn histogram(residual: &[f64], unit: &str) -> Result<String, PlotError> {
    let values: Vec<f64> = residual.iter().copied().filter(|value| value.is_finite()).collect();
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let spread = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
    let half = if spread > 0.0 { 4.0 * spread } else { 1.0 };
    let bins = 40;
    let width = 2.0 * half / bins as f64;
    let mut heights = vec![0.0; bins];
    for value in &values {
        let bin = ((value - mean + half) / width).clamp(0.0, bins as f64 - 1.0);
        heights[bin as usize] += 1.0 / (count * width);
    }
    let normal = |x: f64| (-0.5 * ((x - mean) / spread).powi(2)).exp() / (spread * std::f64::consts::TAU.sqrt());
    let top = heights.iter().copied().fold(if spread > 0.0 { normal(mean) } else { 1.0 }, f64::max) * 1.08;
    let label = if unit == "1" { "residual".to_owned() } else { format!("residual, {unit}") };
    drawn((430, 210), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(16)
            .build_cartesian_2d(mean - half..mean + half, 0.0..top)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(GREY)
            .x_labels(6)
            .x_label_formatter(&|x| plain(*x))
            .y_labels(0)
            .label_style(("sans-serif", 12, &INK))
            .x_desc(label)
            .y_desc("density")
            .draw()?;
        chart.draw_series(heights.iter().enumerate().map(|(bin, height)| {
            let left = mean - half + bin as f64 * width;
            Rectangle::new([(left, 0.0), (left + 0.92 * width, *height)], BLUE.mix(0.45).filled())
        }))?;
        if spread > 0.0 {
            let curve = (0..=160).map(|i| mean - half + f64::from(i) / 160.0 * 2.0 * half).map(|x| (x, normal(x)));
            chart.draw_series(LineSeries::new(curve, INK.stroke_width(1)))?;
        }
        Ok(())
    })
}

/// Autocorrelation of the residual with the 95 % band of white noise.
pub fn autocorrelation(residual: &[f64]) -> Result<String, PlotError> {
    let lags = LAGS.min(residual.len().saturating_sub(1)).max(1);
    let values: Vec<f64> = (0..=lags).map(|lag| correlation(residual, lag)).collect();
    let count = residual.iter().filter(|value| value.is_finite()).count().max(1);
    let band = 1.96 / (count as f64).sqrt();
    let low = values.iter().copied().filter(|v| v.is_finite()).fold(-0.25, f64::min) - 0.05;
    drawn((430, 210), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(40)
            .build_cartesian_2d(-0.5..lags as f64 + 0.5, low..1.05)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(WHITE)
            .bold_line_style(GRID)
            .axis_style(GREY)
            .x_labels(7)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_labels(6)
            .label_style(("sans-serif", 12, &INK))
            .x_desc("lag, samples")
            .y_desc("autocorrelation")
            .draw()?;
        let ends = (-0.5, lags as f64 + 0.5);
        chart.draw_series([Rectangle::new([(ends.0, -band), (ends.1, band)], AMBER.mix(0.22).filled())])?;
        chart.draw_series([PathElement::new(vec![(ends.0, 0.0), (ends.1, 0.0)], GREY.stroke_width(1))])?;
        chart.draw_series(values.iter().enumerate().filter(|(_, value)| value.is_finite()).map(|(lag, value)| {
            PathElement::new(vec![(lag as f64, 0.0), (lag as f64, *value)], BLUE.stroke_width(3))
        }))?;
        Ok(())
    })
}

/// Confidence intervals relative to the values, cut at 100 %; nothing if no parameter has one.
pub fn intervals(report: &FitReport) -> Result<Option<String>, PlotError> {
    let relative = |end: f64, value: f64| 100.0 * (end - value) / value.abs();
    let bars: Vec<_> = report
        .parameters
        .iter()
        .filter(|(_, p)| p.value != 0.0 && p.ci95.iter().all(|end| end.is_finite()))
        .map(|(name, p)| (name, p.ci95.map(|end| relative(end, p.value)), p.verdict))
        .collect();
    if bars.is_empty() {
        return Ok(None);
    }
    let widest = bars.iter().flat_map(|(_, ends, _)| ends.map(f64::abs)).fold(1.0, f64::max);
    let limit = (1.1 * widest).min(100.0);
    let rows = bars.len() as f64;
    drawn((860, 64 + 22 * bars.len() as u32), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .margin_right(16)
            .x_label_area_size(34)
            .y_label_area_size(230)
            .build_cartesian_2d(-limit..limit, -0.5..rows - 0.5)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .light_line_style(WHITE)
            .bold_line_style(GRID)
            .axis_style(GREY)
            .x_labels(9)
            .x_label_formatter(&|x| plain(*x))
            .y_labels(0)
            .label_style(("sans-serif", 12, &INK))
            .x_desc("95 % interval, % of the value")
            .draw()?;
        for (place, (name, ends, verdict)) in bars.iter().enumerate() {
            let y = rows - 1.0 - place as f64;
            let colour = match verdict {
                Verdict::Identified => GREEN,
                Verdict::Weak | Verdict::PriorOnly | Verdict::PerLog => AMBER,
                Verdict::NotIdentifiable | Verdict::AtBound => RED,
            };
            let ends = ends.map(|end| end.clamp(-limit, limit));
            chart.draw_series([
                PathElement::new(vec![(ends[0], y), (ends[1], y)], colour.stroke_width(4)),
                PathElement::new(vec![(0.0, y - 0.28), (0.0, y + 0.28)], INK.stroke_width(2)),
            ])?;
            let (_, pixel) = chart.backend_coord(&(0.0, y));
            let style = ("sans-serif", 13, &INK).into_text_style(area);
            let style = style.pos(plotters::style::text_anchor::Pos::new(
                plotters::style::text_anchor::HPos::Right,
                plotters::style::text_anchor::VPos::Center,
            ));
            area.draw_text(name, &style, (228, pixel))?;
        }
        Ok(())
    })
    .map(Some)
}

/// The statistic of a profile over the parameter's value, the parabola by the standard error, and the levels of 95 % and
/// 99.7 %.
pub fn profile(profile: &Profile, unit: &str) -> Result<String, PlotError> {
    const TOP: f64 = 12.0;
    let (low, high) = range(profile.values.iter().copied(), 0.05);
    let label = if unit == "1" { profile.parameter.clone() } else { format!("{}, {unit}", profile.parameter) };
    drawn((860, 250), |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .margin_right(16)
            .x_label_area_size(34)
            .y_label_area_size(62)
            .build_cartesian_2d(low..high, 0.0..TOP)?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(GRID)
            .axis_style(GREY)
            .x_labels(8)
            .x_label_formatter(&|x| plain(*x))
            .y_labels(6)
            .label_style(("sans-serif", 12, &INK))
            .x_desc(label)
            .y_desc("statistic")
            .draw()?;
        for (level, name) in LEVELS.into_iter().zip(["95 %", "99.7 %"]) {
            chart.draw_series([PathElement::new(vec![(low, level), (high, level)], AMBER.stroke_width(1))])?;
            let (x, y) = chart.backend_coord(&(low, level));
            area.draw_text(name, &("sans-serif", 12, &AMBER).into_text_style(area), (x + 6, y - 15))?;
        }
        let parabola = (0..=200).map(|k| low + (high - low) * f64::from(k) / 200.0);
        let parabola = parabola.map(|v| (v, ((v - profile.estimate) / profile.std).powi(2))).filter(|(_, d)| *d <= TOP);
        chart
            .draw_series(LineSeries::new(parabola, GREY.stroke_width(1)))?
            .label("by the standard error")
            .legend(|(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], GREY.stroke_width(2)));
        let points = || profile.values.iter().copied().zip(profile.statistic.iter().map(|d| d.min(TOP)));
        chart
            .draw_series(LineSeries::new(points(), BLUE.stroke_width(2)))?
            .label(if profile.refitted { "by refits" } else { "by the covariance" })
            .legend(|(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], BLUE.stroke_width(2)));
        chart.draw_series(points().map(|point| Circle::new(point, 2, BLUE.filled())))?;
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperMiddle)
            .background_style(WHITE.mix(0.85))
            .label_font(("sans-serif", 12, &INK))
            .draw()?;
        Ok(())
    })
}

/// A number at an axis: no trailing zeros, no negative zero.
fn plain(value: f64) -> String {
    let rounded = format!("{value:.6}").parse::<f64>().unwrap_or(value);
    if rounded == 0.0 && value.abs() < 1e-9 {
        "0".to_owned()
    } else if rounded.abs() < 1e-4 {
        format!("{value:.1e}")
    } else {
        rounded.to_string()
    }
}

fn unit_words(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

/// Smallest and largest finite value with some room.
fn range(values: impl Iterator<Item = f64>, room: f64) -> (f64, f64) {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (-1.0, 1.0);
    }
    let half = (0.5 * (high - low) * (1.0 + 2.0 * room)).max(1e-9 * high.abs().max(1e-3));
    let middle = 0.5 * (low + high);
    (middle - half, middle + half)
}

/// The parts of a line between missing samples and gaps in time. A long line keeps the lowest and the highest value
/// of every stretch, so that no spike is lost.
fn runs(time: &[f64], values: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let stretch = values.len().div_ceil(POINTS / 2).max(1);
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = steps.len() / 2;
    let usual = if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
    let mut runs = vec![Vec::new()];
    let mut last = f64::NEG_INFINITY;
    for (times, values) in time.chunks(stretch).zip(values.chunks(stretch)) {
        if times[0] - last > 5.0 * usual {
            runs.push(Vec::new());
        }
        last = times[times.len() - 1];
        let points = || times.iter().copied().zip(values.iter().copied()).filter(|(_, value)| value.is_finite());
        let low = points().min_by(|a, b| a.1.total_cmp(&b.1));
        let high = points().max_by(|a, b| a.1.total_cmp(&b.1));
        match (low, high) {
            (Some(low), Some(high)) => {
                let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
                if let Some(run) = runs.last_mut() {
                    run.push(first);
                    if second != first {
                        run.push(second);
                    }
                }
            }
            _ => runs.push(Vec::new()),
        }
    }
    runs.retain(|run| run.len() > 1);
    runs
}

/// Correlation of a series with itself `lag` samples later, over the pairs that are there.
fn correlation(values: &[f64], lag: usize) -> f64 {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let count = finite().count();
    if count < 2 {
        return f64::NAN;
    }
    let mean = finite().sum::<f64>() / count as f64;
    let power = finite().map(|value| (value - mean).powi(2)).sum::<f64>();
    let pairs = values.iter().zip(&values[lag..]).map(|(a, b)| (a - mean) * (b - mean));
    let product: f64 = pairs.filter(|product| product.is_finite()).sum();
    if power > 0.0 { product / power } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_survives_thinning_and_a_gap_parts_the_line() {
        let time: Vec<f64> = (0..100_000).map(f64::from).collect();
        let mut values = vec![0.0; time.len()];
        values[77_777] = 5.0;
        values[40_000..60_000].fill(f64::NAN);
        let runs = runs(&time, &values);
        assert_eq!(runs.len(), 2);
        assert!(runs.iter().map(Vec::len).sum::<usize>() <= POINTS + 2);
        assert!(runs[1].contains(&(77_777.0, 5.0)));
    }

    #[test]
    fn an_alternating_series_is_anticorrelated_with_its_neighbour() {
        let values: Vec<f64> = (0..1000).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!((correlation(&values, 0) - 1.0).abs() < 1e-12);
        assert!((correlation(&values, 1) + 0.999).abs() < 1e-12);
    }
}
