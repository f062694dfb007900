//! What writers that know Arrow tell of a Parquet column beyond Parquet's own types: durations.
//!
//! Durations are stored as plain integers; only the Arrow schema in the file's metadata (`ARROW:schema`: base64 of an
//! encapsulated IPC message, a flatbuffer) says so. The library's own reading of it would bring in all of Arrow.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use std::collections::HashMap;

/// Numbers of the types in Arrow's `Schema.fbs`.
const DURATION: u8 = 18;
/// Fields beyond this many are not looked at.
const MOST: usize = 1 << 20;

/// Units per second of the columns that hold durations, by name.
pub fn durations(schema: &str) -> HashMap<String, i64> {
    read(schema).unwrap_or_default()
}

fn read(schema: &str) -> Option<HashMap<String, i64>> {
    let message = BASE64_STANDARD.decode(schema.trim()).ok()?;
    // A continuation mark and a length stand before the flatbuffer; old writers leave the mark out.
    let message = message.strip_prefix(&[0xff; 4]).unwrap_or(&message).get(4..)?;
    let root = Table::root(message)?;
    let schema = root.table(2)?;
    let mut durations = HashMap::new();
    for field in schema.tables(1)? {
        if field.u8(2) == Some(DURATION) {
            let per_second = match field.table(3)?.i16(0).unwrap_or(1) {
                0 => 1,
                1 => 1_000,
                2 => 1_000_000,
                3 => 1_000_000_000,
                _ => continue,
            };
            durations.insert(field.text(0)?.to_owned(), per_second);
        }
    }
    Some(durations)
}

/// A table of a flatbuffer; every access is checked.
#[derive(Clone, Copy)]
struct Table<'a> {
    buffer: &'a [u8],
    at: usize,
}

impl<'a> Table<'a> {
    fn root(buffer: &'a [u8]) -> Option<Self> {
        Some(Self { buffer, at: u32_at(buffer, 0)? })
    }

    /// Place of a field, if the table has it.
    fn field(&self, index: usize) -> Option<usize> {
        let back = i32::from_le_bytes(*self.buffer.get(self.at..)?.first_chunk()?);
        let vtable = usize::try_from(i64::try_from(self.at).ok()? - i64::from(back)).ok()?;
        let size = usize::from(u16_at(self.buffer, vtable)?);
        let entry = 4 + 2 * index;
        let offset = if entry < size { u16_at(self.buffer, vtable + entry)? } else { 0 };
        (offset != 0).then(|| self.at + usize::from(offset))
    }

    fn target(&self, index: usize) -> Option<usize> {
        let place = self.field(index)?;
        place.checked_add(u32_at(self.buffer, place)?)
    }

    fn u8(&self, index: usize) -> Option<u8> {
        self.buffer.get(self.field(index)?).copied()
    }

    fn i16(&self, index: usize) -> Option<i16> {
        Some(u16_at(self.buffer, self.field(index)?)? as i16)
    }

    fn table(&self, index: usize) -> Option<Self> {
        Some(Self { buffer: self.buffer, at: self.target(index)? })
    }

    fn text(&self, index: usize) -> Option<&'a str> {
        let place = self.target(index)?;
        let length = u32_at(self.buffer, place)?;
        std::str::from_utf8(self.buffer.get(place + 4..)?.get(..length)?).ok()
    }

    fn tables(&self, index: usize) -> Option<Vec<Self>> {
        let place = self.target(index)?;
        let count = u32_at(self.buffer, place)?.min(MOST);
        let entry = |k: usize| {
            let slot = place + 4 + 4 * k;
            Some(Self { buffer: self.buffer, at: slot.checked_add(u32_at(self.buffer, slot)?)? })
        };
        (0..count).map(entry).collect()
    }
}

fn u16_at(buffer: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*buffer.get(at..)?.first_chunk()?))
}

fn u32_at(buffer: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(*buffer.get(at..)?.first_chunk()?)).ok()
}
