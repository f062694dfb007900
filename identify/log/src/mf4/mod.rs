//! MDF4 (`.mf4`): channel groups with clocks of their own.
//!
//! The library that writes these files (`mf4-rs`) is not used to read them: it loses records that lie across two data
//! blocks, knows neither unsorted groups, unfinished files, packed blocks nor floats of 16 bits, and decodes unsigned fields
//! that reach into a ninth byte wrongly. Bringing files into the form that it does know takes as much as reading them.

mod block;
mod channel;
mod conversion;
mod data;
mod write;

pub(super) use write::write;

use crate::LogError;
use crate::error::listed;
use crate::progress::Progress;
use crate::recording::{Clock, Column, Group, Place, Recording, Values};
use crate::wanted::Wanted;
use block::{Block, chain, named, text};
use channel::{Field, Invalid, Kind, Records};
use conversion::Conversion;
use data::{Layout, Stream, Unfinished};
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Channels are nested in others at most so deep.
const DEEPEST: usize = 16;

/// Why a file or a part of it cannot be read.
#[derive(Debug)]
pub(crate) struct Failure {
    what: String,
    /// Only this channel is not understood; the file is good.
    foreign: bool,
}

impl Failure {
    fn damaged(what: String) -> Self {
        Self { what, foreign: false }
    }

    fn foreign(what: String) -> Self {
        Self { what, foreign: true }
    }
}

/// Reads a file.
pub(super) fn read(path: &Path, wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let what = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    progress.start(format!("reading {what}"), bytes.len() as u64);
    let recording = parse(&name, &bytes, wanted, progress);
    progress.finish();
    recording
}

/// The parser itself, over the bytes of a file.
pub(super) fn parse(name: &str, bytes: &[u8], wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let fail = |failure: Failure| LogError::file(name, format!("not a readable MDF4 file: {}", failure.what));
    let mut notes = Vec::new();
    let mut file = File::open(bytes, wanted).map_err(fail)?;
    let mut groups = Vec::new();
    for (_, dg) in chain(bytes, file.first, b"##DG").map_err(fail)? {
        progress.check()?;
        file.data_group(&dg, &mut groups).map_err(fail)?;
    }
    file.share_clocks(&mut groups);
    if file.unfinished {
        let mut repairs = vec!["records counted".to_owned()];
        if file.ends.last_block.is_some() {
            repairs.push("the last data block taken to the end of the file".to_owned());
        }
        if file.left_over > 0 {
            repairs.push(format!("{} bytes of a record that was not written whole left out", file.left_over));
        }
        if file.custom != 0 {
            repairs.push(format!("what is left to the logger's own program (flags {:#x}) not done", file.custom));
        }
        notes.push(format!("was not finished by its logger; repaired in memory: {}", repairs.join(", ")));
    }
    if !file.texts.is_empty() {
        let names = listed(file.texts.iter().map(String::as_str));
        notes.push(format!("missing where a text stands among numbers: {names}"));
    }
    let own = groups.len();
    let sha256 = crate::hash::of_bytes(bytes);
    Ok(Recording { file: name.to_owned(), sha256, groups, own, notes, place: Place::Samples, loader: None })
}

/// A file that is being read.
struct File<'a> {
    bytes: &'a [u8],
    wanted: &'a Wanted<'a>,
    /// The first data group.
    first: u64,
    unfinished: bool,
    ends: Unfinished,
    /// Flags of steps that only the logger's own program knows.
    custom: u16,
    /// Bytes of records that were not written whole.
    left_over: usize,
    /// Channels with texts among their numbers.
    texts: Vec<String>,
    /// Groups by the place of their block, and those whose clock is another group's.
    places: HashMap<u64, usize>,
    remote: Vec<(usize, u64)>,
}

impl<'a> File<'a> {
    fn open(bytes: &'a [u8], wanted: &'a Wanted<'a>) -> Result<Self, Failure> {
        let identification = bytes.get(..64).ok_or_else(|| Failure::damaged("the file is too short".to_owned()))?;
        let unfinished = match &identification[..8] {
            b"MDF     " => false,
            b"UnFinMF " => true,
            _ => return Err(Failure::damaged("it does not begin as one".to_owned())),
        };
        if matches!(identification[8], b'0'..b'4') {
            let version = String::from_utf8_lossy(&identification[8..16]).trim().escape_debug().to_string();
            let what =
                format!("it is MDF {version}, of an older generation; asammdf, for example, converts it to MDF 4");
            return Err(Failure::damaged(what));
        }
        let flags = |at: usize| u16::from_le_bytes([identification[at], identification[at + 1]]);
        let header = named(bytes, 64, b"##HD")?;
        let mut file = Self {
            bytes,
            wanted,
            first: header.link(0),
            unfinished,
            ends: Unfinished::default(),
            custom: flags(62),
            left_over: 0,
            texts: Vec::new(),
            places: HashMap::new(),
            remote: Vec::new(),
        };
        if unfinished && flags(60) & 4 != 0 {
            file.ends.last_block = file.last_block()?;
        }
        Ok(file)
    }

