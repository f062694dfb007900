//! The result as a table for the terminal.

use crate::result::{FitReport, OfLog, Parameter, SignalFit};
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
    let mut rows: Vec<Vec<String>> = std::iter::once(head).chain(rows).map(Vec::from).collect();
    if report.references.is_empty() {
        rows.iter_mut().for_each(|row| _ = row.remove(TRUTH));
    }
    let last = rows[0].len() - 1;
    aligned(&rows, |column| column == 1 || (3..last).contains(&column), text);
}

/// Rows of equally many cells. Numbers, in the columns that are `right`, end at the same place; words begin at the same place.
fn aligned(rows: &[Vec<String>], right: impl Fn(usize) -> bool, text: &mut String) {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..rows.first().map_or(0, Vec::len)).map(width).collect();
    for row in rows {
        let mut line = String::new();
        for (column, cell) in row.iter().enumerate() {
            let fill = " ".repeat(widths[column] - cell.chars().count());
            let (before, after) = if right(column) { (fill, String::new()) } else { (String::new(), fill) };
            let _ = write!(line, "{before}{cell}{after}  ");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
}

/// A signal of so many logs is shown log by log.
const FEW: usize = 4;
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
        let _ = writeln!(text, "solved             {}", report.solver_words());
    }
    if !report.validation.signals.is_empty() {
        let share = 100.0 * report.validation.held_out;
        let what = if share < 100.0 {
            format!("the last {share:.0} % of the samples, not used for that fit")
        } else {
            "the logs that were held out".to_owned()
        };
        let many = by_name(&report.validation.signals).iter().any(|(_, logs)| logs.len() > FEW);
        let how = if many { " (median of the logs; --each-log lists them)" } else { "" };
        let _ = writeln!(text, "\nprediction of {what}{how}:");
        let width = report.validation.signals.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
        for (name, logs) in by_name(&report.validation.signals) {
            match logs.as_slice() {
                [only] => _ = writeln!(text, "  {name:width$}  {}", validation_words(only)),
                few if few.len() <= FEW => {
                    for signal in few {
                        let _ = writeln!(text, "  {name:width$}  {}, {}", validation_words(signal), signal.log);
                    }
                }
                many => _ = writeln!(text, "  {name:width$}  {}", words_of_many(many)),
            }
        }
    }
    if !report.warnings.is_empty() || !report.notes.is_empty() {
        text.push('\n');
    }
}

/// The fits of each signal, in the order in which the signals first stand.
fn by_name(signals: &[SignalFit]) -> Vec<(&str, Vec<&SignalFit>)> {
    let mut names: Vec<(&str, Vec<&SignalFit>)> = Vec::new();
    for signal in signals {
        match names.iter_mut().find(|(name, _)| *name == signal.name) {
            Some((_, logs)) => logs.push(signal),
            None => names.push((&signal.name, vec![signal])),
        }
    }
    names
}

/// One signal in many logs: the medians, the error of all samples together, and the log that is predicted worst.
fn words_of_many(logs: &[&SignalFit]) -> String {
    let median = |of: fn(&SignalFit) -> f64| {
        let mut values: Vec<f64> = logs.iter().map(|log| of(log)).filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        match values.len() {
            0 => f64::NAN,
            even if even % 2 == 0 => (values[middle - 1] + values[middle]) / 2.0,
            _ => values[middle],
        }
    };
    let known = || logs.iter().filter(|log| log.rmse.is_finite());
    let (squares, count) = known()
        .fold((0.0, 0), |(squares, count), log| (squares + log.samples as f64 * log.rmse.powi(2), count + log.samples));
    let all = SignalFit {
        unit: logs[0].unit.clone(),
        samples: logs.iter().map(|log| log.samples).sum(),
        rmse: (squares / count as f64).sqrt(),
        fit_percent: median(|log| log.fit_percent),
        fit_percent_training: median(|log| log.fit_percent_training),
        ..SignalFit::default()
    };
    let worst =
        logs.iter().filter(|log| log.fit_percent.is_finite()).min_by(|a, b| a.fit_percent.total_cmp(&b.fit_percent));
    let worst = worst.map_or(String::new(), |log| format!("; {} in {}", percent(log.fit_percent), log.log));
    format!("{} of {} logs{worst}", validation_words(&all), logs.len())
}

/// A table with a line for each log: samples, how well its signals are predicted, and the values that are its own.
pub fn each_log(report: &FitReport) -> String {
    let signals = by_name(&report.validation.signals);
    let own: Vec<(&String, &Parameter)> = report.parameters.iter().filter(|(_, p)| !p.per_log.is_empty()).collect();
    let mut logs: Vec<&str> = report.logs.iter().map(|log| log.file.as_str()).collect();
    // Logs that were held out are predicted and not fitted.
    for signal in &report.validation.signals {
        if !logs.contains(&signal.log.as_str()) {
            logs.push(&signal.log);
        }
    }
    let names =
        own.iter().map(|(name, p)| if p.unit == "1" { (*name).clone() } else { format!("{name} [{}]", p.unit) });
    let head = ["log", "samples"].map(str::to_owned).into_iter();
    let mut rows: Vec<Vec<String>> =
        vec![head.chain(signals.iter().map(|(name, _)| (*name).to_owned())).chain(names).collect()];
    for file in logs {
        let samples =
            report.logs.iter().find(|log| log.file == file).map_or("-".to_owned(), |log| log.samples.to_string());
        let fits = signals.iter().map(|(_, logs)| {
            let log = logs.iter().find(|signal| signal.log == file);
            log.map_or("-".to_owned(), |signal| percent(signal.fit_percent))
        });
        let values = own.iter().map(|(_, parameter)| {
            let of = |of: &OfLog| format!("{} +-{}", significant(of.value, 4), significant(of.std_error, 2));
            parameter.per_log.get(file).map_or("-".to_owned(), of)
        });
        rows.push([file.to_owned(), samples].into_iter().chain(fits).chain(values).collect());
    }
    let mut text = String::from("\n");
    aligned(&rows, |column| column > 0, &mut text);
    text
}

fn percent(value: f64) -> String {
    if value.is_finite() { format!("{value:.1} %") } else { "-".to_owned() }
}

fn validation_words(signal: &SignalFit) -> String {
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
