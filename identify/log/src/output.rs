//! Files that are either whole or not there: written beside their place, then renamed.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use tempfile::{Builder, NamedTempFile};

/// Some files that appear together once all of them are complete.
#[derive(Debug, Default)]
pub struct Outputs {
    waiting: Vec<(NamedTempFile, PathBuf)>,
}

/// A file that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {reason}")]
pub struct OutputError {
    /// Path of the file.
    pub path: String,
    /// Why not.
    pub reason: String,
}

impl OutputError {
    fn new(path: &Path, reason: impl ToString) -> Self {
        let (path, reason) = (path.display().to_string(), reason.to_string().replace('\n', " "));
        let named = format!("{path}: ");
        Self { reason: reason.strip_prefix(&named).map_or(reason.clone(), str::to_owned), path }
    }
}

impl Outputs {
    /// No file yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Refuses a path that cannot be written, before long computations.
    pub fn check(path: &Path) -> Result<(), OutputError> {
        if path.is_dir() {
            return Err(OutputError::new(path, "is a directory"));
        }
        let directory = directory(path);
        if !directory.is_dir() {
            return Err(OutputError::new(path, format!("there is no directory '{}'", directory.display())));
        }
        temporary(path).map(drop)
    }

    /// Adds a text file.
    pub fn text(&mut self, path: &Path, text: &str) -> Result<(), OutputError> {
        self.file(path, |mut file| io::Write::write_all(&mut file, text.as_bytes()).map_err(|e| e.to_string()))
    }

    /// Adds a file that `fill` writes.
    pub fn file<E: ToString>(
        &mut self,
        path: &Path,
        fill: impl FnOnce(File) -> Result<(), E>,
    ) -> Result<(), OutputError> {
        if self.waiting.iter().any(|(_, other)| other == path) {
            return Err(OutputError::new(path, "two outputs have this name"));
        }
        let waiting = temporary(path)?;
        let file = waiting.as_file().try_clone().map_err(|e| OutputError::new(path, e))?;
        fill(file).map_err(|e| OutputError::new(path, e.to_string()))?;
        self.waiting.push((waiting, path.to_owned()));
        Ok(())
    }

    /// Puts all files in their places.
    pub fn commit(self) -> Result<(), OutputError> {
        for (file, path) in self.waiting {
            file.persist(&path).map_err(|e| OutputError::new(&path, e.error))?;
        }
        Ok(())
    }
}

/// The directory that a file is in.
fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A file in the same directory, so that renaming it is one step.
fn temporary(path: &Path) -> Result<NamedTempFile, OutputError> {
    let mut builder = Builder::new();
    builder.prefix(".wheelstate-");
    #[cfg(unix)]
    {
        // As open programs do: readable for all as far as the user's mask allows.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(directory(path)).map_err(|e| OutputError::new(path, e.kind()))
}
