//! Rows and their cells.
//!
//! Logs are numbers: most rows have no quotes, and a row without quotes is cut at its separators, which is faster than
//! to look for quotes in every cell. A row with quotes, which may go on over several lines, is left to `csv_core`.

use super::dialect::Dialect;
use csv_core::{ReadRecordResult, Reader, ReaderBuilder};
use memchr::{memchr, memchr_iter};
use std::io::{self, Read};
use std::ops::Range;

/// Bytes that are read at once, and what a longer row makes room for.
const BLOCK: usize = 1 << 18;

/// The rows of a text whose lines all end in a line feed; empty lines and comments are left out.
pub struct Rows<'a> {
    separator: u8,
    comment: Option<u8>,
    from: Box<dyn Read + 'a>,
    /// What was read stands from `start` to `end`.
    text: Vec<u8>,
    start: usize,
    end: usize,
    /// Length of the line at `start` that [`plain`](Self::plain) has found.
    ahead: usize,
    /// Place before which no quote stands that is not passed.
    unquoted: usize,
    /// Lines before `start`.
    lines: u64,
    quoted: Box<Reader>,
    /// The cells of a row with quotes one after another, and where each ends.
    joined: (Vec<u8>, Vec<usize>),
    cells: Vec<Range<usize>>,
}

/// The trimmed cells of a row.
#[derive(Clone, Copy)]
pub struct Row<'r> {
    text: &'r [u8],
    cells: &'r [Range<usize>],
    /// The line on which the row ends, from 1.
    pub line: u64,
}

impl<'r> Row<'r> {
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    pub fn get(&self, index: usize) -> Option<&'r [u8]> {
        self.cells.get(index).map(|cell| &self.text[cell.clone()])
    }

    pub fn iter(&self) -> impl Iterator<Item = &'r [u8]> + use<'r> {
        let text = self.text;
        self.cells.iter().map(move |cell| &text[cell.clone()])
    }
}

impl<'a> Rows<'a> {
    pub fn new(from: Box<dyn Read + 'a>, dialect: &Dialect) -> Self {
        Self {
            separator: dialect.separator,
            comment: dialect.comment,
            from,
            text: Vec::new(),
            start: 0,
            end: 0,
            ahead: 0,
            unquoted: 0,
            lines: 0,
            quoted: Box::new(ReaderBuilder::new().delimiter(dialect.separator).comment(dialect.comment).build()),
            joined: (vec![0; 1 << 10], vec![0; 1 << 6]),
            cells: Vec::new(),
        }
    }

    /// The next row as it stands with what was read behind it, and its length, if it has no quotes;
    /// [`pass`](Self::pass) or [`next`](Self::next) goes on.
    pub fn plain(&mut self) -> io::Result<Option<(&[u8], usize)>> {
        let Some(length) = self.line()? else { return Ok(None) };
        self.ahead = length;
        let end = self.start + length;
        if self.unquoted < end {
            let from = self.unquoted.max(self.start);
            self.unquoted = memchr(b'"', &self.text[from..self.end]).map_or(self.end, |place| from + place);
        }
        let text = &self.text[self.start..self.end];
        let is_row = length > 0 && self.comment != Some(text[0]) && self.unquoted >= end;
        Ok(is_row.then_some((text, length)))
    }

    /// Goes on behind the row that [`plain`](Self::plain) has returned; the number of its line, from 1.
    pub fn pass(&mut self) -> u64 {
        self.start += self.ahead + 1;
        self.lines += 1;
        self.lines
    }

