//! Why a log was refused: always one line that names the file, and the line where there is one.

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

/// A text from a file, short and without control characters, for an error message.
pub fn quoted(text: &str) -> String {
    let escaped: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    format!("'{escaped}{}'", if text.chars().count() > 40 { "..." } else { "" })
}

/// Some of the names, for an error message that must stay one line.
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.into_iter().collect();
    let shown: Vec<_> = names.iter().take(12).map(|name| quoted(name).trim_matches('\'').to_owned()).collect();
    let rest = names.len().saturating_sub(shown.len());
    shown.join(", ") + &(if rest > 0 { format!(" and {rest} more") } else { String::new() })
}
