//! How a CSV file is written, detected from its start.

use super::cell::Cells;
use super::source::{Ends, Source};
use crate::LogError;
use crate::columns::{CsvOptions, Encoding, unit};
use csv::{ByteRecord, ReaderBuilder, Trim};

/// Rows that are looked at.
const ROWS: usize = 40;

/// How a file is written.
#[derive(Debug)]
pub struct Dialect {
    pub separator: u8,
    pub cells: Cells,
    pub comment: Option<u8>,
    pub ends: Ends,
    /// Bytes and lines before the header.
    pub skip: (usize, u64),
    /// The line under the header holds units.
    pub unit_row: bool,
    /// What was detected, in words.
    pub note: Option<String>,
}

impl Dialect {
    /// Guesses what the options leave open.
    pub fn detect(file: &str, source: &Source, options: &CsvOptions) -> Result<Self, LogError> {
        let sample = source.sample.as_slice();
        if let Some(kind) = foreign(sample) {
            return Err(LogError::file(file, format!("is not a CSV file but {kind}")));
        }
        let mut notes = Vec::new();
        let returns = sample.contains(&b'\r') && !sample.contains(&b'\n');
        let ends = if returns { Ends::Return } else { Ends::Feed };
        if returns {
            notes.push("lines that end in a carriage return".to_owned());
        }
        match (source.encoding, options.encoding) {
            (_, Some(_)) | (Encoding::Utf8, None) => {}
            (Encoding::Latin1, None) => notes.push("Latin-1 text".to_owned()),
            (_, None) => notes.push("UTF-16 text".to_owned()),
        }
        let end = if returns { b'\r' } else { b'\n' };
        let mut lines = Vec::new();
        let mut at = 0;
        for line in sample.split_inclusive(|byte| *byte == end) {
            lines.push((at, line.trim_ascii()));
            at += line.len();
        }
        if !source.whole && lines.len() > 1 {
            lines.pop();
        }
        // Lines before the header.
        let mut first = options.skip;
        let mut separator = options.separator;
        if let (0, Some((_, line))) = (first, lines.first())
            && let [b's' | b'S', b'e' | b'E', b'p' | b'P', b'=', named] = line
        {
            separator = separator.or(Some(*named));
            first = 1;
        }
        while options.skip == 0 && lines.get(first).is_some_and(|(_, line)| line.starts_with(b"//")) {
            first += 1;
        }
        let rest = lines.get(first..).unwrap_or_default();
        let marked = |mark: u8| rest.iter().any(|(_, line)| line.first() == Some(&mark));
        let comment = options.comment.or_else(|| [b'#', b'%'].into_iter().find(|mark| marked(*mark)));
        let plain: Vec<&[u8]> = rest.iter().map(|(_, line)| *line).filter(|line| !line.is_empty()).collect();
        let is_comment = |line: &&[u8]| comment.is_some() && line.first() == comment.as_ref();
        let body: Vec<&[u8]> = plain.iter().copied().filter(|line| !is_comment(line)).take(ROWS).collect();
        let given_separator = separator;
        let separator = separator.unwrap_or_else(|| best_separator(&body));
        if separator != b',' && given_separator.is_none() {
            let name = match separator {
                b'\t' => "a tab".to_owned(),
                other => format!("'{}'", other as char),
            };
            notes.push(format!("{name} between columns"));
        }
        let rows = records(&body, separator);
        let decimal = options.decimal.unwrap_or_else(|| best_decimal(&rows));
        if decimal == b',' && options.decimal.is_none() {
            notes.push("a decimal comma".to_owned());
        }
        let cells = Cells { decimal, missing: options.missing.clone() };
        // A header behind a comment sign, as numpy writes it.
        let mut start = lines.get(first).map_or(sample.len(), |(at, _)| *at);
        let mut comment_used = comment;
        let numeric = |row: &ByteRecord| row.iter().all(|cell| !cell.is_empty() && cells.is_value(cell));
        if let (Some(mark), Some(row)) = (comment, rows.first().filter(|row| numeric(row))) {
            let above =
                rest.iter().enumerate().take_while(|(_, (_, line))| line.is_empty() || line.first() == Some(&mark));
            let named = above.filter(|(_, (_, line))| !line.is_empty()).last();
            if let Some((k, (at, line))) = named {
                let names = records(&[&line[1..]], separator);
                if names.first().is_some_and(|names| names.len() == row.len() && !numeric(names)) {
                    let sign = sample[*at..].iter().position(|byte| *byte == mark).unwrap_or(0);
                    start = at + sign + 1;
                    first += k;
                    comment_used = comment;
                    notes.push("the header in a comment".to_owned());
                }
            }
        }
        let comment = comment_used;
        let unit_row = options.units.unwrap_or_else(|| rows.get(1).is_some_and(|row| is_unit_row(row, &cells)));
        if unit_row && options.units.is_none() {
            notes.push("units in the line under the header".to_owned());
        }
        if options.comment.is_none()
            && let Some(mark) = comment
        {
            notes.push(format!("lines that begin with '{}' as comments", mark as char));
        }
        let note = (!notes.is_empty())
            .then(|| format!("read with {}; [csv] in a column map decides otherwise", notes.join(", ")));
        Ok(Self { separator, cells, comment, ends, skip: (start, first as u64), unit_row, note })
    }
}

