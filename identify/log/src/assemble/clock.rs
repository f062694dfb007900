//! The clocks of groups, and which of them becomes the log's.

use super::bring::borrowed;
use super::index::{At, Index, NotFound, Resolved, map_error, resolve};
use crate::columns::{ColumnMap, Join, Rule, hint};
use crate::error::{listed, quoted};
use crate::recording::{Clock, Column, Recording};
use crate::{LogError, Series};
use std::collections::HashSet;

/// Adds the groups of another file, on the clock of the log.
pub(crate) fn join(
    recording: &mut Recording,
    mut other: Recording,
    join: &Join,
    map: &ColumnMap,
) -> Result<(), LogError> {
    if other.loader.is_some() {
        let what = "a log of messages cannot be joined to another one; take it as the log and join the other";
        return Err(map.error(format!("join: {}: {what}", other.file)).into());
    }
    decide_clocks(&mut other, Some(map), join.time.as_ref())?;
    let file = other.file.clone();
    let several = other.groups.len() > 1;
    let clocks: Vec<_> = (0..other.groups.len()).map(|group| clock(&other, group, join.time.as_ref())).collect();
    for (mut group, clock) in other.groups.into_iter().zip(clocks) {
        let name = join.name.clone().unwrap_or_default();
        group.name = match (name.as_str(), group.name.as_str()) {
            ("", own) => own.to_owned(),
            (name, own) if several => format!("{name}/{own}"),
            (name, _) => name.to_owned(),
        };
        group.clock = match clock {
            Ok(times) => {
                let times: Series = times.iter().map(|time| time + join.offset).collect();
                let mut column = Column::numbers("time", times);
                column.typed = true;
                group.columns.push(column);
                Clock::Column(group.columns.len() - 1)
            }
            Err(what) => Clock::None(format!("{what} ({file})")),
        };
        recording.groups.push(group);
    }
    recording.notes.extend(other.notes.into_iter().map(|note| format!("{file}: {note}")));
    Ok(())
}

/// Decides which column of each table is its clock; returns the group that the map names for the log's time.
pub(super) fn decide_clocks(
    recording: &mut Recording,
    map: Option<&ColumnMap>,
    rule: Option<&Rule>,
) -> Result<Option<usize>, LogError> {
    let mut base = None;
    if let (Some(rule), Some(map)) = (rule, map) {
        let index = Index::new(recording);
        match resolve(&index, rule) {
            Ok(Resolved::Column(at)) => base = Some((at.0, Ok(at.1))),
            Ok(Resolved::Formula(formula, columns)) => {
                let group = columns[0].0;
                if columns.iter().any(|(g, _)| *g != group) {
                    return Err(map.error("time: its columns stand in different groups").into());
                }
                let arguments = columns.iter().map(|at| index.column(*at).as_numbers(&recording.file));
                let arguments = arguments.collect::<Result<Vec<_>, _>>()?;
                let values = formula.evaluate(&borrowed(&arguments), recording.groups[group].len());
                base = Some((group, Err(values)));
            }
            Ok(Resolved::Value(_)) => return Err(map.error("time: needs a column").into()),
            // Every group calls its clock so: the fastest one counts.
            Err(NotFound::Several { places, .. })
                if !places.is_empty()
                    && places.iter().all(|(g, c)| recording.groups[*g].clock == Clock::Column(*c)) => {}
            Err(error) => return Err(map_error(map, "time", recording, error)),
        }
    }
    let base = match base {
        None => None,
        Some((group, Ok(column))) => {
            recording.groups[group].columns[column].as_numbers(&recording.file)?;
            recording.groups[group].clock = Clock::Column(column);
            Some(group)
        }
        Some((group, Err(values))) => {
            let columns = &mut recording.groups[group].columns;
            columns.push(Column::numbers("time", values));
            recording.groups[group].clock = Clock::Column(columns.len() - 1);
            Some(group)
        }
    };
    let mut undecided = (0..recording.groups.len()).filter(|group| recording.groups[*group].clock == Clock::Undecided);
    if let (Some(group), None) = (undecided.next(), base) {
        let column = time_column(recording, group, map)?;
        let name = &recording.groups[group].columns[column].name;
        if name != "time" {
            let note = format!("column {} is taken for the time", quoted(name));
            recording.notes.push(note);
        }
        recording.groups[group].clock = Clock::Column(column);
        return Ok(Some(group));
    }
    Ok(base)
}

