//! The bytes of a text file: unpacked, in UTF-8, with lines that end in a single line feed.

use crate::LogError;
use crate::columns::Encoding;
use crate::hash::Hashed;
use encoding_rs::{CoderResult, Decoder};
use memchr::memchr;
use std::cell::RefCell;
use std::io::{self, Cursor, Read};
use std::rc::Rc;

/// Bytes at the start from which the dialect is detected.
const SAMPLE: usize = 1 << 16;
/// A packed file that grows beyond this many bytes and this many times is no log.
const LARGEST: u64 = 1 << 30;
const FOLD: u64 = 200;

/// The same reader in two hands: one reads it to pieces, one asks for the hash at the end.
#[derive(Clone)]
struct Shared<'a>(Rc<RefCell<Hashed<'a>>>);

impl Read for Shared<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.borrow_mut().read(buffer)
    }
}

/// What stands at the start of a text file, and the rest of it.
pub struct Source<'a> {
    bytes: Shared<'a>,
    /// The unpacked start.
    pub sample: Vec<u8>,
    /// The whole unpacked file, the sample included, in UTF-8 or Latin-1.
    text: Box<dyn Read + 'a>,
    pub encoding: Encoding,
    /// The sample is the whole file.
    pub whole: bool,
}

impl<'a> Source<'a> {
    /// Opens a text file; `encoding` is detected if it is not given.
    pub fn open(file: &str, from: Hashed<'a>, encoding: Option<Encoding>) -> Result<Self, LogError> {
        let fail = |e: io::Error| LogError::file(file, unpacking(&e));
        let bytes = Shared(Rc::new(RefCell::new(from)));
        let (start, _) = take(&mut bytes.clone(), 4).map_err(fail)?;
        let packed = Cursor::new(start.clone()).chain(bytes.clone());
        let mut unpacked: Box<dyn Read + 'a> = match start.as_slice() {
            [0x1f, 0x8b, ..] => {
                let from = flate2::read::MultiGzDecoder::new(packed);
                Box::new(Bounded { from, packed: bytes.clone(), count: 0 })
            }
            #[cfg(feature = "zstd")]
            [0x28, 0xb5, 0x2f, 0xfd] => {
                let from = zstd::Decoder::new(packed).map_err(fail)?;
                Box::new(Bounded { from, packed: bytes.clone(), count: 0 })
            }
            _ => Box::new(packed),
        };
        let (mut sample, mut whole) = take(&mut unpacked, SAMPLE).map_err(fail)?;
        let encoding = encoding.unwrap_or_else(|| detect(&sample));
        let wide = match encoding {
            Encoding::Utf16Le => Some(encoding_rs::UTF_16LE),
            Encoding::Utf16Be => Some(encoding_rs::UTF_16BE),
            Encoding::Utf8 | Encoding::Latin1 => None,
        };
        let mut text: Box<dyn Read + 'a> = Box::new(unpacked);
        if let Some(wide) = wide {
            let from = Cursor::new(std::mem::take(&mut sample)).chain(text);
            text = Box::new(Wide::new(from, wide.new_decoder_with_bom_removal()));
            (sample, whole) = take(&mut text, SAMPLE).map_err(fail)?;
        }
        if sample.starts_with(b"\xef\xbb\xbf") {
            sample.drain(..3);
        }
        Ok(Self { bytes, sample, text, encoding, whole })
    }

    /// A name that stands in the file.
    pub fn decode<'t>(&self, name: &'t [u8]) -> std::borrow::Cow<'t, str> {
        match self.encoding {
            Encoding::Latin1 => encoding_rs::WINDOWS_1252.decode_without_bom_handling(name).0,
            _ => String::from_utf8_lossy(name),
        }
    }

    /// The text from byte `skip` of the sample on, in lines that end in a line feed.
    pub fn lines(&mut self, skip: usize, ends: Ends) -> Box<dyn Read + 'a> {
        let start = Cursor::new(self.sample[skip.min(self.sample.len())..].to_vec());
        let rest = std::mem::replace(&mut self.text, Box::new(io::empty()));
        Box::new(Lines { from: start.chain(rest), ends, ended: true })
    }

    /// Bytes of the file that were read so far.
    pub fn position(&self) -> u64 {
        self.bytes.0.borrow().count
    }

    /// SHA-256 of the whole file, hexadecimal; empty if it is taken beside.
    pub fn sha256(self) -> io::Result<String> {
        drop(self.text);
        io::copy(&mut self.bytes.clone(), &mut io::sink())?;
        Ok(self.bytes.0.borrow_mut().sha256())
    }
}

