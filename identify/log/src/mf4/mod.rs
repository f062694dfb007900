//! MDF4 (`.mf4`): channel groups with clocks of their own.
//!
//! The library that writes these files (`mf4-rs`) is not used to read them: it loses records that lie across two data
//! blocks, knows neither unsorted groups, unfinished files, packed blocks nor floats of 16 bits, and decodes unsigned fields
//! that reach into a ninth byte wrongly. Bringing files into the form that it does know takes as much as reading them.

mod block;
mod bytes;
mod channel;
mod conversion;
mod data;
mod write;

pub(super) use write::write;

use crate::LogError;
use crate::error::listed;
use crate::progress::{Interrupted, Progress};
use crate::recording::{Clock, Column, Group, Place, Recording, Values};
use crate::wanted::Wanted;
use block::{Block, block, chain, named, text};
use bytes::Bytes;
use channel::{Field, Invalid, Kind, Reading, Records};
use conversion::Conversion;
use data::{Numbered, Pieces, Stream, Unfinished};
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Channels are nested in others at most so deep.
const DEEPEST: usize = 16;

/// Why a file or a part of it cannot be read.
#[derive(Debug)]
pub struct Failure {
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

/// Why reading ended early.
pub enum Error {
    Failure(Failure),
    Interrupted(Interrupted),
}

impl From<Failure> for Error {
    fn from(failure: Failure) -> Self {
        Self::Failure(failure)
    }
}

impl From<Interrupted> for Error {
    fn from(interrupted: Interrupted) -> Self {
        Self::Interrupted(interrupted)
    }
}

/// A channel group whose records are being read.
struct ChannelGroup {
    /// Its number among the groups.
    index: usize,
    /// Records that the group claims to have.
    claimed: u64,
    /// Bytes of a record that are not invalidation bytes, and those that are.
    own: usize,
    apart: usize,
    readings: Vec<Reading>,
    /// Records that were read.
    count: usize,
}

impl ChannelGroup {
    /// Reads further records.
    fn take(&mut self, bytes: &[u8], stride: usize, count: usize, invalid: (&[u8], usize, usize)) {
        let records = Records { bytes, stride, first: self.count, count, invalid };
        self.readings.iter_mut().for_each(|reading| reading.take(&records));
        self.count += count;
    }
}

/// Reads a file, of which no more than a few blocks are in memory beside the columns.
pub(super) fn read(path: &Path, wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let fail = |e: std::io::Error| LogError::file(&name, e.to_string());
    let bytes = std::fs::File::open(path).and_then(Bytes::new).map_err(fail)?;
    let what = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    progress.start(format!("reading {what}"), bytes.length());
    let (recording, sha256) = crate::hash::beside(path, || parse(&name, &bytes, wanted, progress));
    progress.finish();
    Ok(Recording { sha256: sha256.map_err(fail)?, ..recording? })
}

/// All but the hash.
fn parse(name: &str, bytes: &Bytes, wanted: &Wanted, progress: &Progress) -> Result<Recording, LogError> {
    let fail = |error: Error| match error {
        Error::Failure(failure) => LogError::file(name, format!("not a readable MDF4 file: {}", failure.what)),
        Error::Interrupted(interrupted) => interrupted.into(),
    };
    let mut notes = Vec::new();
    let mut file = File::open(bytes, wanted, progress).map_err(|failure| fail(failure.into()))?;
    let mut groups = Vec::new();
    for dg in chain(bytes, file.first, b"##DG") {
        let (_, dg) = dg.map_err(|failure| fail(failure.into()))?;
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
    Ok(Recording {
        file: name.to_owned(),
        sha256: String::new(),
        groups,
        own,
        notes,
        place: Place::Samples,
        loader: None,
    })
}

/// A file that is being read.
struct File<'a> {
    bytes: &'a Bytes,
    wanted: &'a Wanted<'a>,
    progress: &'a Progress,
    /// The first data group.
    first: u64,
    unfinished: bool,
    ends: Unfinished,
    /// Flags of steps that only the logger's own program knows.
    custom: u16,
    /// Bytes of records that were not written whole.
    left_over: u64,
    /// Channels with texts among their numbers.
    texts: Vec<String>,
    /// Groups by the place of their block, and those whose clock is another group's.
    places: HashMap<u64, usize>,
    remote: Vec<(usize, u64)>,
}

impl<'a> File<'a> {
    fn open(bytes: &'a Bytes, wanted: &'a Wanted<'a>, progress: &'a Progress) -> Result<Self, Failure> {
        let identification = bytes.few(0, 64)?;
        if identification.len() < 64 {
            return Err(Failure::damaged("the file is too short".to_owned()));
        }
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
            progress,
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
    fn last_block(&self) -> Result<Option<u64>, Failure> {
        let mut last = None;
        for dg in chain(self.bytes, self.first, b"##DG") {
            let mut links = vec![dg?.1.link(2)];
            let mut seen = HashSet::new();
            while let Some(link) = links.pop() {
                if link == 0 || !seen.insert(link) {
                    continue;
                }
                let found = block(self.bytes, link)?;
                match &found.name {
                    // A block that another one follows was written whole.
                    b"##DT" | b"##DV" if !self.followed(&found)? => last = last.max(Some(found.start)),
                    b"##HL" | b"##DL" | b"##LD" => links.extend((0..found.links()).map(|index| found.link(index))),
                    _ => {}
                }
            }
        }
        Ok(last)
    }

    /// Whether a block ends where the file ends or another block begins.
    fn followed(&self, found: &Block) -> Result<bool, Failure> {
        let end = found.start + found.length;
        let next = self.bytes.few(end.next_multiple_of(8), 2)?;
        Ok(found.length > 0 && (end == self.bytes.length() || next == b"##" || next.is_empty()))
    }

    /// Reads all channel groups of a data group.
    fn data_group(&mut self, dg: &Block, groups: &mut Vec<Group>) -> Result<(), Error> {
        let id_bytes = usize::from(dg.u8(0)?);
        if !matches!(id_bytes, 0 | 1 | 2 | 4 | 8) {
            return Err(Failure::damaged(format!("records are numbered with {id_bytes} bytes")).into());
        }
        let Stream { mut records, mut invalid, column_oriented } = data::stream(self.bytes, dg.link(2), self.ends)?;
        let (mut numbered, mut reading) = (Vec::new(), Vec::new());
        for cg in chain(self.bytes, dg.link(1), b"##CG") {
            let (at, cg) = cg?;
            let varying = cg.u16(16)? & 1 != 0;
            let (own, apart) = (cg.u32(24)? as usize, cg.u32(28)? as usize);
            let size = (!varying).then_some(if column_oriented { own } else { own + apart });
            numbered.push(Numbered { id: cg.u64(0)?, size, ..Numbered::default() });
            if varying {
                reading.push(None);
                continue;
            }
            self.places.insert(at, groups.len());
            if cg.u16(16)? & 8 != 0 {
                self.remote.push((groups.len(), cg.link(6)));
            }
            let (group, readings) = self.group(&cg, own, apart)?;
            reading.push(Some(ChannelGroup {
                index: groups.len(),
                claimed: cg.u64(8)?,
                own,
                apart,
                readings,
                count: 0,
            }));
            groups.push(group);
        }
        match (numbered.as_mut_slice(), reading.as_mut_slice()) {
            ([], _) => {}
            ([Numbered { size, .. }], [group]) if id_bytes == 0 => {
                if let (Some(stride), Some(group)) = (*size, group) {
                    let invalid = column_oriented.then_some(&mut invalid);
                    self.sorted(&mut records, invalid, stride, group)?;
                }
            }
            _ if id_bytes == 0 => {
                return Err(Failure::damaged("records of several channel groups are not numbered".to_owned()).into());
            }
            (numbered, reading) => self.unsorted(&mut records, id_bytes, numbered, reading)?,
        }
        for ChannelGroup { index, readings, .. } in reading.into_iter().flatten() {
            for Reading { place, conversion, values, .. } in readings {
                let column = &mut groups[index].columns[place];
                if matches!(conversion, Conversion::Partly(..)) && values.iter().any(|value| value.is_nan()) {
                    self.texts.push(column.name.clone());
                }
                column.values = Values::Numbers(values.into());
            }
        }
        Ok(())
    }

    /// Reads the records of the only channel group of a data group; invalidation bytes that stand apart are `invalid`.
    fn sorted(
        &mut self,
        records: &mut Pieces,
        mut invalid: Option<&mut Pieces>,
        stride: usize,
        group: &mut ChannelGroup,
    ) -> Result<(), Error> {
        let held = records.total.checked_div(stride as u64);
        if self.unfinished {
            self.left_over += records.total.checked_rem(stride as u64).unwrap_or(0);
        }
        let count = self.count(group, held)?;
        if stride == 0 {
            group.take(&[], 0, count, (&[], 0, 0));
        }
        if group.readings.is_empty() {
            return Ok(());
        }
        let (mut buffer, mut bits) = (Vec::new(), Vec::new());
        while group.count < count {
            self.more(records, &mut buffer)?;
            let whole = (buffer.len() / stride).min(count - group.count);
            let bytes = &buffer[..whole * stride];
            match &mut invalid {
                None => group.take(bytes, stride, whole, (bytes, stride, group.own)),
                Some(invalid) => {
                    let size = whole * group.apart;
                    while bits.len() < size && invalid.more(self.bytes, &mut bits)? {}
                    group.take(bytes, stride, whole, (&bits, group.apart, 0));
                    bits.drain(..size.min(bits.len()));
                }
            }
            buffer.drain(..whole * stride);
        }
        Ok(())
    }

    /// Reads the records of channel groups that share their data blocks.
    fn unsorted(
        &mut self,
        records: &mut Pieces,
        id_bytes: usize,
        numbered: &mut [Numbered],
        reading: &mut [Option<ChannelGroup>],
    ) -> Result<(), Error> {
        let everything = self.unfinished;
        let (bytes, progress) = (self.bytes, self.progress);
        let left_over = data::sort(records, bytes, id_bytes, numbered, |numbered| {
            progress.check()?;
            for (Numbered { size, count, records, .. }, group) in numbered.iter().zip(reading.iter_mut()) {
                if let (Some(stride @ 1..), Some(group)) = (*size, group) {
                    let most = if everything { *count } else { group.claimed.min(*count) };
                    let new = most as usize - group.count;
                    group.take(&records[..new * stride], stride, new, (records, stride, group.own));
                }
            }
            Ok(())
        })?;
        if left_over > 0 && !everything {
            return Err(Failure::damaged("the data end within a record".to_owned()).into());
        }
        self.left_over += left_over;
        for (Numbered { size, count, .. }, group) in numbered.iter().zip(reading) {
            if let (Some(size), Some(group)) = (size, group) {
                let count = self.count(group, (*size > 0).then_some(*count))?;
                if *size == 0 {
                    group.take(&[], 0, count, (&[], 0, 0));
                }
            }
        }
        Ok(())
    }

    /// Appends the next piece of the data that is there by count.
    fn more(&self, records: &mut Pieces, to: &mut Vec<u8>) -> Result<(), Error> {
        let before = to.len();
        if !records.more(self.bytes, to)? {
            return Err(Failure::damaged("the data end within a record".to_owned()).into());
        }
        self.progress.advance((to.len() - before) as u64);
        Ok(self.progress.check()?)
    }

    /// Number of records of a group: as it says, or as there are in a file that was not finished. `held`: as there are;
    /// channels that store nothing have as many values as the group claims.
    fn count(&self, group: &ChannelGroup, held: Option<u64>) -> Result<usize, Failure> {
        let ChannelGroup { index, claimed, .. } = *group;
        if self.unfinished {
            return Ok(held.unwrap_or(claimed) as usize);
        }
        match held {
            None if claimed > (1 << 27) => {
                Err(Failure::damaged(format!("group {index} claims {claimed} records without data")))
            }
            Some(held) if claimed > held => {
                Err(Failure::damaged(format!("group {index} claims {claimed} records, but there are {held}")))
            }
            _ => Ok(claimed as usize),
        }
    }

    /// A group without its values, and the channels that are read.
    fn group(&self, cg: &Block, own: usize, apart: usize) -> Result<(Group, Vec<Reading>), Failure> {
        let mut name = text(self.bytes, cg.link(2))?;
        if name.is_empty() && cg.link(3) != 0 {
            let source = named(self.bytes, cg.link(3), b"##SI")?;
            name = text(self.bytes, source.link(0))?;
        }
        let mut group = Group { name, clock: Clock::None("has no time channel".to_owned()), columns: Vec::new() };
        let mut readings = Vec::new();
        self.channels(cg.link(1), (own, apart), &mut group, &mut readings, 0)?;
        Ok((group, readings))
    }

    /// Adds a list of channels, and those they are made of, to a group. `record`: its bytes that are not invalidation
    /// bytes and those that are.
    fn channels(
        &self,
        first: u64,
        record: (usize, usize),
        group: &mut Group,
        readings: &mut Vec<Reading>,
        depth: usize,
    ) -> Result<(), Failure> {
        for cn in chain(self.bytes, first, b"##CN") {
            let (_, cn) = cn?;
            let (kind, sync) = (cn.u8(0)?, cn.u8(1)?);
            // Times stand in channels of any name.
            let is_time = matches!(kind, 2 | 3);
            let place = group.columns.len();
            let mut column = self.channel(&cn)?;
            if is_time || self.wanted.has(&column.name, &column.name, place) {
                match self.reading(&cn, record, place) {
                    Ok(reading) => readings.push(reading),
                    Err(Failure { what, foreign: true }) => column.values = Values::Other(what),
                    Err(damaged) => return Err(damaged),
                }
            }
            if is_time && depth == 0 {
                group.clock = match sync {
                    0 | 1 => Clock::Column(place),
                    2 => Clock::None("is sampled over an angle, not over time".to_owned()),
                    3 => Clock::None("is sampled over a distance, not over time".to_owned()),
                    _ => Clock::None("is sampled over an index, not over time".to_owned()),
                };
            }
            group.columns.push(column);
            let parts = cn.link(1);
            if parts != 0 && block(self.bytes, parts)?.name == *b"##CN" {
                if depth > DEEPEST {
                    return Err(Failure::damaged("channels are nested in a circle".to_owned()));
                }
                self.channels(parts, record, group, readings, depth + 1)?;
            }
        }
        Ok(())
    }

    /// A channel without its values.
    fn channel(&self, cn: &Block) -> Result<Column, Failure> {
        let name = text(self.bytes, cn.link(2))?;
        let mut unit = text(self.bytes, cn.link(6))?;
        if unit.is_empty() && cn.link(4) != 0 {
            unit = text(self.bytes, named(self.bytes, cn.link(4), b"##CC")?.link(1))?;
        }
        let unit = (!unit.is_empty()).then_some(unit);
        Ok(Column { name, title: None, unit, values: Values::Unread, typed: false })
    }

    /// How a channel's values are read.
    fn reading(&self, cn: &Block, (own, apart): (usize, usize), place: usize) -> Result<Reading, Failure> {
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
        if cn.link(1) != 0 && block(self.bytes, cn.link(1))?.name == *b"##CA" {
            return Err(Failure::foreign("arrays".to_owned()));
        }
        let field = Field { kind, byte: cn.u32(4)? as usize, bit: u32::from(cn.u8(3)?), bits: cn.u32(8)? };
        field.check(own)?;
        let whole = !matches!(kind, Kind::Float { .. });
        let conversion = Conversion::read(self.bytes, cn.link(4), whole, 0)?;
        let flags = cn.u32(12)?;
        let invalid = match (flags & 3, cn.u32(16)? as usize) {
            (0, _) => Invalid::None,
            // No group without such bytes has invalid samples.
            (2, _) if apart == 0 => Invalid::None,
            (2, bit) if bit / 8 < apart => Invalid::Bit(bit),
            (2, _) => {
                return Err(Failure::foreign("samples whose invalidation bit lies outside the record".to_owned()));
            }
            _ => Invalid::All,
        };
        Ok(Reading { place, field, conversion, invalid, values: Vec::new() })
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