/// Place of the column `time` of a table.
pub(super) fn time_column(recording: &Recording, group: usize, map: Option<&ColumnMap>) -> Result<usize, LogError> {
    let names: Vec<_> = recording.groups[group].columns.iter().map(|column| column.name.as_str()).collect();
    if let Some(index) = names.iter().position(|name| *name == "time") {
        if let Some(twin) = names[index + 1..].iter().position(|name| *name == "time") {
            let what = format!("columns {index} and {} (counted from 0) are both named 'time'", index + 1 + twin);
            return Err(LogError::file(&recording.file, what + "; in a column map time = { column = 0 } chooses"));
        }
        return Ok(index);
    }
    let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    let like: Vec<usize> = (0..names.len()).filter(|index| lower[*index] == "time").collect();
    if let [index] = like.as_slice() {
        return Ok(*index);
    }
    if let Some(map) = map {
        let what = format!("time: {} has no column 'time'; {}", recording.file, hint("time", &names));
        return Err(map.error(what).into());
    }
    let like_time =
        |name: &String| name.contains("time") || name.contains("stamp") || name == "t" || name.starts_with("t_");
    let near = lower.iter().position(like_time).map_or("...", |index| names[index]);
    let near = quoted(near).replace('\'', "\"");
    let columns = listed(names.iter().copied());
    let what = format!("no column 'time' (columns: {columns}); a column map can name another one: time = {near}");
    Err(LogError::file(&recording.file, what))
}

/// The times of all groups that have good ones, and of the log.
pub(super) struct Times {
    /// By group: its times, s, or what is wrong with them.
    pub clocks: Vec<Result<Series, String>>,
    /// The group whose times are the log's.
    pub base: usize,
    /// The log's times, s.
    pub time: Series,
}

/// Takes the log's times from the group `base`, or else from the fastest of those that are used.
pub(super) fn log_times(
    recording: &Recording,
    index: &Index,
    base: Option<usize>,
    used: &HashSet<At>,
    rule: Option<&Rule>,
) -> Result<Times, LogError> {
    let clocks: Vec<Result<Series, String>> =
        (0..recording.groups.len()).map(|group| clock(recording, group, rule)).collect();
    for (group, clock) in clocks.iter().enumerate() {
        let needed = used.iter().find(|(g, _)| *g == group).filter(|_| base.is_none_or(|base| base != group));
        if let (Err(what), Some(at)) = (clock, needed) {
            let name = quoted(&index.column(*at).name);
            return Err(LogError::file(
                &recording.file,
                format!("{}, which has {name}: {what}", recording.group(group)),
            ));
        }
    }
    let base = match base {
        Some(base) => base,
        None => fastest(recording, &clocks, |group| used.iter().any(|(g, _)| *g == group))
            .or_else(|| fastest(recording, &clocks, |_| true))
            .ok_or_else(|| no_clock(recording, &clocks))?,
    };
    let time = match &clocks[base] {
        Ok(times) => times.clone(),
        Err(_) => return Err(bad_clock(recording, base, rule)),
    };
    check_times(recording, base, &time)?;
    Ok(Times { clocks, base, time })
}

/// The times of a group, s, if they are good for other groups to be compared with.
pub(super) fn clock(recording: &Recording, group: usize, rule: Option<&Rule>) -> Result<Series, String> {
    let times = times(recording, group, rule)?;
    match times.windows(2).position(|pair| pair[1] <= pair[0] || pair[1].is_nan() || pair[0].is_nan()) {
        // A single group's times are looked at more closely later.
        Some(bad) if recording.groups.len() > 1 => Err(format!(
            "its time does not increase at sample {}: {} s after {} s",
            bad + 2,
            times[bad + 1],
            times[bad]
        )),
        _ => Ok(times),
    }
}

