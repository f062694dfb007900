//! What the readers deliver before a column map turns it into a log.

use super::columns::ColumnMap;
use super::error::{listed, quoted};
use super::{Channel, Log, LogError};

/// The columns of a file under their own names.
pub(super) struct Table {
    pub file: String,
    pub sha256: String,
    /// Numeric columns with their values.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Columns that hold text and were left out: name, place, first text.
    pub texts: Vec<(String, String, String)>,
    /// Where a sample stands, to name the place of a bad time.
    pub place: Place,
}

/// How to name the place of a sample in an error.
pub(super) enum Place {
    /// The line number of every sample in a text file.
    Lines(Vec<u32>),
    /// The file has no lines; samples count from 1.
    Samples,
}

impl Table {
    /// Applies the map (or none) and checks the times.
    pub fn into_log(self, map: Option<&ColumnMap>) -> Result<Log, LogError> {
        let Self { file, sha256, columns, texts, place } = self;
        let fail_at = |sample: usize, what: String| match &place {
            Place::Lines(lines) => LogError::line(&file, lines.get(sample).copied().unwrap_or(0).into(), what),
            Place::Samples => LogError::file(&file, format!("sample {}: {what}", sample + 1)),
        };
        if let Some(map) = map {
            // A text column that the map needs: say what stands there, not that there is no column.
            if let Some((name, at, text)) = texts.iter().find(|(name, ..)| map.uses(name)) {
                return Err(LogError::file(at, format!("column {}: {} is not a number", quoted(name), quoted(text))));
            }
        }
        let (time, channels) = match map {
            Some(map) => map.apply(&file, columns)?,
            None => split_time(&file, columns)?,
        };
        if time.is_empty() {
            return Err(LogError::file(&file, "no samples"));
        }
        if let Some(bad) = time.iter().position(|t| !t.is_finite()) {
            return Err(fail_at(bad, "the time is missing or not finite".to_owned()));
        }
        if let Some(before) = time.windows(2).position(|pair| pair[1] <= pair[0]) {
            let (last, now) = (time[before], time[before + 1]);
            let how = if now == last { "stands still" } else { "runs backwards" };
            return Err(fail_at(before + 1, format!("the time {how}: {now} s after {last} s")));
        }
        if time.len() == 1 {
            return Err(LogError::file(&file, "only 1 sample; at least 2 are needed"));
        }
        let channels = channels.into_iter().map(|(name, values)| Channel { name, values });
        Ok(Log { source: file, sha256, time, channels: channels.collect() })
    }
}

type Columns = Vec<(String, Vec<f64>)>;

fn split_time(file: &str, mut columns: Columns) -> Result<(Vec<f64>, Columns), LogError> {
    let names: Vec<_> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let index = time_column(file, &names)?;
    let (_, time) = columns.remove(index);
    Ok((time, columns))
}

/// Place of the column `time`.
pub(super) fn time_column(file: &str, names: &[&str]) -> Result<usize, LogError> {
    if let Some(index) = names.iter().position(|name| *name == "time") {
        return Ok(index);
    }
    let separated = [(';', "semicolons"), ('\t', "tabs")];
    let first = names.first().copied().unwrap_or_default();
    if let Some((_, by)) = separated.iter().find(|(separator, _)| first.contains(*separator)) {
        let what = format!("no column 'time'; the columns seem to be separated by {by}, commas are expected");
        return Err(LogError::file(file, format!("{what} (and decimal points)")));
    }
    let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    let like_time =
        |name: &String| name.contains("time") || name.contains("stamp") || name == "t" || name.starts_with("t_");
    let near = lower.iter().position(like_time).map_or("...", |index| names[index]);
    let near = quoted(near).replace('\'', "\"");
    let columns = listed(names.iter().copied());
    let what = format!("no column 'time' (columns: {columns}); a column map can name another one: time = {near}");
    Err(LogError::file(file, what))
}
