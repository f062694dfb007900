//! Recorded or simulated logs: uniform in memory whatever file they came from.

/// A log: one time base and named channels of the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    /// Where it came from: the file's path, or the scenario.
    pub source: String,
    /// Sample times, s, increasing.
    pub time: Vec<f64>,
    /// The channels, named as the FMU's inputs; `true_*` are references for reports.
    pub channels: Vec<Channel>,
}

/// One channel of a [`Log`]. NaN is a missing sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name, as the FMU's input.
    pub name: String,
    /// One value per sample, SI units.
    pub values: Vec<f64>,
}

impl Log {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample at all.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The values of a channel, if the log has it.
    pub fn channel(&self, name: &str) -> Option<&[f64]> {
        self.channels.iter().find(|channel| channel.name == name).map(|channel| channel.values.as_slice())
    }

    /// Adds a channel; all channels have as many values as there are times.
    pub fn push(&mut self, name: &str, values: Vec<f64>) {
        debug_assert_eq!(values.len(), self.len());
        self.channels.push(Channel { name: name.to_owned(), values });
    }
}
