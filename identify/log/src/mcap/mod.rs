//! MCAP (`.mcap`): the logs of robots. Topics are groups, the numbers in their messages are columns, and only those
//! that are needed are read.
//!
//! Messages of ROS 2 (CDR) and ROS 1 are read by the definition that the file records, standard messages without one,
//! too. The `mcap` library reads the container; chunks are unpacked here, as its own lz4 is a second one, in C.

mod definition;
mod message;
mod standard;

use crate::LogError;
use crate::columns::Stamps;
use crate::error::{listed, quoted};
use crate::guard::guarded;
use crate::progress::Progress;
use crate::recording::{Clock, Column, Group, Loader, Place, Recording, Values};
use ::mcap::records::Record;
use definition::Definition;
use message::{Encoding, Plan};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::Read;
use std::path::Path;

/// Packed chunks that grow beyond this many bytes are no log.
const LARGEST: u64 = 1 << 30;

/// A topic: how its messages are written.
struct Topic {
    /// What it is, or why it is not read.
    definition: Result<Definition, String>,
    encoding: Encoding,
    /// Whether it has a header with a stamp.
    stamped: bool,
    columns: Vec<String>,
}

/// Where the topics of each channel number stand, and the bytes of the file.
struct File {
    name: String,
    bytes: Vec<u8>,
    topics: Vec<Topic>,
    channels: HashMap<u16, usize>,
    stamps: Option<Stamps>,
}

/// Reads which topics and fields a file has.
pub(super) fn read(path: &Path, stamps: Option<Stamps>, progress: &Progress) -> Result<Recording, LogError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let sha256 = crate::hash::of_bytes(&bytes);
    progress.check()?;
    let open = || open(&name, bytes, stamps);
    let (file, groups, notes) = guarded(open).unwrap_or_else(|| Err(LogError::file(&name, "the file is damaged")))?;
    let own = groups.len();
    Ok(Recording { file: name, sha256, groups, own, notes, place: Place::Samples, loader: Some(Box::new(file)) })
}

type Opened = (File, Vec<Group>, Vec<String>);

fn open(name: &str, bytes: Vec<u8>, stamps: Option<Stamps>) -> Result<Opened, LogError> {
    let mut schemas: HashMap<u16, (String, String, String)> = HashMap::new();
    let mut channels: BTreeMap<u16, ::mcap::records::Channel> = BTreeMap::new();
    let whole = each_record(&bytes, |record| {
        match record {
            Record::Schema { header, data } => {
                let text = String::from_utf8_lossy(&data).into_owned();
                schemas.insert(header.id, (header.name, header.encoding, text));
            }
            Record::Channel(channel) => {
                channels.insert(channel.id, channel);
            }
            _ => {}
        }
        Ok(())
    })
    .map_err(|what| LogError::file(name, format!("not a readable MCAP file: {what}")))?;
    let (mut topics, mut groups, mut places) = (Vec::new(), Vec::<Group>::new(), HashMap::new());
    for (id, channel) in channels {
        // Several writers on one topic are one group.
        if let Some(place) = groups.iter().position(|group| group.name == channel.topic) {
            places.insert(id, place);
            continue;
        }
        let schema = schemas.get(&channel.schema_id);
        let topic = topic(&channel.message_encoding, schema);
        let mut columns = vec![Column { typed: true, ..Column::numbers("time", Vec::new()) }];
        columns[0].values = Values::Unread;
        columns.extend(
            topic.columns.iter().map(|name| Column { values: Values::Unread, ..Column::numbers(name, Vec::new()) }),
        );
        let clock = match &topic.definition {
            Ok(_) => Clock::Column(0),
            Err(what) => Clock::None(format!("is not read: {what}")),
        };
        places.insert(id, groups.len());
        topics.push(topic);
        groups.push(Group { name: channel.topic, clock, columns });
    }
    let notes = if whole { vec![] } else { vec!["ends within a record; what stands before it is read".to_owned()] };
    let file = File { name: name.to_owned(), bytes, topics, channels: places, stamps };
    Ok((file, groups, notes))
}

