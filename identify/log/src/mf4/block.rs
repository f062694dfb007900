//! The blocks of an MDF4 file: every access is checked against the file's end.

use super::Failure;
use super::bytes::Bytes;
use std::collections::HashSet;

/// Blocks begin with a name, four spare bytes, a length and the number of links.
const HEAD: usize = 24;
/// Kept of the data of texts and conversions: more than the longest conversion table (65535 values) has.
const LARGEST: u64 = 1 << 20;
/// Kept of the data of every other block, which is all but the records themselves.
const SMALL: u64 = 128;

/// One block: its links and what follows them.
#[derive(Clone, Debug)]
pub struct Block {
    pub name: [u8; 4],
    links: Vec<u8>,
    /// What follows the links, or the start of it.
    data: Vec<u8>,
    /// Where its data begin in the file, and how long they are, at most to the file's end.
    pub start: u64,
    pub length: u64,
}

/// The block at this place.
pub fn block(file: &Bytes, at: u64) -> Result<Block, Failure> {
    let cut = || Failure::damaged(format!("the file ends within a block, or a link leads nowhere (at {at:#x})"));
    let head = file.few(at, HEAD)?;
    let (Some(name), HEAD) = (head.first_chunk::<4>(), head.len()) else { return Err(cut()) };
    let length = u64_at(&head, 8).saturating_sub(HEAD as u64);
    let links = u64_at(&head, 16).checked_mul(8).ok_or_else(cut)?;
    if links > length || name[..2] != *b"##" {
        return Err(Failure::damaged(format!("there is no block at {at:#x}")));
    }
    let after = at + HEAD as u64;
    if links > file.length() - after {
        return Err(cut());
    }
    let start = after + links;
    // A block that claims more than the file holds: its user decides whether that matters.
    let length = (length - links).min(file.length() - start);
    let kept = if matches!(name, b"##TX" | b"##MD" | b"##CC") { LARGEST } else { SMALL };
    let most = if matches!(name, b"##DL" | b"##LD") { links } else { links.min(LARGEST) };
    let links = file.few(after, most as usize)?;
    let data = file.few(start, length.min(kept) as usize)?;
    Ok(Block { name: *name, links, data, start, length })
}

/// The block at this place, which must have this name.
pub fn named(file: &Bytes, at: u64, name: &[u8; 4]) -> Result<Block, Failure> {
    let found = block(file, at)?;
    if found.name != *name {
        let (found, name) = (found.name.escape_ascii(), name.escape_ascii());
        return Err(Failure::damaged(format!("a block {name} is expected at {at:#x}, but there is {found}")));
    }
    Ok(found)
}

impl Block {
    /// A link; 0 leads nowhere, as do links that the block does not have.
    pub fn link(&self, index: usize) -> u64 {
        self.links.get(8 * index..8 * index + 8).map_or(0, |link| u64_at(link, 0))
    }

    /// Number of links.
    pub fn links(&self) -> usize {
        self.links.len() / 8
    }

    fn part<const N: usize>(&self, at: usize) -> Result<[u8; N], Failure> {
        let part = self.data.get(at..).and_then(<[u8]>::first_chunk);
        part.copied().ok_or_else(|| Failure::damaged(format!("a block {} is too short", self.name.escape_ascii())))
    }

    pub fn u8(&self, at: usize) -> Result<u8, Failure> {
        Ok(self.part::<1>(at)?[0])
    }

    pub fn u16(&self, at: usize) -> Result<u16, Failure> {
        Ok(u16::from_le_bytes(self.part(at)?))
    }

    pub fn u32(&self, at: usize) -> Result<u32, Failure> {
        Ok(u32::from_le_bytes(self.part(at)?))
    }

    pub fn u64(&self, at: usize) -> Result<u64, Failure> {
        Ok(u64::from_le_bytes(self.part(at)?))
    }

    pub fn f64(&self, at: usize) -> Result<f64, Failure> {
        Ok(f64::from_le_bytes(self.part(at)?))
    }
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes[at..].first_chunk().map_or(0, |word| u64::from_le_bytes(*word))
}

/// The text behind a link: of a text block, or the one in `<TX>` of an XML block. Empty without a link.
pub fn text(file: &Bytes, link: u64) -> Result<String, Failure> {
    if link == 0 {
        return Ok(String::new());
    }
    let found = block(file, link)?;
    let end = found.data.iter().position(|byte| *byte == 0).unwrap_or(found.data.len());
    let text = String::from_utf8_lossy(&found.data[..end]).into_owned();
    let inner = || {
        let (_, rest) = text.split_once("<TX")?;
        let (inner, _) = rest.split_once('>')?.1.split_once("</TX>")?;
        Some(inner.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    };
    let text = if found.name == *b"##MD" { inner().unwrap_or_default() } else { text };
    Ok(text.trim().to_owned())
}

/// A list of blocks that are linked by their first link, each with its place.
pub fn chain<'a>(file: &'a Bytes, first: u64, name: &'static [u8; 4]) -> Chain<'a> {
    Chain { file, next: first, name, seen: HashSet::new() }
}

/// See [`chain`].
pub struct Chain<'a> {
    file: &'a Bytes,
    next: u64,
    name: &'static [u8; 4],
    seen: HashSet<u64>,
}

impl Iterator for Chain<'_> {
    type Item = Result<(u64, Block), Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        let at = std::mem::take(&mut self.next);
        if at == 0 {
            return None;
        }
        if !self.seen.insert(at) {
            let what = format!("a list of blocks {} runs in a circle", self.name.escape_ascii());
            return Some(Err(Failure::damaged(what)));
        }
        let found = named(self.file, at, self.name);
        if let Ok(found) = &found {
            self.next = found.link(0);
        }
        Some(found.map(|found| (at, found)))
    }
}
