//! Why a log was refused: always one line that names the file, and the line where there is one.

pub use super::columns::{listed, quoted};
use crate::progress::Interrupted;

/// A log that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// Something is wrong with one line of a text file.
    #[error("{file}:{line}: {what}")]
    Line {
        /// Path of the file.
        file: String,
        /// Line, counted from 1.
        line: u64,
        /// What is wrong and what is expected.
        what: String,
    },
    /// Something is wrong with the file as a whole.
    #[error("{file}: {what}")]
    File {
        /// Path of the file.
        file: String,
        /// What is wrong and what is expected.
        what: String,
    },
    /// The column map does not fit or is wrong in itself.
    #[error(transparent)]
    Columns(#[from] super::columns::MapError),
    /// The user asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

impl LogError {
    /// An error about a whole file.
    pub fn file(file: &str, what: impl Into<String>) -> Self {
        Self::File { file: file.to_owned(), what: what.into() }
    }

    /// An error about one line of a file.
    pub fn line(file: &str, line: u64, what: impl Into<String>) -> Self {
        Self::Line { file: file.to_owned(), line, what: what.into() }
    }
}
