//! The data of a data group: out of lists of blocks, packed or not, in pieces of whole or part blocks, and sorted into
//! channel groups. At no time more than a piece is in memory.

use super::block::{Block, block};
use super::bytes::Bytes;
use super::{Error, Failure};
use flate2::read::ZlibDecoder;
use std::collections::{HashMap, HashSet};
use std::io::Read;

/// Data that grow beyond this many bytes and this many times the file, as packed ones or by repetition, are no log.
const LARGEST: u64 = 1 << 30;
const FOLD: u64 = 200;
/// Bytes that are read at once of a block that is not packed: few enough for a processor's nearer memory.
const PIECE: u64 = 1 << 18;

/// The data behind a link: the records, and the invalidation bytes that are stored apart from them.
#[derive(Debug, Default)]
pub struct Stream {
    pub records: Pieces,
    pub invalid: Pieces,
    /// The bytes of each record stand one after the other, without record numbers.
    pub column_oriented: bool,
}

/// What is left to do in a file whose writer did not come to its end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unfinished {
    /// The last data block is longer than it claims: it goes on to the end of the file.
    pub last_block: Option<u64>,
}

/// Data that are read piece by piece.
#[derive(Debug, Default)]
pub struct Pieces {
    blocks: Vec<Data>,
    /// Bytes of all blocks, unpacked.
    pub total: u64,
    /// The block that is being read and how much of it has been.
    next: usize,
    read: u64,
}

/// The data of one block.
#[derive(Clone, Copy, Debug)]
struct Data {
    at: u64,
    length: u64,
    packed: Option<Packed>,
}

/// How the data of a block were packed.
#[derive(Clone, Copy, Debug)]
struct Packed {
    method: u8,
    /// Bytes of a record, where they were sorted by their place in it.
    columns: usize,
    original: u64,
}

/// The data behind a link.
pub fn stream(file: &Bytes, link: u64, unfinished: Unfinished) -> Result<Stream, Failure> {
    let mut to = Collected { file, unfinished, stream: Stream::default() };
    if link != 0 {
        to.block(&block(file, link)?, 0)?;
    }
    Ok(to.stream)
}

struct Collected<'a> {
    file: &'a Bytes,
    unfinished: Unfinished,
    stream: Stream,
}