/// How lines end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// A line feed, or a carriage return and a line feed.
    Feed,
    /// A carriage return alone.
    Return,
}

/// Passes lines on that all end in a single line feed, so that lines can be counted.
struct Lines<R> {
    from: R,
    ends: Ends,
    /// The last byte passed on was a line feed.
    ended: bool,
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let count = self.from.read(buffer)?;
            if count == 0 && !self.ended && !buffer.is_empty() {
                buffer[0] = b'\n';
                self.ended = true;
                return Ok(1);
            }
            let mut kept = count;
            if self.ends == Ends::Return {
                buffer[..count].iter_mut().filter(|byte| **byte == b'\r').for_each(|byte| *byte = b'\n');
            } else if memchr(b'\r', &buffer[..count]).is_some() {
                kept = 0;
                for index in 0..count {
                    if buffer[index] != b'\r' {
                        buffer[kept] = buffer[index];
                        kept += 1;
                    }
                }
            }
            if kept > 0 {
                self.ended = buffer[kept - 1] == b'\n';
            }
            if kept > 0 || count == 0 {
                return Ok(kept);
            }
        }
    }
}

/// Unpacked bytes, as long as there are not absurdly many of them.
struct Bounded<'a, R> {
    from: R,
    packed: Shared<'a>,
    count: u64,
}

impl<R: Read> Read for Bounded<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(buffer)?;
        self.count += count as u64;
        let packed = self.packed.0.borrow().count;
        if self.count > LARGEST.max(FOLD.saturating_mul(packed)) {
            let what = format!("it unpacks to more than {FOLD} times its size and 1 GiB, as no log does");
            return Err(io::Error::other(what));
        }
        Ok(count)
    }
}

/// Text in UTF-16, passed on in UTF-8.
struct Wide<R> {
    from: R,
    decoder: Decoder,
    input: Vec<u8>,
    output: Vec<u8>,
    given: usize,
    last: bool,
}

impl<R: Read> Wide<R> {
    fn new(from: R, decoder: Decoder) -> Self {
        Self { from, decoder, input: Vec::new(), output: Vec::new(), given: 0, last: false }
    }
}

impl<R: Read> Read for Wide<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.given == self.output.len() && !self.last {
            let mut piece = [0; 1 << 12];
            let count = self.from.read(&mut piece)?;
            self.input.clear();
            self.input.extend_from_slice(&piece[..count]);
            self.last = count == 0;
            // UTF-8 needs at most three bytes for two of UTF-16.
            let room = self.decoder.max_utf8_buffer_length(count).unwrap_or(4 * count + 16);
            self.output.resize(room, 0);
            let (result, _, written, _) = self.decoder.decode_to_utf8(&self.input, &mut self.output, self.last);
            debug_assert_eq!(result, CoderResult::InputEmpty);
            self.output.truncate(written);
            self.given = 0;
        }
        let count = buffer.len().min(self.output.len() - self.given);
        buffer[..count].copy_from_slice(&self.output[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

/// Up to `most` bytes, and whether that is all.
fn take(from: &mut impl Read, most: usize) -> io::Result<(Vec<u8>, bool)> {
    let mut bytes = Vec::new();
    from.by_ref().take(most as u64).read_to_end(&mut bytes)?;
    let whole = bytes.len() < most;
    Ok((bytes, whole))
}

/// The encoding of a text that begins like this.
fn detect(sample: &[u8]) -> Encoding {
    match sample {
        [0xff, 0xfe, ..] => return Encoding::Utf16Le,
        [0xfe, 0xff, ..] => return Encoding::Utf16Be,
        _ => {}
    }
    // Two bytes each, one of them nought for the letters and digits of a log.
    let start = &sample[..sample.len().min(64)];
    let noughts = |odd: usize| start.iter().skip(odd).step_by(2).filter(|byte| **byte == 0).count();
    match (noughts(0), noughts(1)) {
        (0, count) if count > 0 && 5 * count >= 2 * start.len() => return Encoding::Utf16Le,
        (count, 0) if count > 0 && 5 * count >= 2 * start.len() => return Encoding::Utf16Be,
        _ => {}
    }
    match std::str::from_utf8(sample) {
        // Only the last character may be cut off.
        Err(error) if error.error_len().is_some() => Encoding::Latin1,
        _ => Encoding::Utf8,
    }
}

/// An error while reading, without words that the libraries repeat.
fn unpacking(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
            format!("the packed file is damaged: {error}")
        }
        _ => error.to_string(),
    }
}
