//! Measured and predicted signals of the fitted logs as CSV.

use crate::result::FitReport;
use std::fmt::Write;

/// One line per sample or window and signal; missing values are empty cells.
pub fn residuals(report: &FitReport) -> String {
    let mut text = "log,signal,unit,time,measured,predicted,residual\n".to_owned();
    let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    for trace in &report.fitted {
        let lead = [&trace.log, &trace.name, &trace.unit].map(|word| quoted(word)).join(",");
        for ((time, measured), predicted) in trace.time.iter().zip(&trace.measured).zip(&trace.predicted) {
            let (m, p, r) = (cell(*measured), cell(*predicted), cell(measured - predicted));
            let _ = writeln!(text, "{lead},{time},{m},{p},{r}");
        }
    }
    text
}

/// A cell of words, in quotes where it holds what parts cells.
fn quoted(word: &str) -> String {
    if word.contains([',', '"', '\n', '\r']) { format!("\"{}\"", word.replace('"', "\"\"")) } else { word.to_owned() }
}
