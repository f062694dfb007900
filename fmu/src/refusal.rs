//! Calls that were refused. A refused call changes nothing.

/// How bad a refusal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// The request was meaningful but cannot be served.
    Discard,
    /// The request was wrong.
    Error,
    /// The instance is lost.
    Fatal,
}

/// A call that was refused, with the reason for the host's log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// How bad it is.
    pub level: Level,
    /// What was wrong and what would be allowed.
    pub message: String,
}

impl Refusal {
    /// An error.
    pub fn error(message: impl Into<String>) -> Self {
        Self { level: Level::Error, message: message.into() }
    }

    /// A request that is legal but has no answer here.
    pub fn discard(message: impl Into<String>) -> Self {
        Self { level: Level::Discard, message: message.into() }
    }
}

/// What the calls give.
pub type Answer<T> = Result<T, Refusal>;
