//! Which column a name means.

use crate::LogError;
use crate::columns::{Candidate, ColumnMap, Expression, Rule, Selector, Source, Which, hint};
use crate::error::quoted;
use crate::recording::{Column, Recording};
use std::collections::HashMap;

/// Place of a column: its group and its index there.
pub(super) type At = (usize, usize);

/// The source of a rule, with the places of its columns.
pub(super) enum Resolved {
    Column(At),
    Formula(Expression, Vec<At>),
    Value(f64),
}

impl Resolved {
    pub fn columns(&self) -> &[At] {
        match self {
            Self::Column(at) => std::slice::from_ref(at),
            Self::Formula(_, columns) => columns,
            Self::Value(_) => &[],
        }
    }
}

/// Why a column could not be found.
pub(super) enum NotFound {
    /// No column of this name.
    Absent(String),
    /// More than one, and how to choose.
    Several { places: Vec<At>, what: String },
}

/// A recording and where the columns of each name stand in it.
pub(super) struct Index<'a> {
    pub recording: &'a Recording,
    pub names: HashMap<&'a str, Vec<At>>,
}

impl<'a> Index<'a> {
    pub fn new(recording: &'a Recording) -> Self {
        let mut names: HashMap<&str, Vec<At>> = HashMap::new();
        for (g, group) in recording.groups.iter().enumerate() {
            for (c, column) in group.columns.iter().enumerate() {
                names.entry(&column.name).or_default().push((g, c));
                if let Some(title) = column.title.as_deref().filter(|title| *title != column.name) {
                    names.entry(title).or_default().push((g, c));
                }
            }
        }
        Self { recording, names }
    }

    pub fn column(&self, (group, column): At) -> &'a Column {
        &self.recording.groups[group].columns[column]
    }

    /// Groups of this name, or the one at this place.
    fn groups(&self, which: &Which) -> Vec<usize> {
        let groups = &self.recording.groups;
        match which {
            Which::Index(index) => Vec::from_iter(Some(*index).filter(|index| *index < groups.len())),
            Which::Name(name) => {
                let named: Vec<_> = (0..groups.len()).filter(|index| groups[*index].name == *name).collect();
                match name.parse() {
                    Ok(index) if named.is_empty() && index < groups.len() => vec![index],
                    _ => named,
                }
            }
        }
    }

    pub fn find(&self, selector: &Selector) -> Result<At, NotFound> {
        let groups = selector.group.as_ref().map(|which| self.groups(which));
        let places = match &selector.column {
            Which::Index(index) => {
                let groups = groups.unwrap_or_else(|| (0..self.recording.groups.len()).collect());
                if let [_, _, ..] = groups.as_slice() {
                    let what = format!("column = {index} needs group = 0 to {}", self.recording.groups.len() - 1);
                    return Err(NotFound::Several { places: Vec::new(), what });
                }
                let exists = |group: &usize| *index < self.recording.groups[*group].columns.len();
                groups.into_iter().filter(exists).map(|group| (group, *index)).collect()
            }
            Which::Name(name) => {
                let of = |name: &str| self.names.get(name).cloned().unwrap_or_default();
                match groups {
                    Some(groups) => of(name).into_iter().filter(|(group, _)| groups.contains(group)).collect(),
                    None => {
                        let mut places = of(name);
                        if places.is_empty() {
                            // Group and column in one text.
                            places = Selector::splits(name)
                                .flat_map(|(group, column)| {
                                    let groups = self.groups(&Which::Name(group.to_owned()));
                                    of(column).into_iter().filter(move |(g, _)| groups.contains(g))
                                })
                                .collect();
                        }
                        places
                    }
                }
            }
        };
        match places.as_slice() {
            [at] => Ok(*at),
            [] => Err(NotFound::Absent(self.absent(selector))),
            _ => {
                let what = self.several(selector, &places);
                Err(NotFound::Several { places, what })
            }
        }
    }

    fn absent(&self, selector: &Selector) -> String {
        let groups = &self.recording.groups;
        let chosen = selector.group.as_ref().map(|which| self.groups(which));
        if let (Some(which), Some([])) = (&selector.group, chosen.as_deref()) {
            let names: Vec<_> = groups.iter().map(|group| group.name.as_str()).collect();
            return match which {
                Which::Name(name) => format!("no group '{}'; {}", name.escape_debug(), hint(name, &names)),
                Which::Index(index) => format!("no group {index}; there are {}, counted from 0", groups.len()),
            };
        }
        let chosen = chosen.unwrap_or_else(|| (0..groups.len()).collect());
        let columns = chosen.iter().flat_map(|group| &groups[*group].columns);
        let names: Vec<_> = columns.map(|column| column.title.as_deref().unwrap_or(&column.name)).collect();
        let name = selector.name().unwrap_or_default();
        format!("no column {selector}; {}", hint(name, &names))
    }

    fn several(&self, selector: &Selector, places: &[At]) -> String {
        let (first, second) = (places[0], places[1]);
        let name = quoted(&self.column(first).name);
        if first.0 == second.0 {
            let (a, b) = (first.1, second.1);
            return format!(
                "columns {a} and {b} (counted from 0) are both named {name}; column = {a} or column = {b} chooses"
            );
        }
        let groups: Vec<_> = places.iter().take(4).map(|(group, _)| self.recording.group(*group)).collect();
        let plain = selector.name().unwrap_or_default();
        let choice = format!("column = \"{}/{plain}\" or group = {} chooses", first.0, first.0);
        format!("column {name} stands in {}; {choice}", groups.join(" and "))
    }
}

/// The columns of a rule's source.
pub(super) fn resolve(index: &Index, rule: &Rule) -> Result<Resolved, NotFound> {
    let candidates = match &rule.source {
        Source::Value(value) => return Ok(Resolved::Value(*value)),
        Source::Expression(expression) => {
            return Ok(Resolved::Formula(expression.clone(), columns_of(index, expression)?));
        }
        Source::Column(candidates) => candidates,
    };
    let mut first = None;
    for Candidate { selector, formula } in candidates {
        let absent = match index.find(selector) {
            Ok(at) => return Ok(Resolved::Column(at)),
            Err(several @ NotFound::Several { .. }) => return Err(several),
            Err(absent) => absent,
        };
        let absent = match formula {
            None => absent,
            Some(formula) => match columns_of(index, formula) {
                Ok(columns) => return Ok(Resolved::Formula(formula.clone(), columns)),
                // A formula if any of its columns is there, and else a name with odd characters.
                Err(missing) if formula.names().iter().any(|name| index.find(&Selector::named(name)).is_ok()) => {
                    missing
                }
                Err(_) => absent,
            },
        };
        first.get_or_insert(absent);
    }
    Err(match (first, candidates.as_slice()) {
        (Some(only), [_]) => only,
        _ => {
            let names: Vec<_> = candidates.iter().map(|candidate| candidate.selector.to_string()).collect();
            NotFound::Absent(format!("none of the columns {}", names.join(", ")))
        }
    })
}

pub(super) fn columns_of(index: &Index, expression: &Expression) -> Result<Vec<At>, NotFound> {
    expression.names().iter().map(|name| index.find(&Selector::named(name))).collect()
}

pub(super) fn map_error(map: &ColumnMap, key: &str, recording: &Recording, error: NotFound) -> LogError {
    let (NotFound::Absent(what) | NotFound::Several { what, .. }) = error;
    map.error(
        format!("{key}: {} has {what}", recording.file)
            .replace(" has columns ", ": columns ")
            .replace(" has column ", ": column "),
    )
    .into()
}
