//! Columns that no channel is read from.

use super::index::At;
use crate::between::{Between, carry};
use crate::columns::unit;
use crate::error::{listed, quoted};
use crate::recording::{Clock, Group, Place, Recording, Values};
use crate::{Channel, LogError, Series};
use std::collections::HashSet;

/// A log without its times.
pub(super) struct Rest {
    pub file: String,
    pub sha256: String,
    pub channels: Vec<Channel>,
    pub unread: Vec<String>,
}

/// Adds the columns that no channel is read from, under their own names; the second result is what to say of those
/// that cannot be.
pub(super) fn rest(
    recording: Recording,
    base: usize,
    times: &[f64],
    clocks: &[Result<Series, String>],
    taken: &HashSet<At>,
    mut channels: Vec<(Option<At>, Channel)>,
    strict: bool,
) -> Result<(Rest, Vec<String>), LogError> {
    let Recording { file, sha256, groups, place, .. } = recording;
    let mut names: HashSet<String> = channels.iter().map(|(_, channel)| channel.name.clone()).collect();
    let mapped = names.clone();
    let (mut foreign, mut unknown, mut lost, mut unread) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (g, Group { name: group, clock, columns }) in groups.into_iter().enumerate() {
        for (c, column) in columns.into_iter().enumerate() {
            if clock == Clock::Column(c) || taken.contains(&(g, c)) {
                continue;
            }
            if strict
                && names.contains(&column.name)
                && let Place::Lines { header, .. } = &place
            {
                let what = format!(
                    "two columns are named {}; a column map can choose by place: column = {c}",
                    quoted(&column.name)
                );
                return Err(LogError::line(&file, *header, what));
            }
            let values = match column.values {
                Values::Numbers(ref values) if mapped.contains(&column.name) && values.is_empty() => continue,
                Values::Numbers(values) => values,
                Values::Unread => {
                    unread.push(column.name);
                    continue;
                }
                Values::Text { .. } => {
                    foreign.push(format!("{} (text)", column.name));
                    continue;
                }
                Values::Other(what) => {
                    foreign.push(format!("{} ({what})", column.name));
                    continue;
                }
            };
            let own = match &clocks[g] {
                Ok(own) => own,
                Err(_) => {
                    lost.push(column.name);
                    continue;
                }
            };
            // The map's channel of the same name is meant, and within a group the first column.
            if mapped.contains(&column.name) || column.name == "time" {
                continue;
            }
            let name = match names.contains(&column.name) {
                false => column.name,
                true if group.is_empty() => format!("{g}/{}", column.name),
                true => format!("{group}/{}", column.name),
            };
            if !names.insert(name.clone()) {
                foreign.push(format!("{name} (of the same name as another)"));
                continue;
            }
            let mut values =
                if g == base || own == times { values } else { carry(own, &values, times, Between::Missing).into() };
            match column
                .unit
                .as_deref()
                .filter(|text| !matches!(text.trim(), "" | "-"))
                .map(|text| (text, unit::find(text)))
            {
                None => {}
                Some((_, Ok(unit))) if unit.is_si() => {}
                Some((_, Ok(unit))) => values.iter_mut().for_each(|value| *value = *value * unit.factor + unit.zero),
                Some((text, Err(_))) => unknown.push(format!("{name} [{text}]")),
            }
            channels.push((Some((g, c)), Channel { name, values }));
        }
    }
    channels.sort_by_key(|(place, _)| *place);
    let channels = channels.into_iter().map(|(_, channel)| channel).collect();
    let list = |names: &[String]| listed(names.iter().map(String::as_str));
    let mut notes = Vec::new();
    if !foreign.is_empty() {
        notes.push(format!("left out: {}", list(&foreign)));
    }
    if !unknown.is_empty() {
        notes.push(format!("kept as recorded, in a unit that is not known: {}", list(&unknown)));
    }
    if !lost.is_empty() {
        let why: Vec<_> = clocks.iter().filter_map(|clock| clock.as_ref().err()).map(String::as_str).collect();
        notes.push(format!("left out for want of a time: {} ({})", list(&lost), why.first().unwrap_or(&"")));
    }
    Ok((Rest { file, sha256, channels, unread }, notes))
}
