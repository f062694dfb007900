//! MDF4 (`.mf4`): channel groups with their own time channels, brought onto the fastest one.

mod inflate;

use super::columns::{ColumnMap, unit};
use super::error::quoted;
use super::table::{Place, Table};
use super::{Log, LogError};
use crate::guard::guarded;
use crate::progress::Progress;
use mf4_rs::api::channel::Channel as FileChannel;
use mf4_rs::api::mdf::MDF;
use mf4_rs::blocks::common::DataType;
use mf4_rs::error::MdfError;
use mf4_rs::writer::MdfWriter;
use std::io::{Seek, Write};
use std::path::Path;

/// One channel group: its times and its numeric channels.
struct Group {
    master: String,
    time: Vec<f64>,
    channels: Vec<(String, Vec<f64>)>,
}

/// Reads a file. Channels of slower groups are held until their next sample, at most two of their
/// own periods; the fastest group gives the times. Without a column map, values whose unit the file
/// states are turned into SI.
pub(super) fn read(path: &Path, map: Option<&ColumnMap>, progress: &Progress) -> Result<Table, LogError> {
    let name = path.display().to_string();
    let sha256 = super::csv::sha256(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    let bytes = std::fs::read(path).map_err(|e| LogError::file(&name, e.to_string()))?;
    progress.start(format!("reading {name}"), 2);
    let mut texts = Vec::new();
    // The library indexes into the file by links that a damaged file gets wrong.
    let parsed = guarded(|| groups(&name, bytes, map, &mut texts));
    let groups = parsed.unwrap_or_else(|| Err(LogError::file(&name, "the file is damaged")))?;
    progress.advance(1);
    progress.check()?;
    let columns = merge(&name, groups, map)?;
    progress.finish();
    Ok(Table { file: name, sha256, columns, texts, place: Place::Samples })
}

fn groups(
    name: &str,
    bytes: Vec<u8>,
    map: Option<&ColumnMap>,
    texts: &mut Vec<(String, String, String)>,
) -> Result<Vec<Group>, LogError> {
    let fail = |e: MdfError| LogError::file(name, format!("not a readable MDF4 file: {e}").replace('\n', " "));
    let bytes = inflate::inflate(bytes).map_err(|e| LogError::file(name, format!("not a readable MDF4 file: {e}")))?;
    let file = MDF::from_bytes(bytes).map_err(fail)?;
    let mut list = Vec::new();
    for group in file.channel_groups() {
        if group.raw_channel_group().block.cycles_nr == 0 {
            continue;
        }
        let title = |channel: &FileChannel| channel.name().map(Option::unwrap_or_default).map_err(fail);
        let Some(master) = group.master_channel() else {
            return Err(LogError::file(name, "a channel group has no time channel"));
        };
        let time = master.values_as_f64().map_err(fail)?;
        let mut entry = Group { master: title(&master)?, time, channels: Vec::new() };
        for channel in group.channels() {
            if std::ptr::eq(channel.block(), master.block()) || matches!(channel.block().channel_type, 2 | 3) {
                continue;
            }
            let title = title(&channel)?;
            if !is_number(&channel.block().data_type) {
                texts.push((title, name.to_owned(), "text".to_owned()));
                continue;
            }
            let mut values = channel.values_as_f64().map_err(fail)?;
            if values.len() != entry.time.len() {
                let what =
                    format!("channel {} has {} values but {} times", quoted(&title), values.len(), entry.time.len());
                return Err(LogError::file(name, what));
            }
            let stated = channel.unit().map_err(fail)?.unwrap_or_default();
            if let (None, Ok(unit)) = (map, unit::find(&stated)) {
                values.iter_mut().for_each(|value| *value = *value * unit.factor + unit.zero);
            }
            entry.channels.push((title, values));
        }
        list.push(entry);
    }
    Ok(list)
}

fn is_number(kind: &DataType) -> bool {
    matches!(
        kind,
        DataType::UnsignedIntegerLE
            | DataType::UnsignedIntegerBE
            | DataType::SignedIntegerLE
            | DataType::SignedIntegerBE
            | DataType::FloatLE
            | DataType::FloatBE
    )
}

/// Brings all groups onto the times of the one with the most samples per second.
fn merge(file: &str, groups: Vec<Group>, map: Option<&ColumnMap>) -> Result<Vec<(String, Vec<f64>)>, LogError> {
    for group in &groups {
        if let Some(bad) = group.time.windows(2).position(|pair| pair[1] <= pair[0] || !pair[1].is_finite()) {
            let (last, now) = (group.time[bad], group.time[bad + 1]);
            let what = format!(
                "sample {}: the time of group {} does not increase: {now} s after {last} s",
                bad + 2,
                quoted(&group.master)
            );
            return Err(LogError::file(file, what));
        }
    }
    let period = |group: &Group| match group.time.as_slice() {
        [first, .., last] => (last - first) / (group.time.len() - 1) as f64,
        _ => f64::INFINITY,
    };
    let fastest = (0..groups.len()).min_by(|a, b| period(&groups[*a]).total_cmp(&period(&groups[*b])));
    let Some(fastest) = fastest else { return Err(LogError::file(file, "no samples")) };
    let time = groups[fastest].time.clone();
    let mut columns = vec![("time".to_owned(), time.clone())];
    let master = &groups[fastest].master;
    if master != "time" && map.is_some_and(|map| map.uses(master)) {
        columns.push((master.clone(), time.clone()));
    }
    for group in groups {
        let longest = 2.0 * period(&group);
        let same = group.time == time;
        for (name, values) in group.channels {
            if columns.iter().any(|(other, _)| *other == name) {
                if map.is_none_or(|map| map.uses(&name)) {
                    let what = format!("channel {} stands in more than one group", quoted(&name));
                    return Err(LogError::file(file, what));
                }
                continue;
            }
            let values = if same { values } else { hold(&group.time, &values, &time, longest) };
            columns.push((name, values));
        }
    }
    Ok(columns)
}

/// The last value at or before each time; missing before the first and `longest` s after the last.
fn hold(from: &[f64], values: &[f64], to: &[f64], longest: f64) -> Vec<f64> {
    let mut next = 0;
    let at = |time: &f64| {
        while next < from.len() && from[next] <= time + 1e-9 {
            next += 1;
        }
        match next.checked_sub(1) {
            Some(last) if time - from[last] <= longest => values[last],
            _ => f64::NAN,
        }
    };
    to.iter().map(at).collect()
}

/// Writes one channel group of doubles.
pub(super) fn write(log: &Log, to: impl Write + Seek + Send + 'static) -> Result<(), MdfError> {
    let mut writer = MdfWriter::new_from_writer(std::io::BufWriter::new(to));
    writer.init_mdf_file()?;
    let group = writer.add_channel_group(None, |_| {})?;
    let double = |name: &str| {
        let name = name.to_owned();
        move |block: &mut mf4_rs::blocks::channel_block::ChannelBlock| {
            block.data_type = DataType::FloatLE;
            block.bit_count = 64;
            block.name = Some(name);
        }
    };
    let master = writer.add_channel(&group, None, double("time"))?;
    writer.set_time_channel(&master)?;
    let mut last = master;
    for channel in &log.channels {
        last = writer.add_channel(&group, Some(&last), double(&channel.name))?;
    }
    writer.start_data_block_for_cg(&group, 0)?;
    let mut columns = vec![log.time.as_slice()];
    columns.extend(log.channels.iter().map(|channel| channel.values.as_slice()));
    writer.write_columns_f64(&group, &columns)?;
    writer.finish_data_block(&group)?;
    writer.finalize()
}
