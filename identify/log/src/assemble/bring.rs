//! Carrying channels to the log's times.

use super::index::{At, Index};
use crate::between::{Between, carry, period};
use crate::error::listed;
use crate::recording::{Recording, Values};
use crate::{LogError, Series};

/// Carries columns to the log's times and remembers what it did to them.
pub(super) struct Bring<'a> {
    pub recording: &'a Recording,
    pub clocks: &'a [Result<Series, String>],
    pub base: usize,
    pub times: &'a [f64],
    /// Channels that were carried without the map telling how: their group and name.
    pub sparse: Vec<(usize, String)>,
}

impl<'a> Bring<'a> {
    pub fn column(&mut self, index: &Index<'a>, at: At, between: Option<Between>, channel: &str) -> Series {
        let values = match &index.column(at).values {
            Values::Numbers(values) => values.clone(),
            _ => Series::default(),
        };
        let Ok(own) = &self.clocks[at.0] else { return vec![f64::NAN; self.times.len()].into() };
        if at.0 == self.base || own == self.times {
            return values;
        }
        let entry = (at.0, channel.to_owned());
        if between.is_none() && !self.sparse.contains(&entry) {
            self.sparse.push(entry);
        }
        carry(own, &values, self.times, between.unwrap_or(Between::Missing)).into()
    }

    pub fn all(
        &mut self,
        index: &Index<'a>,
        columns: &[At],
        between: Option<Between>,
        channel: &str,
    ) -> Result<Vec<Series>, LogError> {
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

pub(super) fn borrowed(columns: &[Series]) -> Vec<&[f64]> {
    columns.iter().map(AsRef::as_ref).collect()
}
