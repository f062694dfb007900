//! Which columns of a file are read at all: a vehicle's recording has thousands that nobody asks for.

use crate::Input;
use crate::columns::{Candidate, ColumnMap, Expression, Rule, Selector, Source, Which};
use std::collections::HashSet;

/// The columns that may be needed.
///
/// Groups are not looked at: a name is wanted wherever it stands, so that what is found more than once is still seen.
pub(crate) struct Wanted<'a> {
    /// Says of a column that no channel is read from whether it is kept; none keeps every column.
    keep: Option<&'a dyn Fn(&str) -> bool>,
    names: HashSet<&'a str>,
    places: HashSet<usize>,
}

impl<'a> Wanted<'a> {
    pub fn all() -> Self {
        Self { keep: None, names: HashSet::new(), places: HashSet::new() }
    }

    /// What `inputs` and the map are read from, and what `keep` says of the others.
    pub fn new(map: Option<&'a ColumnMap>, inputs: &[Input<'a>], keep: &'a dyn Fn(&str) -> bool) -> Self {
        let names = inputs.iter().map(|input| input.name).collect();
        let mut wanted = Self { keep: Some(keep), names, places: HashSet::new() };
        if let Some(map) = map {
            let joined = map.joins.iter().filter_map(|join| join.time.as_ref());
            let rules = map.channels.iter().map(|(_, rule)| rule).chain(&map.time).chain(joined);
            rules.for_each(|rule| wanted.rule(rule));
            map.missing_if.iter().for_each(|condition| wanted.expression(condition));
        }
        wanted
    }

    /// Whether a column is read: by its name, everything that stands in its place of the header, and its place in its
    /// group. Times are always read.
    pub fn has(&self, name: &str, title: &str, place: usize) -> bool {
        let Some(keep) = self.keep else { return true };
        self.names.contains(name)
            || self.names.contains(title)
            || self.places.contains(&place)
            || name.eq_ignore_ascii_case("time")
            || keep(name)
    }

    fn rule(&mut self, rule: &'a Rule) {
        match &rule.source {
            Source::Value(_) => {}
            Source::Expression(expression) => self.expression(expression),
            Source::Column(candidates) => {
                for Candidate { selector, formula } in candidates {
                    match &selector.column {
                        Which::Index(place) => _ = self.places.insert(*place),
                        Which::Name(name) => self.name(name),
                    }
                    formula.iter().for_each(|formula| self.expression(formula));
                }
            }
        }
        rule.missing_if.iter().for_each(|condition| self.expression(condition));
    }

    fn expression(&mut self, expression: &'a Expression) {
        expression.names().iter().for_each(|name| self.name(name));
    }

    /// A name, which may begin with that of its group.
    fn name(&mut self, name: &'a str) {
        self.names.insert(name);
        self.names.extend(Selector::splits(name).map(|(_, column)| column));
    }
}