    /// The next row; `None` at the end.
    pub fn next(&mut self) -> io::Result<Option<Row<'_>>> {
        while let Some(length) = self.line()? {
            let line = &self.text[self.start..self.start + length];
            if memchr(b'"', line).is_some() {
                return self.quoted_row();
            }
            let start = self.start;
            self.start += length + 1;
            self.lines += 1;
            if line.is_empty() || self.comment == Some(line[0]) {
                continue;
            }
            self.cells.clear();
            let mut from = 0;
            for to in memchr_iter(self.separator, line).chain([length]) {
                self.cells.push(trimmed(&self.text, start + from..start + to));
                from = to + 1;
            }
            return Ok(Some(Row { text: &self.text, cells: &self.cells, line: self.lines }));
        }
        Ok(None)
    }

    /// Length of the line at `start`, which is read as far as its end.
    fn line(&mut self) -> io::Result<Option<usize>> {
        let mut seen = 0;
        loop {
            if let Some(length) = memchr(b'\n', &self.text[self.start + seen..self.end]) {
                return Ok(Some(seen + length));
            }
            seen = self.end - self.start;
            if !self.more()? {
                return Ok(None);
            }
        }
    }

    /// Reads on, after what stands from `start` on; false at the end of the text.
    fn more(&mut self) -> io::Result<bool> {
        self.text.copy_within(self.start..self.end, 0);
        self.unquoted = self.unquoted.saturating_sub(self.start);
        (self.start, self.end) = (0, self.end - self.start);
        // As much again as there is: a row of any length takes linear time.
        let room = self.end + BLOCK.max(self.end);
        if self.text.len() < room {
            self.text.resize(room, 0);
        }
        let count = read_some(&mut self.from, &mut self.text[self.end..])?;
        self.end += count;
        Ok(count > 0)
    }

    /// The row at `start`, which has quotes.
    fn quoted_row(&mut self) -> io::Result<Option<Row<'_>>> {
        let (mut length, mut count) = (0, 0);
        loop {
            let (bytes, ends) = &mut self.joined;
            let input = &self.text[self.start..self.end];
            let (result, read, written, ended) =
                self.quoted.read_record(input, &mut bytes[length..], &mut ends[count..]);
            self.lines += memchr_iter(b'\n', &input[..read]).count() as u64;
            self.start += read;
            length += written;
            count += ended;
            match result {
                // At the end of the text no more is given, which ends the row.
                ReadRecordResult::InputEmpty => {
                    self.more()?;
                }
                ReadRecordResult::OutputFull => bytes.resize(2 * bytes.len(), 0),
                ReadRecordResult::OutputEndsFull => ends.resize(2 * ends.len(), 0),
                ReadRecordResult::End => return Ok(None),
                ReadRecordResult::Record => break,
            }
        }
        let (bytes, ends) = &self.joined;
        self.cells.clear();
        let mut from = 0;
        for &to in &ends[..count] {
            self.cells.push(trimmed(bytes, from..to));
            from = to;
        }
        Ok(Some(Row { text: bytes, cells: &self.cells, line: self.lines }))
    }
}

fn read_some(from: &mut dyn Read, to: &mut [u8]) -> io::Result<usize> {
    loop {
        match from.read(to) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

/// A part of a text without the spaces around it.
#[inline]
fn trimmed(text: &[u8], part: Range<usize>) -> Range<usize> {
    let Range { mut start, mut end } = part;
    while start < end && text[start].is_ascii_whitespace() {
        start += 1;
    }
    while start < end && text[end - 1].is_ascii_whitespace() {
        end -= 1;
    }
    start..end
}

#[cfg(test)]
mod tests {
    use super::super::CsvOptions;
    use super::super::source::Source;
    use super::*;
    use crate::hash::Hashed;
    use proptest::prelude::*;

    /// Hands a text out in pieces of a few bytes, as a slow medium does.
    struct Slow<'t>(&'t [u8], usize);

    impl Read for Slow<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(self.0.len()).min(buffer.len());
            buffer[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    fn dialect() -> Dialect {
        let options = CsvOptions::default();
        let source = Source::open("log.csv", Hashed::new(&b"time,speed\n0,1\n1,2\n"[..]), None).unwrap();
        Dialect::detect("log.csv", &source, &options).unwrap()
    }

    proptest! {
        /// The csv crate knows no shortcut.
        #[test]
        fn rows_are_those_of_the_csv_crate(text in "[ab1,\"# \n]{0,120}", piece in 1..9_usize) {
            let text = text + "\n";
            let mut reader = ::csv::ReaderBuilder::new();
            reader.has_headers(false).flexible(true).trim(::csv::Trim::All);
            let mut reader = reader.from_reader(text.as_bytes());
            let mut rows = Rows::new(Box::new(Slow(text.as_bytes(), piece)), &dialect());
            let mut record = ::csv::ByteRecord::new();
            while reader.read_byte_record(&mut record).unwrap() {
                let row = rows.next().unwrap();
                let row = row.expect("a row");
                prop_assert_eq!(row.iter().collect::<Vec<_>>(), record.iter().collect::<Vec<_>>());
                prop_assert_eq!(row.line, reader.position().line() - 1);
            }
            prop_assert!(rows.next().unwrap().is_none());
        }
    }
}
