//! What a look at a log found before anything was fitted to it.

use serde::{Deserialize, Serialize};

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Good to know.
    Note,
    /// May spoil a fit.
    Warning,
    /// Spoils a fit for certain: nothing is fitted to this log unless the user allows the finding's code.
    Refusal,
}

impl Severity {
    /// Its word, as in JSON.
    pub fn word(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Refusal => "refusal",
        }
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The log's file.
    pub file: String,
    /// The channel, or several with commas; empty if the log as a whole is meant.
    pub channel: String,
    /// Where it begins, s, if it has a place.
    pub time: Option<f64>,
    /// What kind of finding it is: a stable word for programs to match.
    pub code: String,
    /// How much it matters.
    pub severity: Severity,
    /// What was found, in one sentence.
    pub message: String,
    /// What to do about it.
    pub suggestion: String,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { file, channel, code, message, suggestion, .. } = self;
        write!(f, "{file}: ")?;
        if !channel.is_empty() && !message.contains(&format!("'{channel}'")) {
            write!(f, "{channel}: ")?;
        }
        if let Some(time) = self.time {
            write!(f, "at {time} s: ")?;
        }
        write!(f, "{message}; {suggestion} [{code}]")
    }
}
