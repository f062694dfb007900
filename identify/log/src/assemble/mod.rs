//! From a recording to a log: which columns are meant, one time base, SI units.

mod bring;
mod clock;
mod index;
mod rest;

use crate::columns::{ColumnMap, Rule, Selector, unit};
use crate::error::quoted;
use crate::recording::{Place, Recording, Shelf, Values};
use crate::{Channel, Input, Log, LogError, Series};
use bring::{Bring, borrowed};
pub(crate) use clock::join;
use clock::{Times, decide_clocks, log_times};
use index::{At, Index, NotFound, Resolved, columns_of, map_error, resolve};
use rest::{Rest, rest};
use std::borrow::Cow;
use std::collections::HashSet;

/// A channel of the log and the columns that it is made of.
struct Job<'a> {
    name: String,
    /// Stands in the map, and not merely under the name of an input.
    mapped: bool,
    rule: Cow<'a, Rule>,
    source: Resolved,
    condition: Vec<At>,
}

/// Turns a recording into a log: the channels of the map first, then all other columns under their own names.
///
/// `inputs` are the channels that the log is for: columns named so are used as if the map named them. Without
/// `inputs` and without a map every column of a text file must be numeric.
pub(crate) fn assemble(
    mut recording: Recording,
    map: Option<&ColumnMap>,
    inputs: Option<&[Input]>,
) -> Result<Log, LogError> {
    if let (None, None, Place::Lines { .. }) = (map, inputs, &recording.place) {
        for column in recording.groups.iter().flat_map(|group| &group.columns) {
            column.as_numbers(&recording.file)?;
        }
    }
    let time_rule = map.and_then(|map| map.time.as_ref());
    let base = decide_clocks(&mut recording, map, time_rule)?;
    let mut notes = std::mem::take(&mut recording.notes);
    let index = Index::new(&recording);
    let jobs = jobs(&index, map, inputs, &mut notes)?;
    let blank = match map.and_then(|map| Some((map, map.missing_if.as_ref()?))) {
        None => None,
        Some((map, condition)) => {
            Some((condition, columns_of(&index, condition).map_err(|e| map_error(map, "missing_if", &recording, e))?))
        }
    };
    let mut used: HashSet<At> =
        jobs.iter().flat_map(|job| job.source.columns().iter().chain(&job.condition)).copied().collect();
    used.extend(blank.iter().flat_map(|(_, columns)| columns));
    drop(index);
    if let Some(mut loader) = recording.loader.take() {
        if used.is_empty() {
            return Err(LogError::file(&recording.file, loader.what(&recording.groups)));
        }
        let mut wanted = used.clone();
        wanted.extend(base.map(|base| (base, 0)));
        notes.extend(loader.load(&mut recording.groups, &wanted)?);
    }
    let unread = |at: &At| matches!(recording.groups[at.0].columns[at.1].values, Values::Unread);
    debug_assert!(!used.iter().any(unread), "a column that a channel is made of was not read");
    let index = Index::new(&recording);

    let Times { clocks, base, time } = log_times(&recording, &index, base, &used, time_rule)?;
    let mut bring = Bring { recording: &recording, clocks: &clocks, base, times: &time, sparse: Vec::new() };
    let mut channels = Vec::with_capacity(jobs.len());
    let mut shelf = Shelf::default();
    for job in &jobs {
        let fail = |what: String| job_error(map, job, &recording, what);
        let between = job.rule.between.or(map.and_then(|map| map.between));
        let mut values = match &job.source {
            Resolved::Column(at) => {
                index.column(*at).as_numbers(&recording.file)?;
                bring.column(&index, *at, between, &job.name)
            }
            Resolved::Formula(formula, columns) => {
                let arguments = bring.all(&index, columns, between, &job.name)?;
                formula.evaluate(&borrowed(&arguments), time.len()).into()
            }
            Resolved::Value(value) => vec![*value; time.len()].into(),
        };
        let si = to_si(&index, job, &mut values, &mut notes).map_err(fail)?;
        let si = si.map(|si| job.rule.si_after(si)).transpose().map_err(fail)?;
        let input = inputs.and_then(|inputs| inputs.iter().find(|input| input.name == job.name));
        if let (Some(si), Some(input)) = (si, input)
            && si != input.unit
        {
            let stated = match &job.source {
                Resolved::Column(at) if job.rule.unit.is_none() => index.column(*at).unit.as_deref(),
                _ => None,
            };
            let taken = input.unit;
            let recorded = stated.map_or(si.to_owned(), |stated| format!("{stated} ({si})"));
            let how = match (si, taken) {
                ("rad/s", "m/s") | ("rad", "m") => "; radius = ... in a column map turns a rotation into a motion",
                _ => "",
            };
            return Err(fail(format!("is recorded in {recorded}, but {} is taken in {taken}{how}", job.name)));
        }
        job.rule.shape(&time, &mut values).map_err(fail)?;
        if let (Some(condition), columns) = (&job.rule.missing_if, &job.condition) {
            condition.blank(&borrowed(&bring.all(&index, columns, between, &job.name)?), &mut values);
        }
        if let (Some((condition, columns)), true) = (&blank, job.mapped) {
            condition.blank(&borrowed(&bring.all(&index, columns, between, &job.name)?), &mut values);
        }
        shelf.put_away(&mut values).map_err(|error| LogError::file(&recording.file, error.to_string()))?;
        // What stands in the log under its own name keeps its place among the other columns.
        let place = job.source.columns().first().filter(|_| !job.mapped).copied();
        channels.push((place, Channel { name: job.name.clone(), values }));
    }
    notes.extend(bring.notes());
    let taken: HashSet<At> =
        jobs.iter().filter_map(|job| if let Resolved::Column(at) = job.source { Some(at) } else { None }).collect();
    let names = std::mem::take(&mut channels);
    let (rest, left) = rest(recording, base, &time, &clocks, &taken, names, inputs.is_none() && map.is_none())?;
    notes.extend(left);
    let Rest { file, sha256, channels, unread } = rest;
    let mut log = Log { source: file, sha256, time, channels, notes, unread };
    let put_away = log.series_mut().try_for_each(|series| shelf.put_away(series));
    put_away.map_err(|error| LogError::file(&log.source, error.to_string()))?;
    Ok(log)
}

