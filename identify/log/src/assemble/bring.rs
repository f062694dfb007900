//! Carrying channels to the log's times.

use super::index::{At, Index};
use crate::LogError;
use crate::between::{Between, carry, period};
use crate::error::listed;
use crate::recording::{Recording, Values};
use std::borrow::Cow;

/// Carries columns to the log's times and remembers what it did to them.
pub(super) struct Bring<'a> {
    pub recording: &'a Recording,
    pub clocks: &'a [Result<Vec<f64>, String>],
    pub base: usize,
    pub times: &'a [f64],
    /// Channels that were carried without the map telling how: their group and name.
    pub sparse: Vec<(usize, String)>,
}

impl<'a> Bring<'a> {
    pub fn column(&mut self, index: &Index<'a>, at: At, between: Option<Between>, channel: &str) -> Cow<'a, [f64]> {
        let values = match &index.column(at).values {
            Values::Numbers(values) => values.as_slice(),
            _ => &[],
        };
        let Ok(own) = &self.clocks[at.0] else { return Cow::Owned(vec![f64::NAN; self.times.len()]) };
        if at.0 == self.base || own == self.times {
            return Cow::Borrowed(values);
        }
        let entry = (at.0, channel.to_owned());
        if between.is_none() && !self.sparse.contains(&entry) {
            self.sparse.push(entry);
        }
        Cow::Owned(carry(own, values, self.times, between.unwrap_or(Between::Missing)))
    }

    pub fn all(
        &mut self,
        index: &Index<'a>,
        columns: &[At],
        between: Option<Between>,
        channel: &str,
    ) -> Result<Vec<Cow<'a, [f64]>>, LogError> {
        let mut all = Vec::with_capacity(columns.len());
        for at in columns {
            index.column(*at).as_numbers(&self.recording.file)?;
            all.push(self.column(index, *at, between, channel));
        }
        Ok(all)
    }

    /// What happened to channels of other groups, one line per group.
    pub fn notes(&self) -> Vec<String> {
        let rate = |times: &[f64]| format!("{:.3} s", period(times));
        let mut groups: Vec<usize> = self.sparse.iter().map(|(group, _)| *group).collect();
        groups.dedup();
        let line = |group: usize| {
            let channels = self.sparse.iter().filter(|(g, _)| *g == group).map(|(_, name)| name.as_str());
            let own = self.clocks[group].as_deref().map_or(String::new(), rate);
            format!(
                "sampled where recorded and missing between: {} of {}, every {own} beside {}; \
                 between = \"hold\", \"linear\" or \"nearest\" in a column map fills them",
                listed(channels),
                self.recording.group(group),
                rate(self.times)
            )
        };
        groups.into_iter().map(line).collect()
    }
}

pub(super) fn borrowed<'a>(columns: &'a [Cow<[f64]>]) -> Vec<&'a [f64]> {
    columns.iter().map(AsRef::as_ref).collect()
}
