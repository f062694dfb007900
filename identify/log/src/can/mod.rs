//! CAN logs (`.blf`, `.asc`, and candump's `.log`) by the DBC files that the column map names: messages are groups, signals
//! are columns.
//!
//! The `can-dbc` library reads the databases. The crates that read BLF know only one of its four kinds of data frames, so
//! these are taken apart here. Not read: signals under several multiplexers, J1939 addresses, multi-frame transport.

mod frames;
mod signal;

use crate::LogError;
use crate::columns::ColumnMap;
use crate::error::{listed, quoted};
use crate::progress::Progress;
use crate::recording::{Clock, Column, Group, Loader, Place, Recording, Values};
use can_dbc::{Dbc, MessageId, MultiplexIndicator};
use frames::Frame;
use signal::Layout;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// How frames are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Blf,
    Asc,
    Candump,
}

/// A message of a database.
struct Message {
    id: (u32, bool),
    /// The signal that says which others are in the frame.
    multiplexer: Option<Layout>,
    /// In the order of the group's columns behind its time.
    signals: Vec<Result<Layout, String>>,
}

/// A log whose messages are known.
struct File {
    name: String,
    kind: Kind,
    bytes: Vec<u8>,
    messages: Vec<Message>,
    channel: Option<String>,
}

/// Reads the databases; frames are read once it is known which are needed.
pub(super) fn read(
    path: &Path,
    kind: Kind,
    map: Option<&ColumnMap>,
    progress: &Progress,
) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let Some(map) = map.filter(|map| !map.dbc.is_empty()) else {
        let what = "frames of a CAN bus need a database: [can] dbc = \"car.dbc\" in a column map";
        return Err(LogError::file(&name, what));
    };
    let (mut messages, mut groups) = (Vec::new(), Vec::new());
    for file in &map.dbc {
        progress.check()?;
        let path = map.path(file);
        let dbc = database(&path)?;
        for message in &dbc.messages {
            let id = match message.id {
                MessageId::Standard(id) => (u32::from(id), false),
                MessageId::Extended(id) => (id, true),
            };
            let unread = |name: &str| Column { values: Values::Unread, ..Column::numbers(name, Vec::new()) };
            let mut columns = vec![Column { typed: true, unit: Some("s".to_owned()), ..unread("time") }];
            let mut signals = Vec::new();
            for signal in &message.signals {
                let layout = Layout::of(&dbc, message, signal);
                let mut column = unread(&signal.name);
                column.unit = (!signal.unit.is_empty()).then(|| signal.unit.clone());
                if let Err(what) = &layout {
                    column.values = Values::Other(what.clone());
                }
                columns.push(column);
                signals.push(layout);
            }
            let is_multiplexer =
                |signal: &&can_dbc::Signal| signal.multiplexer_indicator == MultiplexIndicator::Multiplexor;
            let multiplexer = message.signals.iter().find(is_multiplexer);
            let multiplexer = multiplexer.and_then(|signal| Layout::of(&dbc, message, signal).ok());
            messages.push(Message { id, multiplexer, signals });
            groups.push(Group { name: message.name.clone(), clock: Clock::Column(0), columns });
        }
    }
    let sha256 = crate::hash::of_bytes(&bytes);
    let own = groups.len();
    let file = File { name: name.clone(), kind, bytes, messages, channel: map.can_channel.clone() };
    Ok(Recording {
        file: name,
        sha256,
        groups,
        own,
        notes: vec![],
        place: Place::Samples,
        loader: Some(Box::new(file)),
    })
}

/// A database file, in the encoding that Vector's tools write.
fn database(path: &Path) -> Result<Dbc, LogError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let text = match std::str::from_utf8(&bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => encoding_rs::WINDOWS_1252.decode(&bytes).0.into_owned(),
    };
    Dbc::try_from(text.as_str())
        .map_err(|e| LogError::file(&name, format!("is not a DBC file: {e}").replace('\n', " ")))
}

impl File {
    fn frames(&self, with: &mut dyn FnMut(Frame)) -> Result<bool, String> {
        let text = || String::from_utf8_lossy(&self.bytes);
        match self.kind {
            Kind::Blf => frames::blf(&self.bytes, with).map_err(|what| format!("not a readable BLF file: {what}")),
            Kind::Asc => frames::asc(&text(), with).map(|()| true),
            Kind::Candump => frames::candump(&text(), with).map(|()| true),
        }
    }
}

impl Loader for File {
    fn what(&self, groups: &[Group]) -> String {
        let names: Vec<_> = groups.iter().map(|group| group.name.as_str()).collect();
        let what = "a column map must name messages and signals, as in speed = \"ESP_21.ESP_v_Signal\"";
        format!("{what}; messages are {}", listed(names))
    }

    fn load(&mut self, groups: &mut [Group], wanted: &HashSet<(usize, usize)>) -> Result<Vec<String>, LogError> {
        let fail = |what: String| LogError::file(&self.name, what);
        let used: HashSet<usize> = wanted.iter().map(|(group, _)| *group).collect();
        let mut places: HashMap<(u32, bool), Vec<usize>> = HashMap::new();
        for group in &used {
            places.entry(self.messages[*group].id).or_default().push(*group);
        }
        let mut wanted: Vec<(usize, usize)> = wanted.iter().filter(|(_, column)| *column > 0).copied().collect();
        wanted.sort_unstable();
        let mut times: HashMap<usize, Vec<f64>> = used.iter().map(|group| (*group, Vec::new())).collect();
        let mut values = vec![Vec::new(); wanted.len()];
        let mut channels: HashMap<usize, HashSet<String>> = HashMap::new();
        let whole = self.frames(&mut |frame| {
            if self.channel.as_deref().is_some_and(|channel| channel != frame.channel) {
                return;
            }
            for group in places.get(&(frame.id, frame.extended)).into_iter().flatten() {
                let message = &self.messages[*group];
                let multiplexer = message.multiplexer.as_ref().and_then(|layout| layout.raw(frame.data));
                times.get_mut(group).expect("a used group").push(frame.time);
                let known = channels.entry(*group).or_default();
                if !known.contains(frame.channel) {
                    known.insert(frame.channel.to_owned());
                }
                for ((_, column), values) in wanted.iter().zip(&mut values).filter(|((g, _), _)| g == group) {
                    let layout = message.signals[column - 1].as_ref();
                    values.push(layout.map_or(f64::NAN, |layout| layout.value(frame.data, multiplexer)));
                }
            }
        });
        let whole = whole.map_err(fail)?;
        if let Some((group, names)) = channels.iter().find(|(_, names)| names.len() > 1) {
            let mut names: Vec<_> = names.iter().map(String::as_str).collect();
            names.sort_unstable();
            let what = format!("message {} is on several buses ({})", quoted(&groups[*group].name), listed(names));
            return Err(fail(format!("{what}; [can] channel = \"...\" in the column map chooses")));
        }
        for (group, times) in times {
            groups[group].columns[0].values = Values::Numbers(times.into());
        }
        for ((group, column), values) in wanted.into_iter().zip(values) {
            if matches!(groups[group].columns[column].values, Values::Unread) {
                groups[group].columns[column].values = Values::Numbers(values.into());
            }
        }
        Ok(if whole { vec![] } else { vec!["ends within an object; what stands before it is read".to_owned()] })
    }
}
