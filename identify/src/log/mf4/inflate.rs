//! Compressed data blocks of MDF4 (`##DZ`), which the reading library does not know.
//!
//! Each data group whose data are compressed gets one plain data block, appended to the file's
//! bytes, and its link is turned to that.

use flate2::read::ZlibDecoder;
use std::collections::HashSet;
use std::io::Read;

/// Blocks begin with a name, four spare bytes, a length and the number of links.
const HEAD: usize = 24;
/// The header block follows the 64 bytes of identification; its first link is the first data group.
const FIRST_GROUP: usize = 64 + HEAD;
/// Place of the data link in a data group.
const DATA_LINK: usize = HEAD + 16;
/// No compressed log is larger than this after decompression, bytes.
const LARGEST: u64 = 1 << 33;

/// The file with all compressed data groups made plain.
pub fn inflate(mut bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    let mut seen = HashSet::new();
    let mut group = word(&bytes, FIRST_GROUP)?;
    while group != 0 {
        if !seen.insert(group) {
            return Err("the list of data groups runs in a circle".to_owned());
        }
        let data = word(&bytes, group + DATA_LINK)?;
        if data != 0 && matches!(name(&bytes, data)?, b"##DZ" | b"##HL" | b"##DL") {
            let mut plain = Vec::new();
            let compressed = collect(&bytes, data, &mut plain)?;
            if compressed || name(&bytes, data)? == b"##HL" {
                bytes.resize(bytes.len().next_multiple_of(8), 0);
                let link = bytes.len() as u64;
                bytes.extend_from_slice(b"##DT\0\0\0\0");
                bytes.extend_from_slice(&((plain.len() + HEAD) as u64).to_le_bytes());
                bytes.extend_from_slice(&0_u64.to_le_bytes());
                bytes.append(&mut plain);
                bytes[group + DATA_LINK..group + DATA_LINK + 8].copy_from_slice(&link.to_le_bytes());
            }
        }
        group = word(&bytes, group + HEAD)?;
    }
    Ok(bytes)
}

/// Appends the data of a block, or of a list of blocks; returns whether any was compressed.
fn collect(bytes: &[u8], block: usize, to: &mut Vec<u8>) -> Result<bool, String> {
    match name(bytes, block)? {
        b"##HL" => collect(bytes, word(bytes, block + HEAD)?, to),
        b"##DL" => {
            let mut compressed = false;
            let mut seen = HashSet::new();
            let mut list = block;
            while list != 0 {
                if !seen.insert(list) || name(bytes, list)? != b"##DL" {
                    return Err("the list of data blocks is damaged".to_owned());
                }
                let links = word(bytes, list + 16)?;
                for link in 1..links.min(bytes.len() / 8) {
                    let data = word(bytes, list + HEAD + 8 * link)?;
                    if data != 0 {
                        if matches!(name(bytes, data)?, b"##DL" | b"##HL") {
                            return Err("a list of data blocks holds another list".to_owned());
                        }
                        compressed |= collect(bytes, data, to)?;
                    }
                }
                list = word(bytes, list + HEAD)?;
            }
            Ok(compressed)
        }
        b"##DZ" => unpack(bytes, block, to).map(|()| true),
        b"##DT" | b"##DV" => {
            let length = word(bytes, block + 8)?;
            to.extend_from_slice(part(bytes, block.saturating_add(HEAD), length.saturating_sub(HEAD))?);
            Ok(false)
        }
        other => Err(format!("unexpected block {} among the data", String::from_utf8_lossy(other).escape_debug())),
    }
}

/// Appends the content of one compressed block.
fn unpack(bytes: &[u8], block: usize, to: &mut Vec<u8>) -> Result<(), String> {
    let fields = part(bytes, block.saturating_add(HEAD), 24)?;
    let (method, columns) = (fields[2], word(fields, 4)? & 0xffff_ffff);
    let (original, packed) = (word(fields, 8)?, word(fields, 16)?);
    if original as u64 > LARGEST {
        return Err("a compressed block claims to be larger than 8 GiB".to_owned());
    }
    let data = part(bytes, block.saturating_add(HEAD + 24), packed)?;
    let start = to.len();
    let read = ZlibDecoder::new(data).take(original as u64).read_to_end(to);
    if read.map_err(|e| format!("a compressed block is damaged: {e}"))? != original {
        return Err("a compressed block is shorter than it claims".to_owned());
    }
    match method {
        0 => Ok(()),
        // Bytes were sorted by their place in the record before compression; a rest stays at the end.
        1 if columns > 0 => {
            let sorted = to.split_off(start);
            let rows = original / columns;
            to.extend((0..rows * columns).map(|i| sorted[i % columns * rows + i / columns]));
            to.extend_from_slice(&sorted[rows * columns..]);
            Ok(())
        }
        _ => Err(format!("compression method {method} is not supported")),
    }
}

fn part(bytes: &[u8], from: usize, length: usize) -> Result<&[u8], String> {
    let end = from.checked_add(length).filter(|end| *end <= bytes.len());
    end.map(|end| &bytes[from..end]).ok_or_else(|| "the file ends within a block".to_owned())
}

fn name(bytes: &[u8], block: usize) -> Result<&[u8], String> {
    part(bytes, block, 4)
}

fn word(bytes: &[u8], at: usize) -> Result<usize, String> {
    let text = part(bytes, at, 8)?;
    let number = u64::from_le_bytes(text.try_into().unwrap_or_default());
    usize::try_from(number).map_err(|_| "a link points outside of the file".to_owned())
}