/// The times of a group, s. The map's `scale`, `offset` and `unit` hold for all groups of the file itself.
pub(super) fn times(recording: &Recording, group: usize, rule: Option<&Rule>) -> Result<Series, String> {
    let entry = &recording.groups[group];
    let column = match &entry.clock {
        Clock::Column(column) => &entry.columns[*column],
        Clock::None(what) => return Err(what.clone()),
        Clock::Undecided => return Err("has no time column".to_owned()),
    };
    match rule.filter(|_| group < recording.own) {
        Some(rule) if rule.unit.is_some() || rule.scale != 1.0 || rule.offset != 0.0 => {
            let factor = match rule.unit {
                Some(unit) if unit.si != "s" => return Err(format!("the column map gives it in {}", unit.si)),
                Some(unit) => unit.factor,
                None => column.second()?,
            };
            let values = column.as_numbers(&recording.file).map_err(|e| e.to_string())?;
            if column.typed && factor != 1.0 {
                return Err(format!(
                    "{} holds times by its type, which are read in s; a unit does not apply",
                    quoted(&column.name)
                ));
            }
            Ok(values.iter().map(|value| (rule.scale * value + rule.offset) * factor).collect())
        }
        _ => column.seconds(&recording.file).map_err(|e| e.to_string()),
    }
}

/// The group with the most samples among those that `wanted` accepts and whose clock is good.
pub(super) fn fastest(
    recording: &Recording,
    clocks: &[Result<Series, String>],
    wanted: impl Fn(usize) -> bool,
) -> Option<usize> {
    let good = |group: &usize| wanted(*group) && clocks[*group].as_ref().is_ok_and(|times| !times.is_empty());
    (0..recording.groups.len())
        .rev()
        .filter(good)
        .max_by_key(|group| clocks[*group].as_ref().map_or(0, |times| times.len()))
}

pub(super) fn no_clock(recording: &Recording, clocks: &[Result<Series, String>]) -> LogError {
    let why = clocks.iter().enumerate().find_map(|(group, clock)| {
        clock.as_ref().err().map(|what| format!("no group has times; {}: {what}", recording.group(group)))
    });
    LogError::file(&recording.file, why.unwrap_or_else(|| "no samples".to_owned()))
}

/// The error that a group's times are not good, with the place of the sample where there is one.
pub(super) fn bad_clock(recording: &Recording, group: usize, rule: Option<&Rule>) -> LogError {
    match times(recording, group, rule) {
        Ok(times) => match check_times(recording, group, &times) {
            Err(error) => error,
            Ok(()) => LogError::file(&recording.file, format!("{}: its times are not good", recording.group(group))),
        },
        Err(what) => LogError::file(&recording.file, format!("{}: {what}", recording.group(group))),
    }
}

/// A time for a message, without endless noughts.
pub(super) fn seconds(time: f64) -> String {
    if time != 0.0 && !(1e-6..1e15).contains(&time.abs()) { format!("{time:e}") } else { time.to_string() }
}

pub(super) fn check_times(recording: &Recording, base: usize, time: &[f64]) -> Result<(), LogError> {
    if time.is_empty() {
        return Err(LogError::file(&recording.file, "no samples"));
    }
    if let Some(bad) = time.iter().position(|t| !t.is_finite()) {
        return Err(recording.fail_at(base, bad, "the time is missing or not finite"));
    }
    if let Some(before) = time.windows(2).position(|pair| pair[1] <= pair[0]) {
        let how = if time[before] == time[before + 1] { "stands still" } else { "runs backwards" };
        let (last, now) = (seconds(time[before]), seconds(time[before + 1]));
        return Err(recording.fail_at(base, before + 1, &format!("the time {how}: {now} s after {last} s")));
    }
    if time.len() == 1 {
        return Err(LogError::file(&recording.file, "only 1 sample; at least 2 are needed"));
    }
    Ok(())
}
