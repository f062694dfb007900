//! The result as a table for the terminal.

use crate::result::{FitReport, Parameter, SignalFit};
use std::fmt::Write;

/// The table, at most about 100 columns wide, ending in a new line.
pub fn table(report: &FitReport) -> String {
    let mut text = format!("{}: {}\n", report.vehicle, summary(report));
    if !report.parameters.is_empty() {
        text.push('\n');
        parameters(report, &mut text);
    }
    text.push('\n');
    quality(report, &mut text);
    for warning in &report.warnings {
        wrapped(&mut text, "warning: ", warning);
    }
    for note in &report.notes {
        wrapped(&mut text, "note: ", note);
    }
    if let Some(line) = start_values(report) {
        let _ = writeln!(text, "\nfmpy {line}");
    }
    text
}

/// What was fitted to what, in one line.
pub(super) fn summary(report: &FitReport) -> String {
    let samples: usize = report.logs.iter().map(|log| log.samples).sum();
    format!(
        "{} from {} ({samples} samples, {}), {}",
        counted(report.parameters.len(), "parameter"),
        counted(report.logs.len(), "log"),
        counted(report.windows_used, "window"),
        report.loss,
    )
}

/// `--start-values name value ...` as fmpy takes it, identified parameters only.
pub fn start_values(report: &FitReport) -> Option<String> {
    let values: Vec<_> = report.identified().map(|(name, p)| format!("{name} {:?}", p.value)).collect();
    (!values.is_empty()).then(|| format!("--start-values {}", values.join(" ")))
}

fn parameters(report: &FitReport, text: &mut String) {
    let head = ["parameter", "value", "unit", "95 % interval", "by noise", "t", "truth", "verdict"].map(str::to_owned);
    let rows = report.parameters.iter().map(|(name, p)| row(name, p, report.references.get(name)));
    let rows: Vec<[String; 8]> = std::iter::once(head).chain(rows).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 8] = std::array::from_fn(width);
    for row in &rows {
        let mut line = String::new();
        for (column, cell) in row.iter().enumerate() {
            if column == TRUTH && report.references.is_empty() {
                continue;
            }
            let fill = " ".repeat(widths[column] - cell.chars().count());
            // Numbers end at the same column, words begin at the same column.
            let (before, after) =
                if matches!(column, 1 | 3 | 4 | 5 | TRUTH) { (fill, String::new()) } else { (String::new(), fill) };
            let _ = write!(line, "{before}{cell}{after}  ");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
}

/// Column of the true values, left out if there are none.
const TRUTH: usize = 6;

/// Name, value, unit, interval, its half width by noise alone, t-ratio, true value and verdict of a parameter.
pub(super) fn row(name: &str, p: &Parameter, truth: Option<&f64>) -> [String; 8] {
    let decimals = decimals(p);
    let interval = if p.ci95.iter().all(|end| end.is_finite()) {
        format!("[{}, {}]", number(p.ci95[0], decimals), number(p.ci95[1], decimals))
    } else {
        "-".to_owned()
    };
    let t = p.t_ratio().abs();
    let t = match t {
        t if !t.is_finite() => "-".to_owned(),
        t if t < 99.95 => format!("{t:.1}"),
        t => format!("{t:.0}"),
    };
    let unit = if p.unit == "1" { "" } else { &p.unit };
    let truth = truth.map_or(String::new(), |truth| number(*truth, decimals));
    let half = 1.96 * p.sampling_std;
    let noise = if half > 0.0 && half.is_finite() { format!("+-{}", significant(half, 2)) } else { "-".to_owned() };
    [
        name.to_owned(),
        number(p.value, decimals),
        unit.to_owned(),
        interval,
        noise,
        t,
        truth,
        p.verdict.words().to_owned(),
    ]
}

fn quality(report: &FitReport, text: &mut String) {
    if let Some(pair) = &report.correlation_worst_pair {
        let [a, b] = &pair.parameters;
        let _ = writeln!(text, "worst correlation  {:+.3} between {a} and {b}", pair.correlation);
    }
    if report.condition_number.is_finite() {
        let _ = writeln!(text, "condition number   {}", significant(report.condition_number, 3));
    }
    if !report.solver_status.is_empty() {
        let _ = writeln!(text, "solver             {}", report.solver_status);
    }
    if !report.validation.signals.is_empty() {
        let share = 100.0 * report.validation.held_out;
        let _ = if share < 100.0 {
            writeln!(text, "\nprediction of the last {share:.0} % of the samples, not used for that fit:")
        } else {
            writeln!(text, "\nprediction of the logs that were held out:")
        };
        let width = report.validation.signals.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
        for signal in &report.validation.signals {
            let _ = writeln!(text, "  {:width$}  {}", signal.name, validation_words(signal));
        }
    }
    if !report.warnings.is_empty() || !report.notes.is_empty() {
        text.push('\n');
    }
}

fn validation_words(signal: &SignalFit) -> String {
    let percent = |value: f64| if value.is_finite() { format!("{value:.1} %") } else { "-".to_owned() };
    let unit = if signal.unit == "1" { String::new() } else { format!(" {}", signal.unit) };
    let (ahead, behind) = (percent(signal.fit_percent), percent(signal.fit_percent_training));
    let rmse = significant(signal.rmse, 3);
    format!("fit {ahead:>7} (training {behind}), rmse {rmse}{unit}, {} samples", signal.samples)
}

/// A line broken at words, continued below its first word.
fn wrapped(text: &mut String, lead: &str, message: &str) {
    let mut line = lead.to_owned();
    for word in message.split_whitespace() {
        if line.chars().count() + word.chars().count() >= 100 && line.trim() != lead.trim() && !line.trim().is_empty() {
            let _ = writeln!(text, "{}", line.trim_end());
            line = " ".repeat(lead.len());
        }
        line += word;
        line.push(' ');
    }
    let _ = writeln!(text, "{}", line.trim_end());
}

/// Decimals that show two digits of the standard error, or five digits of the value without one.
fn decimals(p: &Parameter) -> usize {
    let (scale, digits) = if p.std_error.is_finite() && p.std_error > 0.0 { (p.std_error, 2) } else { (p.value, 5) };
    if scale == 0.0 || !scale.is_finite() {
        return 3;
    }
    (digits - 1 - scale.abs().log10().floor() as i64).clamp(0, 9) as usize
}

fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    if value != 0.0 && (value.abs() >= 1e9 || value.abs() < 1e-7) {
        return format!("{value:.3e}");
    }
    format!("{value:.decimals$}")
}

/// A number with some significant digits.
pub(super) fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return number(value, 1);
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-4..7).contains(&exponent) {
        let decimals = (digits - 1 - exponent).max(0) as usize;
        format!("{value:.decimals$}")
    } else {
        let decimals = (digits - 1) as usize;
        format!("{value:.decimals$e}")
    }
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
