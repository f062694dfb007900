//! Plots over time as plain SVG: they show without a script, and a script can zoom them by their own points.

use std::fmt::Write;
use std::ops::Range;

/// Stretches of a long line, each drawn by its lowest and its highest value; the plot is not wider in pixels.
const STRETCHES: usize = 700;
/// Width and height of the drawing area in its own units, which are whole; the script knows them as well.
const SIZE: (f64, f64) = (100_000.0, 140_000.0);
/// Place of the drawing area in the picture, and its height there.
const PLACE: (f64, f64, f64) = (64.0, 8.0, 780.0);
const HEIGHT: f64 = 140.0;

/// A line of a plot.
pub(super) struct Line<'a> {
    /// What it is, for the legend.
    pub name: &'a str,
    /// Its class in the style sheet.
    pub class: &'static str,
    /// One value per time; NaN parts the line.
    pub values: &'a [f64],
}

/// What lies between two lines.
pub(super) struct Band {
    /// Its class in the style sheet.
    pub class: &'static str,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

impl Band {
    /// Two standard deviations about a line.
    pub fn about(class: &'static str, values: &[f64], std: &[f64]) -> Self {
        let side = |sign: f64| values.iter().zip(std).map(|(value, std)| value + sign * 2.0 * std).collect();
        Self { class, low: side(-1.0), high: side(1.0) }
    }
}

/// Writes a path in whole numbers: each part begins at `M x y`, and `l` brings the differences to the points after it.
#[derive(Default)]
struct Pen {
    path: String,
    last: Option<(i64, i64)>,
    drawing: bool,
}

impl Pen {
    /// The next point begins another part.
    fn lift(&mut self) {
        (self.last, self.drawing) = (None, false);
    }

    fn to(&mut self, x: f64, y: f64) {
        let (x, y) = (x.round() as i64, y.round() as i64);
        let _ = match self.last {
            None => write!(self.path, "M{x} {y}"),
            Some((a, b)) if self.drawing => write!(self.path, " {} {}", x - a, y - b),
            Some((a, b)) => write!(self.path, "l{} {}", x - a, y - b),
        };
        self.drawing = self.last.is_some();
        self.last = Some((x, y));
    }

    /// Around stretches of `(from, to, high, low)`.
    fn outline(&mut self, part: &[(f64, f64, f64, f64)]) {
        if part.is_empty() {
            return;
        }
        self.lift();
        for &(from, to, high, _) in part {
            self.to(from, high);
            if to > from {
                self.to(to, high);
            }
        }
        for &(from, to, _, low) in part.iter().rev() {
            if to > from {
                self.to(to, low);
            }
            self.to(from, low);
        }
        self.path.push('Z');
    }
}

/// One plot.
pub(super) struct Plot<'a> {
    pub title: String,
    pub unit: &'a str,
    pub lines: Vec<Line<'a>>,
    pub bands: Vec<Band>,
    /// Decades instead of numbers: the values are decimal logarithms.
    pub logarithmic: bool,
}

/// Time axis of all plots of a page.
pub(super) struct Axis<'a> {
    time: &'a [f64],
    /// Rows that hang together in time.
    runs: Vec<Range<usize>>,
}