impl Collected<'_> {
    fn block(&mut self, found: &Block, depth: usize) -> Result<(), Failure> {
        match &found.name {
            b"##DT" | b"##DV" | b"##DI" => {
                let last = self.unfinished.last_block == Some(found.start);
                let length = if last { self.file.length() - found.start } else { found.length };
                self.push([found.name[2], found.name[3]], Data { at: found.start, length, packed: None })
            }
            b"##DZ" => self.packed(found),
            b"##HL" if depth == 0 => self.block(&block(self.file, found.link(0))?, 1),
            b"##DL" | b"##LD" if depth <= 1 => self.list(found),
            other => Err(Failure::damaged(format!("unexpected block {} among the data", other.escape_ascii()))),
        }
    }

    fn list(&mut self, first: &Block) -> Result<(), Failure> {
        let mut list = first.clone();
        let mut seen = HashSet::new();
        loop {
            if !seen.insert(list.start) {
                return Err(Failure::damaged("the list of data blocks runs in a circle".to_owned()));
            }
            for index in 1..list.links() {
                let link = list.link(index);
                if link != 0 {
                    self.block(&block(self.file, link)?, 2)?;
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

    fn packed(&mut self, found: &Block) -> Result<(), Failure> {
        let kind = [found.u8(0)?, found.u8(1)?];
        let (method, columns) = (found.u8(2)?, found.u32(4)? as usize);
        let (original, length) = (found.u64(8)?, found.u64(16)?);
        if found.length.checked_sub(24).is_none_or(|held| held < length) {
            return Err(Failure::damaged("the file ends within a packed block".to_owned()));
        }
        let packed = Some(Packed { method, columns, original });
        self.push(kind, Data { at: found.start + 24, length, packed })
    }

    fn push(&mut self, kind: [u8; 2], data: Data) -> Result<(), Failure> {
        let Stream { records, invalid, column_oriented } = &mut self.stream;
        let size = data.packed.map_or(data.length, |packed| packed.original);
        let most = LARGEST.max(FOLD.saturating_mul(self.file.length()));
        if (records.total + invalid.total).saturating_add(size) > most {
            return Err(Failure::damaged(format!(
                "it unpacks to more than {FOLD} times its size and 1 GiB, as no log does"
            )));
        }
        *column_oriented |= kind == *b"DV";
        let to = if kind == *b"DI" { invalid } else { records };
        // A block is at least its head of 24 bytes.
        if to.blocks.len() as u64 > self.file.length() / 24 {
            return Err(Failure::damaged("the list of data blocks is damaged".to_owned()));
        }
        to.total += size;
        to.blocks.push(data);
        Ok(())
    }
}

impl Pieces {
    /// Appends the next bytes to those that are there; false at the end.
    pub fn more(&mut self, file: &Bytes, to: &mut Vec<u8>) -> Result<bool, Failure> {
        let Some(data) = self.blocks.get(self.next) else { return Ok(false) };
        match data.packed {
            Some(packed) => {
                unpack(file, data, packed, to)?;
                self.next += 1;
            }
            None => {
                let count = PIECE.min(data.length - self.read);
                file.append(data.at + self.read, count, to)?;
                self.read += count;
                if self.read == data.length {
                    (self.next, self.read) = (self.next + 1, 0);
                }
            }
        }
        Ok(true)
    }
}

/// Appends the data of a packed block.
fn unpack(
    file: &Bytes,
    data: &Data,
    Packed { method, columns, original }: Packed,
    to: &mut Vec<u8>,
) -> Result<(), Failure> {
    let mut bytes = Vec::new();
    file.append(data.at, data.length, &mut bytes)?;
    let start = to.len();
    let damaged = |e: std::io::Error| Failure::damaged(format!("a packed block is damaged: {e}"));
    match method {
        0 | 1 => ZlibDecoder::new(bytes.as_slice()).take(original).read_to_end(to).map_err(damaged)?,
        #[cfg(feature = "zstd")]
        2 | 3 => {
            let from = zstd::Decoder::with_buffer(bytes.as_slice()).map_err(damaged)?;
            from.take(original).read_to_end(to).map_err(damaged)?
        }
        #[cfg(feature = "mcap")]
        4 | 5 => {
            lz4_flex::frame::FrameDecoder::new(bytes.as_slice()).take(original).read_to_end(to).map_err(damaged)?
        }
        _ => return Err(Failure::damaged(format!("compression method {method} is not supported"))),
    };
    let plain = &mut to[start..];
    if plain.len() as u64 != original {
        return Err(Failure::damaged("a packed block is shorter than it claims".to_owned()));
    }
    // Bytes were sorted by their place in the record before compression; a rest stays at the end.
    if method % 2 == 1 && columns > 0 {
        let rows = plain.len() / columns;
        bytes.clear();
        bytes.extend_from_slice(&plain[..rows * columns]);
        for (column, bytes) in bytes.chunks_exact(rows.max(1)).enumerate() {
            for (row, byte) in bytes.iter().enumerate() {
                plain[row * columns + column] = *byte;
            }
        }
    }
    Ok(())
}

/// The records of one channel group in a data group whose records are numbered.
#[derive(Debug, Default)]
pub struct Numbered {
    pub id: u64,
    /// Bytes of a record without its number; `None` if each states its own length.
    pub size: Option<usize>,
    /// Number of records so far.
    pub count: u64,
    /// Whole records that came with the last piece.
    pub records: Vec<u8>,
}

/// Sorts the records of several groups out; after every piece `each` is told. The result is how many bytes are left over
/// at the end: the start of a record that was not written whole.
pub fn sort(
    pieces: &mut Pieces,
    file: &Bytes,
    id_bytes: usize,
    groups: &mut [Numbered],
    mut each: impl FnMut(&[Numbered]) -> Result<(), Error>,
) -> Result<u64, Error> {
    let places: HashMap<u64, usize> = groups.iter().enumerate().map(|(place, group)| (group.id, place)).collect();
    let mut buffer = Vec::new();
    // Of a long record that states its own length: what is still to come, and what has come.
    let (mut to_come, mut come) = (0, 0);
    loop {
        if !pieces.more(file, &mut buffer)? {
            return Ok(if to_come > 0 { come } else { buffer.len() as u64 });
        }
        let skipped = buffer.len().min(to_come);
        (to_come, come) = (to_come - skipped, come + skipped as u64);
        let mut at = skipped;
        while to_come == 0 && at < buffer.len() {
            let Some((id, rest)) = buffer[at..].split_at_checked(id_bytes) else { break };
            let number = id.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
            let Some(place) = places.get(&number) else {
                return Err(
                    Failure::damaged(format!("a record has the number {number}, which no channel group has")).into()
                );
            };
            let group = &mut groups[*place];
            at += match group.size {
                Some(size) => {
                    let Some(record) = rest.get(..size) else { break };
                    group.records.extend_from_slice(record);
                    group.count += 1;
                    id_bytes + size
                }
                None => {
                    let Some((length, rest)) = rest.split_first_chunk::<4>() else { break };
                    let size = u32::from_le_bytes(*length) as usize;
                    let held = size.min(rest.len());
                    (to_come, come) = (size - held, (id_bytes + 4 + held) as u64);
                    id_bytes + 4 + held
                }
            };
        }
        each(groups)?;
        groups.iter_mut().for_each(|group| group.records.clear());
        buffer.drain(..at);
    }
}
