//! The blocks of an MDF4 file: every access is checked against the file's end.

use super::Failure;

/// Blocks begin with a name, four spare bytes, a length and the number of links.
const HEAD: usize = 24;

/// One block: its links and what follows them.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    pub name: &'a [u8; 4],
    links: &'a [u8],
    pub data: &'a [u8],
    /// Where its data begin in the file.
    pub start: usize,
}

/// The block at this place.
pub fn block(bytes: &[u8], at: u64) -> Result<Block<'_>, Failure> {
    let cut = || Failure::damaged(format!("the file ends within a block, or a link leads nowhere (at {at:#x})"));
    let at = usize::try_from(at).map_err(|_| cut())?;
    let from = bytes.get(at..).ok_or_else(cut)?;
    let (head, rest) = from.split_at_checked(HEAD).ok_or_else(cut)?;
    let name = head.first_chunk::<4>().ok_or_else(cut)?;
    let length = usize::try_from(u64_at(head, 8)).map_err(|_| cut())?.saturating_sub(HEAD);
    let links = usize::try_from(u64_at(head, 16)).ok().and_then(|count| count.checked_mul(8)).ok_or_else(cut)?;
    if links > length || name[..2] != *b"##" {
        return Err(Failure::damaged(format!("there is no block at {at:#x}")));
    }
    let (links, data) = rest.split_at_checked(links).ok_or_else(cut)?;
    let start = at + HEAD + links.len();
    // A block that claims more than the file holds: its user decides whether that matters.
    let data = &data[..data.len().min(length - links.len())];
    Ok(Block { name, links, data, start })
}

/// The block at this place, which must have this name.
pub fn named<'a>(bytes: &'a [u8], at: u64, name: &[u8; 4]) -> Result<Block<'a>, Failure> {
    let found = block(bytes, at)?;
    if found.name != name {
        let (found, name) = (found.name.escape_ascii(), name.escape_ascii());
        return Err(Failure::damaged(format!("a block {name} is expected at {at:#x}, but there is {found}")));
    }
    Ok(found)
}

impl<'a> Block<'a> {
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
pub fn text(bytes: &[u8], link: u64) -> Result<String, Failure> {
    if link == 0 {
        return Ok(String::new());
    }
    let found = block(bytes, link)?;
    let end = found.data.iter().position(|byte| *byte == 0).unwrap_or(found.data.len());
    let text = String::from_utf8_lossy(&found.data[..end]).into_owned();
    let inner = || {
        let (_, rest) = text.split_once("<TX")?;
        let (inner, _) = rest.split_once('>')?.1.split_once("</TX>")?;
        Some(inner.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    };
    let text = if found.name == b"##MD" { inner().unwrap_or_default() } else { text };
    Ok(text.trim().to_owned())
}

/// A list of blocks that are linked by their first link.
pub fn chain<'a>(bytes: &'a [u8], first: u64, name: &[u8; 4]) -> Result<Vec<(u64, Block<'a>)>, Failure> {
    let mut list = Vec::new();
    let mut seen = std::collections::HashSet::new();
    let mut next = first;
    while next != 0 {
        if !seen.insert(next) {
            return Err(Failure::damaged(format!("a list of blocks {} runs in a circle", name.escape_ascii())));
        }
        let found = named(bytes, next, name)?;
        list.push((next, found));
        next = found.link(0);
    }
    Ok(list)
}
