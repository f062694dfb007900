//! The smallest MDF 4.10 files, block by block: what loggers write and libraries do not.

use std::path::{Path, PathBuf};

/// Types of channels.
pub const VALUES: u8 = 0;
pub const MASTER: u8 = 2;
/// What a master counts.
pub const TIME: u8 = 1;
pub const ANGLE: u8 = 2;
/// Types of data.
pub const UNSIGNED: u8 = 0;
pub const FLOAT: u8 = 4;
pub const TEXT: u8 = 7;

/// A channel: its bytes follow those of the one before.
#[derive(Clone)]
pub struct Channel {
    pub name: &'static str,
    pub kind: u8,
    pub sync: u8,
    pub data: u8,
    pub bits: u32,
    pub unit: &'static str,
    /// Texts for values.
    pub texts: Vec<(f64, &'static str)>,
    pub invalidation_bit: Option<u32>,
}

/// A channel of doubles.
pub fn double(name: &'static str, unit: &'static str) -> Channel {
    Channel { name, kind: VALUES, sync: 0, data: FLOAT, bits: 64, unit, texts: vec![], invalidation_bit: None }
}

/// The clock of a group.
pub fn time() -> Channel {
    Channel { kind: MASTER, sync: TIME, ..double("time", "s") }
}

/// A channel group with its records.
pub struct Group {
    pub name: &'static str,
    pub channels: Vec<Channel>,
    pub records: Vec<Vec<u8>>,
    pub invalidation_bytes: u32,
}

impl Group {
    pub fn new(name: &'static str, channels: Vec<Channel>, records: Vec<Vec<u8>>) -> Self {
        Self { name, channels, records, invalidation_bytes: 0 }
    }
}

/// A record of doubles.
pub fn record(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// A file that grows block by block.
#[derive(Default)]
pub struct File {
    pub bytes: Vec<u8>,
    groups: Vec<usize>,
}

impl File {
    pub fn new() -> Self {
        let mut file = Self { bytes: vec![0; 64], groups: vec![] };
        file.bytes[..28].copy_from_slice(b"MDF     4.10    hand    \0\0\0\0");
        file.bytes[28..30].copy_from_slice(&410_u16.to_le_bytes());
        file.block(b"##HD", &[0; 6], &[0; 32]);
        file
    }

    /// Appends a block and returns its place.
    pub fn block(&mut self, name: &[u8; 4], links: &[usize], data: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        let at = self.bytes.len();
        self.bytes.extend_from_slice(name);
        self.bytes.extend_from_slice(&[0; 4]);
        self.bytes.extend_from_slice(&((24 + 8 * links.len() + data.len()) as u64).to_le_bytes());
        self.bytes.extend_from_slice(&(links.len() as u64).to_le_bytes());
        links.iter().for_each(|link| self.bytes.extend_from_slice(&(*link as u64).to_le_bytes()));
        self.bytes.extend_from_slice(data);
        at
    }

    fn text(&mut self, text: &str) -> usize {
        if text.is_empty() { 0 } else { self.block(b"##TX", &[], &[text.as_bytes(), &[0]].concat()) }
    }

    fn link(&mut self, block: usize, index: usize, to: usize) {
        let at = block + 24 + 8 * index;
        self.bytes[at..at + 8].copy_from_slice(&(to as u64).to_le_bytes());
    }

    fn channel_group(&mut self, group: &Group, id: u64, next: usize) -> usize {
        let mut byte = group.channels.iter().map(|channel| channel.bits / 8).sum::<u32>();
        let record = byte;
        let mut following = 0;
        for channel in group.channels.iter().rev() {
            byte -= channel.bits / 8;
            let conversion = if channel.texts.is_empty() { 0 } else { self.texts(&channel.texts) };
            let (name, unit) = (self.text(channel.name), self.text(channel.unit));
            let mut data = vec![channel.kind, channel.sync, channel.data, 0];
            let flags = if channel.invalidation_bit.is_some() { 2 } else { 0 };
            for word in [byte, channel.bits, flags, channel.invalidation_bit.unwrap_or(0)] {
                data.extend_from_slice(&word.to_le_bytes());
            }
            data.resize(72, 0);
            following = self.block(b"##CN", &[following, 0, name, 0, conversion, 0, unit, 0], &data);
        }
        let name = self.text(group.name);
        let mut data = [id.to_le_bytes(), (group.records.len() as u64).to_le_bytes(), [0; 8]].concat();
        data.extend_from_slice(&record.to_le_bytes());
        data.extend_from_slice(&group.invalidation_bytes.to_le_bytes());
        self.block(b"##CG", &[next, following, name, 0, 0, 0], &data)
    }

    /// A conversion that leads to texts.
    fn texts(&mut self, texts: &[(f64, &'static str)]) -> usize {
        let mut links = vec![0; 4];
        for (_, text) in texts {
            let text = self.text(text);
            links.push(text);
        }
        links.push(0);
        let mut data = vec![7, 0, 0, 0];
        data.extend_from_slice(&(texts.len() as u16 + 1).to_le_bytes());
        data.extend_from_slice(&(texts.len() as u16).to_le_bytes());
        data.extend_from_slice(&[0; 16]);
        texts.iter().for_each(|(value, _)| data.extend_from_slice(&value.to_le_bytes()));
        self.block(b"##CC", &links, &data)
    }

    fn data_group(&mut self, first: usize, data: usize, id_bytes: u8) -> usize {
        let group = self.block(b"##DG", &[0, first, data, 0], &[id_bytes, 0, 0, 0, 0, 0, 0, 0]);
        match self.groups.last().copied() {
            None => self.link(64, 0, group),
            Some(last) => self.link(last, 0, group),
        }
        self.groups.push(group);
        group
    }

    /// A group in a data group of its own, its data cut into blocks at these bytes.
    pub fn group(mut self, group: &Group, cuts: &[usize]) -> Self {
        let first = self.channel_group(group, 0, 0);
        let records = group.records.concat();
        let edges = [&[0], cuts, &[records.len()]].concat();
        let blocks: Vec<usize> =
            edges.windows(2).map(|pair| self.block(b"##DT", &[], &records[pair[0]..pair[1]])).collect();
        let data = match blocks.as_slice() {
            [only] => *only,
            several => {
                let links = [&[0], several].concat();
                self.block(b"##DL", &links, &[0; 8])
            }
        };
        self.data_group(first, data, 0);
        self
    }

    /// Groups that share one data block; `order` says whose record comes next.
    pub fn unsorted(mut self, groups: &[Group], order: &[usize]) -> Self {
        let mut first = 0;
        for (id, group) in groups.iter().enumerate().rev() {
            first = self.channel_group(group, id as u64 + 1, first);
        }
        let mut next = vec![0; groups.len()];
        let mut records = Vec::new();
        for group in order {
            records.push(*group as u8 + 1);
            records.extend_from_slice(&groups[*group].records[next[*group]]);
            next[*group] += 1;
        }
        // The data come last in the file, as a logger writes them.
        let data_group = self.data_group(first, 0, 1);
        let data = self.block(b"##DT", &[], &records);
        self.link(data_group, 2, data);
        self
    }

    /// The file as its logger left it when the power went: nothing counted, the last block without its length.
    pub fn unfinished(mut self) -> Self {
        self.bytes[..8].copy_from_slice(b"UnFinMF ");
        self.bytes[60] = 5;
        let find = |bytes: &[u8], name: &[u8; 4]| {
            (64..bytes.len() - 8).step_by(8).filter(|at| bytes[*at..*at + 4] == *name).collect::<Vec<_>>()
        };
        for group in find(&self.bytes, b"##CG") {
            self.bytes[group + 24 + 48 + 8..][..8].fill(0);
        }
        let last = *find(&self.bytes, b"##DT").last().unwrap();
        self.bytes[last + 8..last + 16].copy_from_slice(&24_u64.to_le_bytes());
        self
    }

    /// Writes the file into a folder.
    pub fn save(&self, folder: &Path) -> PathBuf {
        let path = folder.join("log.mf4");
        std::fs::write(&path, &self.bytes).unwrap();
        path
    }
}
