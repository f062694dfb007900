//! The records of a data group: out of lists of blocks, packed or not, sorted into channel groups.

use super::Failure;
use super::block::{Block, block};
use flate2::read::ZlibDecoder;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::io::Read;

/// Packed data that grow beyond this many bytes and this many times the file are no log.
const LARGEST: u64 = 1 << 30;
const FOLD: u64 = 200;

/// The bytes of all data blocks behind a link, and the invalidation bytes that are stored apart from them.
#[derive(Debug, Default)]
pub struct Stream<'a> {
    pub records: Cow<'a, [u8]>,
    pub invalid: Vec<u8>,
    /// The bytes of each record stand one after the other, without record numbers.
    pub column_oriented: bool,
}

/// What is left to do in a file whose writer did not come to its end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unfinished {
    /// The last data block is longer than it claims: it goes on to the end of the file.
    pub last_block: Option<usize>,
}

/// The data behind a link.
pub fn stream(bytes: &[u8], link: u64, unfinished: Unfinished) -> Result<Stream<'_>, Failure> {
    if link == 0 {
        return Ok(Stream::default());
    }
    let found = block(bytes, link)?;
    if matches!(found.name, b"##DT" | b"##DV") {
        let records = Cow::Borrowed(plain(bytes, &found, unfinished)?);
        return Ok(Stream { records, invalid: Vec::new(), column_oriented: found.name == b"##DV" });
    }
    let mut to = Collected { file: bytes, unfinished, records: Vec::new(), invalid: Vec::new(), columns: false };
    to.block(&found, 0)?;
    Ok(Stream { records: Cow::Owned(to.records), invalid: to.invalid, column_oriented: to.columns })
}

/// The data of a block that is not packed.
fn plain<'a>(bytes: &'a [u8], found: &Block<'a>, unfinished: Unfinished) -> Result<&'a [u8], Failure> {
    if unfinished.last_block == Some(found.start) {
        return Ok(&bytes[found.start..]);
    }
    Ok(found.data)
}

struct Collected<'a> {
    file: &'a [u8],
    unfinished: Unfinished,
    records: Vec<u8>,
    invalid: Vec<u8>,
    columns: bool,
}

impl<'a> Collected<'a> {
    fn block(&mut self, found: &Block<'a>, depth: usize) -> Result<(), Failure> {
        match found.name {
            b"##DT" | b"##DV" => {
                self.columns |= found.name == b"##DV";
                let data = plain(self.file, found, self.unfinished)?;
                self.records.extend_from_slice(data);
                Ok(())
            }
            b"##DI" => {
                self.invalid.extend_from_slice(found.data);
                Ok(())
            }
            b"##DZ" => self.packed(found),
            b"##HL" if depth == 0 => {
                let first = block(self.file, found.link(0))?;
                self.block(&first, 1)
            }
            b"##DL" | b"##LD" if depth <= 1 => self.list(found),
            other => Err(Failure::damaged(format!("unexpected block {} among the data", other.escape_ascii()))),
        }
    }

    fn list(&mut self, first: &Block<'a>) -> Result<(), Failure> {
        let mut list = *first;
        let mut seen = HashSet::new();
        loop {
            if !seen.insert(list.start) {
                return Err(Failure::damaged("the list of data blocks runs in a circle".to_owned()));
            }
            for index in 1..list.links() {
                let link = list.link(index);
                if link != 0 {
                    let found = block(self.file, link)?;
                    self.block(&found, 2)?;
                }
            }
            if list.link(0) == 0 {
                return Ok(());
            }
            let next = block(self.file, list.link(0))?;
            if next.name != first.name {
                return Err(Failure::damaged("the list of data blocks is damaged".to_owned()));
            }
            list = next;
        }
    }

    fn packed(&mut self, found: &Block<'a>) -> Result<(), Failure> {
        let kind = found.data.get(..2).unwrap_or_default();
        let (method, columns) = (found.u8(2)?, found.u32(4)? as usize);
        let (original, packed) = (found.u64(8)?, found.u64(16)?);
        let held = (self.records.len() + self.invalid.len()) as u64;
        let most = LARGEST.max(FOLD.saturating_mul(self.file.len() as u64));
        if held.saturating_add(original) > most {
            return Err(Failure::damaged(format!(
                "it unpacks to more than {FOLD} times its size and 1 GiB, as no log does"
            )));
        }
        let data = usize::try_from(packed).ok().and_then(|packed| found.data.get(24..)?.get(..packed));
        let data = data.ok_or_else(|| Failure::damaged("the file ends within a packed block".to_owned()))?;
        let mut plain = Vec::new();
        let damaged = |e: std::io::Error| Failure::damaged(format!("a packed block is damaged: {e}"));
        match method {
            0 | 1 => ZlibDecoder::new(data).take(original).read_to_end(&mut plain).map_err(damaged)?,
            #[cfg(feature = "zstd")]
            2 | 3 => {
                let from = zstd::Decoder::with_buffer(data).map_err(damaged)?;
                from.take(original).read_to_end(&mut plain).map_err(damaged)?
            }
            #[cfg(feature = "mcap")]
            4 | 5 => {
                lz4_flex::frame::FrameDecoder::new(data).take(original).read_to_end(&mut plain).map_err(damaged)?
            }
            _ => return Err(Failure::damaged(format!("compression method {method} is not supported"))),
        };
        if plain.len() as u64 != original {
            return Err(Failure::damaged("a packed block is shorter than it claims".to_owned()));
        }
        // Bytes were sorted by their place in the record before compression; a rest stays at the end.
        if method % 2 == 1 && columns > 0 {
            let rows = plain.len() / columns;
            let mut sorted: Vec<u8> = Vec::with_capacity(plain.len());
            sorted.extend((0..rows * columns).map(|i| plain[i % columns * rows + i / columns]));
            sorted.extend_from_slice(&plain[rows * columns..]);
            plain = sorted;
        }
        match kind {
            b"DI" => self.invalid.append(&mut plain),
            b"DV" => {
                self.columns = true;
                self.records.append(&mut plain);
            }
            _ => self.records.append(&mut plain),
        }
        Ok(())
    }
}

/// The layout of the records of one channel group in a data group whose records are numbered.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub id: u64,
    /// Bytes of a record without its number; `None` if each states its own length.
    pub size: Option<usize>,
}

/// Records of several groups, sorted out; in the order of `layouts`. The second result is how many bytes are left
/// over at the end: the start of a record that was not written whole.
pub fn sort(records: &[u8], id_bytes: usize, layouts: &[Layout]) -> Result<(Vec<Vec<u8>>, usize), Failure> {
    let places: HashMap<u64, usize> = layouts.iter().enumerate().map(|(place, layout)| (layout.id, place)).collect();
    let mut sorted = vec![Vec::new(); layouts.len()];
    let mut at = 0;
    while at < records.len() {
        let rest = &records[at..];
        let Some((id, rest)) = rest.split_at_checked(id_bytes) else { break };
        let number = id.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
        let Some(place) = places.get(&number) else {
            return Err(Failure::damaged(format!("a record has the number {number}, which no channel group has")));
        };
        let (head, size) = match layouts[*place].size {
            Some(size) => (0, size),
            None => match rest.first_chunk::<4>() {
                Some(length) => (4, u32::from_le_bytes(*length) as usize),
                None => break,
            },
        };
        let Some(record) = rest.get(head..).and_then(|rest| rest.get(..size)) else { break };
        if layouts[*place].size.is_some() {
            sorted[*place].extend_from_slice(record);
        }
        at += id_bytes + head + size;
    }
    Ok((sorted, records.len() - at.min(records.len())))
}