fn topic(encoding: &str, schema: Option<&(String, String, String)>) -> Topic {
    let foreign =
        |what: String| Topic { definition: Err(what), encoding: Encoding::Cdr, stamped: false, columns: Vec::new() };
    let Some((name, written, text)) = schema else {
        return foreign(format!("its messages ({}) have no definition", quoted(encoding)));
    };
    let encoding = match encoding {
        "cdr" => Encoding::Cdr,
        "ros1" => Encoding::Ros1,
        other => return foreign(format!("its messages are {}, not those of ROS", quoted(other))),
    };
    let text = match written.as_str() {
        "ros2msg" | "ros1msg" if !text.trim().is_empty() => Some(text.as_str()),
        "ros2idl" if !text.trim().is_empty() => None,
        _ => standard::definition(&name.replace("/msg/", "/")),
    };
    let Some(text) = text else {
        return foreign(format!("its type {} is defined as {}", quoted(name), quoted(written)));
    };
    let standard = |name: &str| if encoding == Encoding::Cdr { standard::definition(name) } else { ros1(name) };
    match Definition::parse(name, text, standard) {
        Err(what) => foreign(what),
        Ok(definition) => {
            let columns = definition.leaves();
            let stamped =
                ["header.stamp.sec", "header.stamp"].iter().any(|stamp| columns.iter().any(|name| name == stamp));
            Topic { definition: Ok(definition), encoding, stamped, columns }
        }
    }
}

/// The one message of ROS 1 that differs and that files may leave out.
fn ros1(name: &str) -> Option<&'static str> {
    (name == "std_msgs/Header").then_some("uint32 seq\ntime stamp\nstring frame_id")
}

/// Calls `with` for each record, those in chunks too; false if the file ends within a record.
fn each_record(bytes: &[u8], mut with: impl FnMut(Record) -> Result<(), String>) -> Result<bool, String> {
    let options = ::mcap::read::Options::IgnoreEndMagic.into();
    let reader = ::mcap::read::LinearReader::new_with_options(bytes, options).map_err(|e| e.to_string())?;
    for record in reader {
        let record = match record {
            Ok(record) => record,
            Err(
                ::mcap::McapError::UnexpectedEof
                | ::mcap::McapError::UnexpectedEoc
                | ::mcap::McapError::RecordTooLarge { .. },
            ) => {
                return Ok(false);
            }
            Err(error) => return Err(error.to_string()),
        };
        match record {
            Record::Chunk { header, data } => {
                let records = unpack(&header, &data)?;
                let mut rest: &[u8] = &records;
                while let Some((head, body)) = rest.split_at_checked(9) {
                    let length = head[1..].first_chunk().map_or(0, |word| u64::from_le_bytes(*word));
                    let body = usize::try_from(length).ok().and_then(|length| body.split_at_checked(length));
                    let (body, next) = body.ok_or("a chunk ends within a record")?;
                    with(::mcap::read::parse_record(head[0], body).map_err(|e| e.to_string())?)?;
                    rest = next;
                }
            }
            record => with(record)?,
        }
    }
    Ok(true)
}

/// The records of a chunk.
fn unpack<'a>(header: &::mcap::records::ChunkHeader, data: &'a [u8]) -> Result<Cow<'a, [u8]>, String> {
    let size = header.uncompressed_size;
    if size > LARGEST {
        return Err("a chunk claims to be larger than 1 GiB".to_owned());
    }
    let mut records = Vec::new();
    let damaged = |e: std::io::Error| format!("a chunk is damaged: {e}");
    match header.compression.as_str() {
        "" => return Ok(Cow::Borrowed(data)),
        "zstd" => {
            let from = zstd::Decoder::with_buffer(data).map_err(damaged)?;
            from.take(size).read_to_end(&mut records).map_err(damaged)?
        }
        "lz4" => lz4_flex::frame::FrameDecoder::new(data).take(size).read_to_end(&mut records).map_err(damaged)?,
        other => return Err(format!("chunks packed with {} are not read", quoted(other))),
    };
    if records.len() as u64 != size {
        return Err("a chunk is shorter than it claims".to_owned());
    }
    Ok(Cow::Owned(records))
}

/// The samples of a topic while they are read.
struct Samples {
    plan: Plan,
    /// Column of each slot.
    columns: Vec<usize>,
    row: Vec<f64>,
    /// Log, publish and header time of each message, ns.
    times: Vec<[i128; 3]>,
    values: Vec<Vec<f64>>,
}

impl Loader for File {
    fn what(&self, groups: &[Group]) -> String {
        let topics: Vec<_> = groups.iter().map(|group| group.name.as_str()).collect();
        format!(
            "a column map must name topics and fields, as in speed = \"/odom.twist.twist.linear.x\"; topics are {}",
            listed(topics)
        )
    }

    fn load(&mut self, groups: &mut [Group], wanted: &HashSet<(usize, usize)>) -> Result<Vec<String>, LogError> {
        let name = self.name.clone();
        let load = || self.samples(groups, wanted);
        guarded(load)
            .unwrap_or_else(|| Err("the file is damaged".to_owned()))
            .map_err(|what| LogError::file(&name, what))
    }
}