/// What a file is that begins like this, if it is no text.
fn foreign(start: &[u8]) -> Option<&'static str> {
    match start {
        [0x1f, 0x8b, ..] => Some("compressed (gzip) more than once; unpack it first"),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => Some("compressed (zstd); unpack it first"),
        [b'P', b'K', 3, 4, ..] => Some("a zip archive or a spreadsheet; unpack it or save it as CSV first"),
        [b'P', b'A', b'R', b'1', ..] => Some("Parquet; .parquet is its ending"),
        [b'M', b'D', b'F', b' ', ..] | [b'U', b'n', b'F', b'i', b'n', b'M', b'F', ..] => {
            Some("MDF; .mf4 is its ending")
        }
        [0x89, b'M', b'C', b'A', b'P', ..] => Some("MCAP; .mcap is its ending"),
        _ if start[..start.len().min(4096)].contains(&0) => Some("binary"),
        _ => None,
    }
}

fn records(lines: &[&[u8]], separator: u8) -> Vec<ByteRecord> {
    let text = lines.join(&b'\n');
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .delimiter(separator)
        .from_reader(text.as_slice());
    reader.byte_records().map_while(Result::ok).collect()
}

/// The separator by which all rows have as many cells as the header, the comma first.
fn best_separator(lines: &[&[u8]]) -> u8 {
    let mut best = (0, b',');
    for separator in *b",;\t|" {
        let rows = records(lines, separator);
        let width = rows.first().map_or(0, ByteRecord::len);
        let fits =
            |row: &ByteRecord| row.len() == width || row.len() > width && row.iter().skip(width).all(<[u8]>::is_empty);
        if width > best.0.max(1) && rows.iter().all(fits) {
            best = (width, separator);
        }
    }
    if best.0 > 0 {
        return best.1;
    }
    // Rows of different lengths: the header alone decides, and the row that is wrong will be named.
    let header = &lines.first().copied().unwrap_or_default();
    let count = |separator: u8| header.iter().filter(|byte| **byte == separator).count();
    *b",;\t|".iter().rev().max_by_key(|separator| count(**separator)).unwrap_or(&b',')
}

/// A comma if there are cells that are numbers with a decimal comma and none with a point.
fn best_decimal(rows: &[ByteRecord]) -> u8 {
    let of = |decimal| Cells { decimal, missing: vec![] };
    let (point, comma) = (of(b'.'), of(b','));
    let cells = || rows.iter().skip(1).flat_map(ByteRecord::iter);
    let commas = cells().any(|cell| cell.contains(&b',') && comma.is_value(cell) && !point.is_value(cell));
    let points = cells().any(|cell| cell.contains(&b'.') && point.is_value(cell) && !comma.is_value(cell));
    if commas && !points { b',' } else { b'.' }
}

/// Whether a row holds units and no value.
fn is_unit_row(row: &ByteRecord, cells: &Cells) -> bool {
    let known = |cell: &[u8]| std::str::from_utf8(cell).is_ok_and(|text| unit::find(bare(text)).is_ok());
    let dash = |cell: &[u8]| matches!(cell, b"" | b"-" | b"1" | b"[]" | b"[-]" | b"()");
    row.iter().all(|cell| dash(cell) || !cells.is_value(cell)) && row.iter().any(|cell| !dash(cell) && known(cell))
}

/// A unit without the brackets around it.
pub fn bare(text: &str) -> &str {
    let text = text.trim();
    let inner = |open, close| text.strip_prefix(open).and_then(|rest: &str| rest.strip_suffix(close));
    inner('[', ']').or_else(|| inner('(', ')')).unwrap_or(text).trim()
}

/// The name and the unit of `speed [km/h]` or `speed (km/h)`. What stands in round brackets is a unit only if it is known.
pub fn name_and_unit(title: &str) -> (&str, Option<&str>) {
    let split = |open, close| {
        let (name, rest) = title.strip_suffix(close)?.rsplit_once(open)?;
        let (name, unit) = (name.trim(), rest.trim());
        let index = unit.chars().all(|c| c.is_ascii_digit() || matches!(c, ',' | ':' | ' '));
        (!name.is_empty() && !index).then_some((name, unit))
    };
    if let Some((name, unit)) = split('[', ']') {
        return (name, Some(unit));
    }
    match split('(', ')') {
        Some((name, text)) if unit::find(text).is_ok() => (name, Some(text)),
        _ => (title, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_stand_in_brackets_and_indices_do_not() {
        assert_eq!(name_and_unit("speed [km/h]"), ("speed", Some("km/h")));
        assert_eq!(name_and_unit("speed(km/h)"), ("speed", Some("km/h")));
        assert_eq!(name_and_unit("v [furlong]"), ("v", Some("furlong")));
        for plain in ["acc[0]", "v (left)", "a[1,2]", "[km/h]", "v", "angle (a,b)"] {
            assert_eq!(name_and_unit(plain), (plain, None), "{plain}");
        }
    }

    #[test]
    fn the_separator_is_the_one_that_all_rows_agree_on() {
        let best = |lines: &[&str]| best_separator(&lines.iter().map(|line| line.as_bytes()).collect::<Vec<_>>());
        assert_eq!(best(&["time,speed", "0,1", "1,2"]), b',');
        assert_eq!(best(&["time;speed", "0,0;1,5", "0,1;2,5"]), b';');
        assert_eq!(best(&["time;v (a,b)", "0,0;1,5", "0,1;2,5"]), b';');
        assert_eq!(best(&["time\tspeed", "0\t1"]), b'\t');
        assert_eq!(best(&["time,speed", "0,1", "1,2,3"]), b',');
    }
}