    /// Where the data of the last data block begin, if nothing stands behind them.
    fn last_block(&self) -> Result<Option<usize>, Failure> {
        let mut last = None;
        for (_, dg) in chain(self.bytes, self.first, b"##DG")? {
            let mut links = vec![dg.link(2)];
            let mut seen = HashSet::new();
            while let Some(link) = links.pop() {
                if link == 0 || !seen.insert(link) {
                    continue;
                }
                let found = block::block(self.bytes, link)?;
                match found.name {
                    // A block that another one follows was written whole.
                    b"##DT" | b"##DV" if !self.followed(&found) => last = last.max(Some(found.start)),
                    b"##HL" | b"##DL" | b"##LD" => links.extend((0..found.links()).map(|index| found.link(index))),
                    _ => {}
                }
            }
        }
        Ok(last)
    }

    /// Whether a block ends where the file ends or another block begins.
    fn followed(&self, found: &Block) -> bool {
        let end = found.start + found.data.len();
        let next = self.bytes.get(end.next_multiple_of(8)..).unwrap_or_default();
        !found.data.is_empty() && (end == self.bytes.len() || next.starts_with(b"##") || next.is_empty())
    }

    /// Reads all channel groups of a data group.
    fn data_group(&mut self, dg: &Block<'a>, groups: &mut Vec<Group>) -> Result<(), Failure> {
        let id_bytes = usize::from(dg.u8(0)?);
        if !matches!(id_bytes, 0 | 1 | 2 | 4 | 8) {
            return Err(Failure::damaged(format!("records are numbered with {id_bytes} bytes")));
        }
        let list = chain(self.bytes, dg.link(1), b"##CG")?;
        let stream = data::stream(self.bytes, dg.link(2), self.ends)?;
        let mut layouts = Vec::new();
        for (_, cg) in &list {
            let varying = cg.u16(16)? & 1 != 0;
            let size = cg.u32(24)? as usize + if stream.column_oriented { 0 } else { cg.u32(28)? as usize };
            layouts.push(Layout { id: cg.u64(0)?, size: (!varying).then_some(size) });
        }
        let Stream { records, invalid, column_oriented } = stream;
        let sorted = match list.len() {
            0 => return Ok(()),
            1 if id_bytes == 0 => vec![records],
            _ if id_bytes == 0 => {
                return Err(Failure::damaged("records of several channel groups are not numbered".to_owned()));
            }
            _ => {
                let (sorted, left_over) = data::sort(&records, id_bytes, &layouts)?;
                if left_over > 0 && !self.unfinished {
                    return Err(Failure::damaged("the data end within a record".to_owned()));
                }
                self.left_over += left_over;
                sorted.into_iter().map(Into::into).collect()
            }
        };
        for (((at, cg), layout), bytes) in list.iter().zip(&layouts).zip(&sorted) {
            let Some(stride) = layout.size else { continue };
            self.places.insert(*at, groups.len());
            if cg.u16(16)? & 8 != 0 {
                self.remote.push((groups.len(), cg.link(6)));
            }
            let count = self.count(cg, bytes.len(), stride, groups.len())?;
            let own = cg.u32(24)? as usize;
            let apart = cg.u32(28)? as usize;
            let invalid = if column_oriented { (invalid.as_slice(), apart, 0) } else { (bytes.as_ref(), stride, own) };
            let records = Records { bytes, stride, count, invalid };
            groups.push(self.group(cg, &records, own)?);
        }
        Ok(())
    }

    /// Number of records of a group: as it says, or as there are in a file that was not finished.
    fn count(&mut self, cg: &Block, bytes: usize, stride: usize, index: usize) -> Result<usize, Failure> {
        let claimed = cg.u64(8)?;
        // Channels that store nothing have as many values as the group claims.
        let held = bytes.checked_div(stride).map_or(claimed, |held| held as u64);
        if self.unfinished {
            self.left_over += bytes.checked_rem(stride).unwrap_or(0);
            return Ok(held as usize);
        }
        if stride == 0 && claimed > (1 << 27) {
            return Err(Failure::damaged(format!("group {index} claims {claimed} records without data")));
        }
        if claimed > held {
            return Err(Failure::damaged(format!("group {index} claims {claimed} records, but there are {held}")));
        }
        Ok(claimed as usize)
    }

    fn group(&mut self, cg: &Block<'a>, records: &Records, record: usize) -> Result<Group, Failure> {
        let mut name = text(self.bytes, cg.link(2))?;
        if name.is_empty() && cg.link(3) != 0 {
            let source = named(self.bytes, cg.link(3), b"##SI")?;
            name = text(self.bytes, source.link(0))?;
        }
        let mut group = Group { name, clock: Clock::None("has no time channel".to_owned()), columns: Vec::new() };
        self.channels(cg.link(1), records, record, &mut group, 0)?;
        Ok(group)
    }

