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

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::ZlibEncoder};
    use std::io::Write;

    fn block(name: &[u8; 4], links: &[usize], data: &[u8]) -> Vec<u8> {
        let mut block = [name.as_slice(), &[0; 4]].concat();
        block.extend_from_slice(&((HEAD + 8 * links.len() + data.len()) as u64).to_le_bytes());
        block.extend_from_slice(&(links.len() as u64).to_le_bytes());
        links.iter().for_each(|link| block.extend_from_slice(&(*link as u64).to_le_bytes()));
        block.extend_from_slice(data);
        block.resize(block.len().next_multiple_of(8), 0);
        block
    }

    fn packed(method: u8, columns: u32, original: &[u8]) -> Vec<u8> {
        let mut sorted = original.to_vec();
        if method == 1 {
            let (columns, rows) = (columns as usize, original.len() / columns as usize);
            for i in 0..rows * columns {
                sorted[i % columns * rows + i / columns] = original[i];
            }
        }
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&sorted).unwrap();
        let data = encoder.finish().unwrap();
        let mut fields = [b"DT".as_slice(), &[method, 0], &columns.to_le_bytes()].concat();
        fields.extend_from_slice(&(original.len() as u64).to_le_bytes());
        fields.extend_from_slice(&(data.len() as u64).to_le_bytes());
        block(b"##DZ", &[], &[fields, data].concat())
    }

    /// A file with one data group whose list holds a packed, a transposed and a plain block.
    fn file(parts: [&[u8]; 3]) -> Vec<u8> {
        let mut bytes = vec![0; 64];
        let group = 64 + 88;
        bytes.extend(block(b"##HD", &[group], &[0; 56]));
        assert_eq!(bytes.len(), group);
        let list = group + 64;
        bytes.extend(block(b"##DG", &[0, 0, list, 0], &[0; 8]));
        assert_eq!(bytes.len(), list);
        let blocks = [packed(0, 0, parts[0]), packed(1, 5, parts[1]), block(b"##DT", &[], parts[2])];
        let first = list + HEAD + 8 * 4;
        let links = [0, first, first + blocks[0].len(), first + blocks[0].len() + blocks[1].len()];
        bytes.extend(block(b"##DL", &links, &[]));
        bytes.extend(blocks.concat());
        bytes
    }

    const PARTS: [&[u8]; 3] = [b"first, first, first", b"the second part, its bytes sorted", b"and a plain one!"];

    #[test]
    fn packed_and_sorted_blocks_become_one_plain_block() {
        let plain = inflate(file(PARTS)).unwrap();
        let data = word(&plain, 64 + 88 + DATA_LINK).unwrap();
        assert_eq!(name(&plain, data), Ok(b"##DT".as_slice()));
        assert_eq!(&plain[data + HEAD..], PARTS.concat());
        assert_eq!(word(&plain, data + 8), Ok(HEAD + PARTS.concat().len()));
    }

    #[test]
    fn damage_is_an_error_and_never_a_panic() {
        let whole = file(PARTS);
        for place in 0..whole.len() {
            for bits in [0x01, 0x80, 0xff] {
                let mut flipped = whole.clone();
                flipped[place] ^= bits;
                let _ = inflate(flipped);
            }
            let _ = inflate(whole[..place].to_vec());
        }
        let mut ring = whole.clone();
        let own = (64 + 88_u64).to_le_bytes();
        ring[64 + 88 + HEAD..64 + 88 + HEAD + 8].copy_from_slice(&own);
        assert!(inflate(ring).unwrap_err().contains("circle"));
    }
}