/// The channels of the map, and the inputs that stand in the log under their own names.
fn jobs<'a>(
    index: &Index,
    map: Option<&'a ColumnMap>,
    inputs: Option<&[Input]>,
    notes: &mut Vec<String>,
) -> Result<Vec<Job<'a>>, LogError> {
    let mut jobs = Vec::new();
    for (name, rule) in map.iter().flat_map(|map| &map.channels) {
        let map = map.expect("its channels");
        let fail = |error| map_error(map, name, index.recording, error);
        let source = match resolve(index, rule) {
            Err(NotFound::Absent(what)) if rule.optional => {
                notes.push(format!("{name} is left out: {what}"));
                continue;
            }
            source => source.map_err(fail)?,
        };
        let condition = rule.missing_if.as_ref().map_or(Ok(Vec::new()), |condition| columns_of(index, condition));
        let condition = condition.map_err(fail)?;
        jobs.push(Job { name: name.clone(), mapped: true, rule: Cow::Borrowed(rule), source, condition });
    }
    for input in inputs.unwrap_or_default() {
        if jobs.iter().any(|job| job.name == input.name) {
            continue;
        }
        let rule = Rule::plain(Selector::named(input.name));
        let source = match index.names.get(input.name).map(Vec::as_slice) {
            // The map turns this column into another channel.
            Some([at]) if jobs.iter().any(|job| matches!(job.source, Resolved::Column(other) if other == *at)) => {
                continue;
            }
            None => continue,
            Some(_) => index.find(&Selector::named(input.name)),
        };
        match source {
            Ok(at) => {
                jobs.push(Job {
                    name: input.name.to_owned(),
                    mapped: false,
                    rule: Cow::Owned(rule),
                    source: Resolved::Column(at),
                    condition: Vec::new(),
                });
            }
            Err(NotFound::Absent(_)) => {}
            Err(NotFound::Several { what, .. }) => {
                let place = match &index.recording.place {
                    Place::Lines { header, .. } => format!("{}:{header}", index.recording.file),
                    Place::Samples => index.recording.file.clone(),
                };
                return Err(LogError::file(&place, format!("{what} in a column map")));
            }
        }
    }
    Ok(jobs)
}

fn job_error(map: Option<&ColumnMap>, job: &Job, recording: &Recording, what: String) -> LogError {
    match map.filter(|_| job.mapped) {
        Some(map) => map.error(format!("{}: {what} ({})", job.name, recording.file)).into(),
        None => LogError::file(&recording.file, format!("{}: {what}", quoted(&job.name))),
    }
}

/// Applies `scale`, `offset` and the unit of the map or of the file; returns the SI unit if one is known.
fn to_si(
    index: &Index,
    job: &Job,
    values: &mut Series,
    notes: &mut Vec<String>,
) -> Result<Option<&'static str>, String> {
    let rule = &job.rule;
    let (scale, offset) = (rule.scale, rule.offset);
    let columns = job.source.columns();
    let stated = |at: &At| index.column(*at).known_unit();
    let unit = match (rule.unit, &job.source) {
        (Some(unit), _) => {
            if columns.iter().any(|at| index.column(*at).typed) && !(unit.is_si() && unit.si == "s") {
                return Err("holds times by its type, which are read in s; no other unit applies".to_owned());
            }
            if let Resolved::Column(at) = &job.source
                && let Some(Ok(file)) = stated(at)
                && file.si != unit.si
                && scale == 1.0
            {
                let text = index.column(*at).unit.clone().unwrap_or_default();
                notes.push(format!("{}: the column map's unit is taken, though the file states {text}", job.name));
            }
            Some(unit)
        }
        (None, Resolved::Value(_)) => None,
        (None, Resolved::Column(at)) => match stated(at) {
            None => None,
            Some(unit) => {
                let text = index.column(*at).unit.as_deref().unwrap_or_default();
                let name = quoted(&index.column(*at).name);
                let unit = unit.map_err(|what| {
                    format!("column {name} is recorded in an {what}; unit = \"...\" in a column map decides")
                })?;
                if !unit.is_si() && (scale != 1.0 || offset != 0.0) {
                    return Err(format!(
                        "column {name} is recorded in {text} and scaled without a unit: unit = \"{text}\" if it still is in {text} \
                         after scaling, unit = \"{}\" if the scale turns it into that",
                        unit.si
                    ));
                }
                Some(unit)
            }
        },
        (None, Resolved::Formula(..)) => {
            for at in columns {
                if let Some(unit) = stated(at)
                    && !unit.as_ref().is_ok_and(unit::Unit::is_si)
                {
                    let text = index.column(*at).unit.as_deref().unwrap_or_default();
                    let name = quoted(&index.column(*at).name);
                    return Err(format!(
                        "the formula reads {name} in {text} as recorded: unit = \"...\" must give the unit of its result"
                    ));
                }
            }
            None
        }
    };
    let plain = unit.unwrap_or(unit::Unit { factor: 1.0, zero: 0.0, si: "" });
    if scale != 1.0 || offset != 0.0 || !plain.is_si() {
        values.iter_mut().for_each(|value| *value = (scale * *value + offset) * plain.factor + plain.zero);
    }
    Ok(unit.map(|unit| unit.si))
}
