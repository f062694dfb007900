//! A zip archive whose bytes depend on its files alone: sorted, with fixed times and modes.

use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter, result::ZipError};

/// Packs files given as (path with forward slashes, content, executable).
pub fn zip(mut files: Vec<(String, Vec<u8>, bool)>) -> Result<Vec<u8>, ZipError> {
    files.sort();
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (path, content, executable) in files {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .last_modified_time(DateTime::default()) // 1980-01-01, the first that a zip can hold
            .unix_permissions(if executable { 0o755 } else { 0o644 });
        zip.start_file(path, options)?;
        zip.write_all(&content)?;
    }
    Ok(zip.finish()?.into_inner())
}