impl<'a> Axis<'a> {
    /// Of at least one time.
    pub fn new(time: &'a [f64]) -> Self {
        let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let middle = steps.len() / 2;
        let usual = if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 };
        let mut runs = Vec::new();
        let mut start = 0;
        for (k, pair) in time.windows(2).enumerate() {
            if pair[1] - pair[0] > 5.0 * usual {
                runs.push(start..k + 1);
                start = k + 1;
            }
        }
        runs.push(start..time.len());
        Self { time, runs }
    }

    /// First and last time, s.
    pub fn ends(&self) -> (f64, f64) {
        let (first, last) = (self.time[0], self.time[self.time.len() - 1]);
        (first, if last > first { last } else { first + 1.0 })
    }

    fn x(&self, time: f64) -> f64 {
        let (first, last) = self.ends();
        SIZE.0 * (time - first) / (last - first)
    }

    /// Rows that are drawn as one.
    fn stretches(&self, run: &Range<usize>) -> impl DoubleEndedIterator<Item = Range<usize>> + use<> {
        let length = self.time.len().div_ceil(STRETCHES).max(1);
        let run = run.clone();
        (0..run.len().div_ceil(length))
            .map(move |k| run.start + k * length..(run.start + (k + 1) * length).min(run.end))
    }

    /// A line's path: of every stretch the lowest and the highest value, so that no spike is lost.
    fn line(&self, values: &[f64], y: impl Fn(f64) -> f64) -> String {
        let mut pen = Pen::default();
        for run in &self.runs {
            pen.lift();
            for rows in self.stretches(run) {
                let there = || rows.clone().filter(|&k| values[k].is_finite());
                let low = there().min_by(|&a, &b| values[a].total_cmp(&values[b]));
                let high = there().max_by(|&a, &b| values[a].total_cmp(&values[b]));
                let (Some(low), Some(high)) = (low, high) else {
                    pen.lift();
                    continue;
                };
                for k in [low.min(high), low.max(high)].into_iter().take(1 + usize::from(low != high)) {
                    pen.to(self.x(self.time[k]), y(values[k]));
                }
            }
        }
        pen.path
    }

    /// A band's outline: of every stretch the highest upper and the lowest lower value. What is not known parts it.
    fn band(&self, band: &Band, y: impl Fn(f64) -> f64) -> String {
        let mut pen = Pen::default();
        let extreme = |rows: &Range<usize>, values: &[f64], pick: fn(f64, f64) -> f64| {
            values[rows.clone()].iter().copied().filter(|value| value.is_finite()).reduce(pick).map(&y)
        };
        for run in &self.runs {
            let mut part: Vec<(f64, f64, f64, f64)> = Vec::new();
            for rows in self.stretches(run) {
                match (extreme(&rows, &band.high, f64::max), extreme(&rows, &band.low, f64::min)) {
                    (Some(high), Some(low)) => {
                        part.push((self.x(self.time[rows.start]), self.x(self.time[rows.end - 1]), high, low));
                    }
                    _ => pen.outline(&std::mem::take(&mut part)),
                }
            }
            pen.outline(&part);
        }
        pen.path
    }

    /// A plot as a picture.
    pub fn plot(&self, plot: &Plot) -> String {
        let (low, high) = range(plot);
        let y = |value: f64| (SIZE.1 * (high - value) / (high - low)).clamp(-20.0 * SIZE.1, 20.0 * SIZE.1);
        let mut inner = String::new();
        for band in &plot.bands {
            let _ = write!(inner, r#"<path class="{}" d="{}"/>"#, band.class, self.band(band, y));
        }
        for line in &plot.lines {
            let _ = write!(
                inner,
                r#"<path class="line {}" data-name="{}" d="{}"/>"#,
                line.class,
                escape(line.name),
                self.line(line.values, y)
            );
        }
        let scale = if plot.logarithmic { " data-log" } else { "" };
        self.frame(
            &plot.title,
            &inner,
            &y_axis(low, high, plot.logarithmic),
            &format!(r#" data-low="{low:e}" data-high="{high:e}"{scale}"#),
            HEIGHT,
        )
    }

    /// Times at which something holds, one row of bars per condition.
    pub fn timeline(&self, title: &str, rows: &[(&str, &'static str, Vec<bool>)]) -> String {
        let (each, unit) = (16.0, SIZE.1 / HEIGHT);
        let (mut inner, mut labels) = (String::new(), String::new());
        for (place, (name, class, holds)) in rows.iter().enumerate() {
            let top = each * place as f64;
            let _ = write!(
                labels,
                r#"<text class="end" x="{:.0}" y="{:.0}">{}</text>"#,
                PLACE.0 - 6.0,
                PLACE.1 + top + 12.0,
                escape(name)
            );
            let mut path = String::new();
            for bar in self.bars(holds) {
                let (from, to) = (self.x(bar.0), self.x(bar.1));
                // What is short must still be seen.
                let to = to.max(from + 80.0);
                let (top, bottom) = (unit * (top + 2.0), unit * (top + each - 2.0));
                let _ = write!(path, "M{from:.0} {top:.0}H{to:.0}V{bottom:.0}H{from:.0}Z");
            }
            let _ = write!(inner, r#"<path class="{class}" d="{path}"/>"#);
        }
        self.frame(title, &inner, &labels, "", each * rows.len().max(1) as f64)
    }

    /// From the first row of a stretch in which something holds to the row after it.
    fn bars(&self, holds: &[bool]) -> Vec<(f64, f64)> {
        let (_, last) = self.ends();
        let mut bars: Vec<(f64, f64)> = Vec::new();
        let (_, _, width) = PLACE;
        let pixel = (last - self.time[0]) / width;
        for k in (0..holds.len()).filter(|&k| holds[k]) {
            let to = self.time.get(k + 1).copied().unwrap_or(last);
            match bars.last_mut() {
                Some(bar) if self.time[k] - bar.1 <= 0.3 * pixel => bar.1 = to,
                _ => bars.push((self.time[k], to)),
            }
        }
        bars
    }

    fn frame(&self, title: &str, inner: &str, y_axis: &str, data: &str, height: f64) -> String {
        let (left, top, width) = PLACE;
        let (first, last) = self.ends();
        let mut ticks = String::new();
        for time in nice(first, last, 8) {
            let x = left + width * self.x(time) / SIZE.0;
            let _ =
                write!(ticks, r#"<text class="mid" x="{x:.1}" y="{:.1}">{}</text>"#, top + height + 15.0, number(time));
        }
        format!(
            r#"<svg class="chart" viewBox="0 0 860 {:.0}" role="img" aria-label="{title}"{data}>
<rect class="ground" x="{left}" y="{top}" width="{width}" height="{height}"/>
<g class="y">{y_axis}</g><g class="x">{ticks}</g>
<svg class="area" x="{left}" y="{top}" width="{width}" height="{height}" viewBox="0 0 {} {:.0}" preserveAspectRatio="none">{inner}</svg>
</svg>
"#,
            top + height + 22.0,
            SIZE.0,
            height * SIZE.1 / HEIGHT,
            title = escape(title),
        )
    }
}

fn y_axis(low: f64, high: f64, logarithmic: bool) -> String {
    let (left, top, width) = PLACE;
    let mut text = String::new();
    for value in nice(low, high, 5).into_iter().filter(|value| !logarithmic || value.fract() == 0.0) {
        let y = top + HEIGHT * (high - value) / (high - low);
        let label = if logarithmic { number(10f64.powf(value)) } else { number(value) };
        let _ = write!(
            text,
            r#"<path class="grid" d="M{left} {y:.1}H{:.1}"/><text class="end" x="{:.0}" y="{:.1}">{label}</text>"#,
            left + width,
            left - 6.0,
            y + 4.0
        );
    }
    text
}

/// The values that are seen: the lines with some room for their bands, of which the widest may be cut.
fn range(plot: &Plot) -> (f64, f64) {
    let finite = |values: &[f64]| {
        let finite = values.iter().copied().filter(|value| value.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let all = plot.lines.iter().map(|line| finite(line.values));
    let (mut low, mut high) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)));
    for band in &plot.bands {
        let mut widths: Vec<f64> =
            band.high.iter().zip(&band.low).map(|(h, l)| h - l).filter(|width| width.is_finite()).collect();
        if widths.is_empty() {
            continue;
        }
        let middle = widths.len() / 2;
        let usual = *widths.select_nth_unstable_by(middle, f64::total_cmp).1;
        let (l, h) = (finite(&band.low).0, finite(&band.high).1);
        (low, high) = (low.min(l.max(low - usual)), high.max(h.min(high + usual)));
    }
    if low > high {
        return (-1.0, 1.0);
    }
    let least = 1e-6 * high.abs().max(low.abs()).max(1e-6);
    let room = (0.06 * (high - low)).max(least);
    (low - room, high + room)
}

/// Round numbers between two.
fn nice(low: f64, high: f64, about: usize) -> Vec<f64> {
    let raw = (high - low) / about as f64;
    let decade = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * decade).find(|step| *step >= raw);
    let step = step.unwrap_or(raw);
    if !(step > 0.0 && step.is_finite()) {
        return Vec::new();
    }
    let first = (low / step).ceil();
    (0..=2 * about).map(|k| (first + k as f64) * step).take_while(|value| *value <= high).collect()
}

/// A number at an axis: no trailing zeros, no negative zero.
pub(super) fn number(value: f64) -> String {
    let rounded = format!("{value:.9}").parse::<f64>().unwrap_or(value);
    match rounded.abs() {
        0.0 => "0".to_owned(),
        size if !(1e-4..1e6).contains(&size) => format!("{value:.1e}"),
        _ => rounded.to_string(),
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_of_one_row_in_an_hour_is_drawn() {
        let time: Vec<f64> = (0..360_000).map(|k| 0.01 * f64::from(k)).collect();
        let mut values = vec![0.0; time.len()];
        values[123_456] = 1.0;
        let path = Axis::new(&time).line(&values, |y| 70_000.0 * y);
        // up to it and down again
        assert!(path.contains(" 70000 ") && path.contains(" -70000 "));
        assert!(path.len() < 20_000);
    }

    #[test]
    fn a_gap_in_time_parts_the_line_and_missing_values_do() {
        let time = [0.0, 1.0, 2.0, 3.0, 4.0, 50.0, 51.0, 52.0];
        let mut values = [1.0; 8];
        values[2] = f64::NAN;
        let path = Axis::new(&time).line(&values, |y| y);
        assert_eq!(path.matches('M').count(), 3);
    }

    #[test]
    fn short_events_stay_visible_and_near_ones_become_one() {
        let time: Vec<f64> = (0..100_000).map(f64::from).collect();
        let mut holds = vec![false; time.len()];
        for k in [5, 6, 8, 70_000] {
            holds[k] = true;
        }
        assert_eq!(Axis::new(&time).bars(&holds), [(5.0, 9.0), (70_000.0, 70_001.0)]);
    }

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        assert_eq!(nice(0.0, 10.0, 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(nice(-0.13, 0.12, 5).first().map(|v| number(*v)).as_deref(), Some("-0.1"));
    }
}