    /// Adds a list of channels, and those they are made of, to a group.
    fn channels(
        &mut self,
        first: u64,
        records: &Records,
        record: usize,
        group: &mut Group,
        depth: usize,
    ) -> Result<(), Failure> {
        for (_, cn) in chain(self.bytes, first, b"##CN")? {
            let (kind, sync) = (cn.u8(0)?, cn.u8(1)?);
            // Times stand in channels of any name.
            let place = (!matches!(kind, 2 | 3)).then_some(group.columns.len());
            let column = self.channel(&cn, records, record, place)?;
            if matches!(kind, 2 | 3) && depth == 0 {
                group.clock = match sync {
                    0 | 1 => Clock::Column(group.columns.len()),
                    2 => Clock::None("is sampled over an angle, not over time".to_owned()),
                    3 => Clock::None("is sampled over a distance, not over time".to_owned()),
                    _ => Clock::None("is sampled over an index, not over time".to_owned()),
                };
            }
            group.columns.push(column);
            let parts = cn.link(1);
            if parts != 0 && block::block(self.bytes, parts)?.name == b"##CN" {
                if depth > DEEPEST {
                    return Err(Failure::damaged("channels are nested in a circle".to_owned()));
                }
                self.channels(parts, records, record, group, depth + 1)?;
            }
        }
        Ok(())
    }

    /// A channel; what stands at a `place` in its group is read only if it is wanted.
    fn channel(
        &mut self,
        cn: &Block<'a>,
        records: &Records,
        record: usize,
        place: Option<usize>,
    ) -> Result<Column, Failure> {
        let name = text(self.bytes, cn.link(2))?;
        let mut unit = text(self.bytes, cn.link(6))?;
        if unit.is_empty() && cn.link(4) != 0 {
            unit = text(self.bytes, named(self.bytes, cn.link(4), b"##CC")?.link(1))?;
        }
        let unread = place.is_some_and(|place| !self.wanted.has(&name, &name, place));
        let values = if unread {
            Values::Unread
        } else {
            match self.values(cn, records, record, &name) {
                Ok(values) => Values::Numbers(values),
                Err(Failure { what, foreign: true }) => Values::Other(what),
                Err(damaged) => return Err(damaged),
            }
        };
        Ok(Column { name, title: None, unit: (!unit.is_empty()).then_some(unit), values, typed: false })
    }

    fn values(&mut self, cn: &Block, records: &Records, record: usize, name: &str) -> Result<Vec<f64>, Failure> {
        let kind = match (cn.u8(0)?, cn.u8(2)?) {
            (1, _) => return Err(Failure::foreign("text or bytes of varying length".to_owned())),
            (4 | 5, _) => return Err(Failure::foreign("references to other data".to_owned())),
            (3 | 6, _) => Kind::Index,
            (_, 0) => Kind::Unsigned { big: false },
            (_, 1) => Kind::Unsigned { big: true },
            (_, 2) => Kind::Signed { big: false },
            (_, 3) => Kind::Signed { big: true },
            (_, 4) => Kind::Float { big: false },
            (_, 5) => Kind::Float { big: true },
            (_, 6..=9) => return Err(Failure::foreign("text".to_owned())),
            (_, 10) => return Err(Failure::foreign("bytes".to_owned())),
            (_, 15 | 16) => return Err(Failure::foreign("complex numbers".to_owned())),
            (_, other) => return Err(Failure::foreign(format!("data of type {other}"))),
        };
        if cn.link(1) != 0 && block::block(self.bytes, cn.link(1))?.name == b"##CA" {
            return Err(Failure::foreign("arrays".to_owned()));
        }
        let field = Field { kind, byte: cn.u32(4)? as usize, bit: u32::from(cn.u8(3)?), bits: cn.u32(8)? };
        field.check(record)?;
        let whole = !matches!(kind, Kind::Float { .. });
        let conversion = Conversion::read(self.bytes, cn.link(4), whole, 0)?;
        let flags = cn.u32(12)?;
        let invalid = match flags & 3 {
            0 => Invalid::None,
            2 => Invalid::Bit(cn.u32(16)? as usize),
            _ => Invalid::All,
        };
        let values = field.values(records, &conversion, invalid);
        if matches!(conversion, Conversion::Partly(..)) && values.iter().any(|value| value.is_nan()) {
            self.texts.push(name.to_owned());
        }
        Ok(values)
    }

    /// Gives groups whose clock is another group's a copy of it.
    fn share_clocks(&self, groups: &mut [Group]) {
        for (group, master) in &self.remote {
            let Some(from) = self.places.get(master).filter(|from| *from != group).map(|from| &groups[*from]) else {
                continue;
            };
            match &from.clock {
                Clock::Column(column) => {
                    let clock = from.columns[*column].clone();
                    let group = &mut groups[*group];
                    group.clock = Clock::Column(group.columns.len());
                    group.columns.push(clock);
                }
                other => groups[*group].clock = other.clone(),
            }
        }
    }
}