impl File {
    fn samples(&self, groups: &mut [Group], wanted: &HashSet<(usize, usize)>) -> Result<Vec<String>, String> {
        let mut loads: HashMap<usize, Samples> = HashMap::new();
        let used: HashSet<usize> = wanted.iter().map(|(group, _)| *group).collect();
        for group in used {
            let Ok(definition) = &self.topics[group].definition else { continue };
            let mut columns: Vec<usize> =
                wanted.iter().filter(|(g, c)| *g == group && *c > 0).map(|(_, c)| *c).collect();
            columns.sort_unstable();
            let mut plan = Plan::default();
            for (slot, column) in columns.iter().enumerate() {
                plan.add(definition, &groups[group].columns[*column].name, slot);
            }
            // Whole seconds and nanoseconds of the stamp stand behind the wanted fields.
            if self.topics[group].stamped {
                plan.add(definition, "header.stamp.sec", columns.len());
                plan.add(definition, "header.stamp.nanosec", columns.len() + 1);
                plan.add(definition, "header.stamp", columns.len());
            }
            let row = vec![f64::NAN; columns.len() + 2];
            let values = vec![Vec::new(); columns.len()];
            loads.insert(group, Samples { plan, columns, row, times: Vec::new(), values });
        }
        each_record(&self.bytes, |record| {
            let Record::Message { header, data } = record else { return Ok(()) };
            let Some(group) = self.channels.get(&header.channel_id) else { return Ok(()) };
            let Some(samples) = loads.get_mut(group) else { return Ok(()) };
            let topic = &self.topics[*group];
            let Ok(definition) = &topic.definition else { return Ok(()) };
            samples.row.fill(f64::NAN);
            message::read(definition, &samples.plan, topic.encoding, &data, &mut samples.row).map_err(|what| {
                format!("topic {}, message {}: {what}", groups[*group].name, samples.times.len() + 1)
            })?;
            let fields = samples.columns.len();
            let stamp = match (samples.row[fields], samples.row[fields + 1]) {
                (seconds, nanoseconds) if nanoseconds.is_nan() => (seconds * 1e9).round() as i128,
                (seconds, nanoseconds) => seconds as i128 * 1_000_000_000 + nanoseconds as i128,
            };
            samples.times.push([header.log_time.into(), header.publish_time.into(), stamp]);
            for (values, value) in samples.values.iter_mut().zip(&samples.row) {
                values.push(*value);
            }
            Ok(())
        })?;
        let (choice, note) = self.choose(groups, &loads)?;
        let mut loads: Vec<_> = loads.into_iter().collect();
        loads.sort_by_key(|(group, _)| *group);
        for (group, samples) in loads {
            // Messages are stored as they came, which need not be in the order of their times.
            let mut order: Vec<usize> = (0..samples.times.len()).collect();
            order.sort_by_key(|k| samples.times[*k][choice]);
            let seconds = |k: &usize| {
                let time = samples.times[*k][choice];
                (time / 1_000_000_000) as f64 + (time % 1_000_000_000) as f64 / 1e9
            };
            groups[group].columns[0].values = Values::Numbers(order.iter().map(seconds).collect());
            for (column, values) in samples.columns.iter().zip(&samples.values) {
                let values = order.iter().map(|k| values[*k]).collect();
                groups[group].columns[*column].values = Values::Numbers(values);
            }
        }
        Ok(note.into_iter().collect())
    }

    /// Which of a message's times counts: as the map says, or the header's if all used topics have good ones.
    fn choose(&self, groups: &[Group], loads: &HashMap<usize, Samples>) -> Result<(usize, Option<String>), String> {
        let bad = |group: &usize, samples: &Samples| -> Option<String> {
            let name = &groups[*group].name;
            if !self.topics[*group].stamped {
                return Some(format!("topic {name} has no header"));
            }
            let unset = samples.times.iter().any(|times| times[2] == 0);
            unset.then(|| format!("topic {name} has headers without a stamp"))
        };
        let mut lacking: Vec<_> = loads.iter().filter_map(|(group, samples)| bad(group, samples)).collect();
        lacking.sort();
        match (self.stamps, lacking.first()) {
            (Some(Stamps::Log), _) => Ok((0, None)),
            (Some(Stamps::Publish), _) => Ok((1, None)),
            (Some(Stamps::Header), Some(what)) => {
                Err(format!("[mcap] time = \"header\" in the column map, but {what}"))
            }
            (Some(Stamps::Header) | None, None) => Ok((2, None)),
            (None, Some(what)) => {
                let note = format!(
                    "the times are those at which messages were recorded, as {what}; [mcap] time in a column map decides"
                );
                Ok((0, Some(note)))
            }
        }
    }
}
