//! The start values of an FMU that was packed with its own, as JSON.
//!
//! They stand in the library itself, in a slot that `pack` fills in the library's file: so they are there whatever
//! resource location a host gives. A library whose bytes are signed (macOS) cannot be filled; it finds them in
//! `resources/start_values.json`.

use crate::model::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, Ordering};

/// Name of the file below `resources`.
pub const FILE: &str = "start_values.json";

const MARK_SIZE: usize = 32;
const LENGTH_SIZE: usize = 4;
/// Bytes for the text.
const SLOT_SIZE: usize = 16 << 10;
const SIZE: usize = MARK_SIZE + LENGTH_SIZE + SLOT_SIZE;

/// A mark by which the slot is found, the length of the text (little-endian), the text. Atomic, and used for all that
/// the compiler knows, so that it is read and not taken for what stands here.
#[used]
static SLOT: [AtomicU8; SIZE] = {
    let mark = *b"wheelstate start values, room 1:";
    let mut slot = [const { AtomicU8::new(0) }; SIZE];
    let mut i = 0;
    while i < MARK_SIZE {
        slot[i] = AtomicU8::new(mark[i]);
        i += 1;
    }
    slot
};

fn stored(from: usize, count: usize) -> Vec<u8> {
    SLOT[from..from + count].iter().map(|byte| byte.load(Ordering::Relaxed)).collect()
}

/// The text in this library's own slot, if there is one.
fn embedded() -> Option<String> {
    let length = stored(MARK_SIZE, LENGTH_SIZE);
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
    (1..=SLOT_SIZE)
        .contains(&length)
        .then(|| stored(MARK_SIZE + LENGTH_SIZE, length))
        .and_then(|bytes| String::from_utf8(bytes).ok())
}

/// Fills the slot in the bytes of a library.
pub fn embed(library: &mut [u8], text: &str) -> Result<(), String> {
    let mark = stored(0, MARK_SIZE);
    let is_slot = |at: &usize| {
        library[*at..].starts_with(&mark)
            && library[at + MARK_SIZE..].iter().take(SIZE - MARK_SIZE).all(|byte| *byte == 0)
    };
    let last = library.len().saturating_sub(SIZE - 1);
    let at = (0..last).find(is_slot).ok_or("the library has no empty slot for start values")?;
    if text.len() > SLOT_SIZE {
        return Err(format!("the start values take {} bytes, there is room for {SLOT_SIZE}", text.len()));
    }
    let slot = &mut library[at + MARK_SIZE..at + SIZE];
    slot[..LENGTH_SIZE].copy_from_slice(&(text.len() as u32).to_le_bytes());
    slot[LENGTH_SIZE..LENGTH_SIZE + text.len()].copy_from_slice(text.as_bytes());
    Ok(())
}

/// The parameters whose start values differ from the model's defaults.
/// Enumerations count from 0, Booleans are 0 or 1.
#[derive(Serialize, Deserialize)]
pub struct StartValues {
    format_version: u32,
    model: String,
    parameters: BTreeMap<String, f64>,
}

impl StartValues {
    /// Whether no start value differs.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// The text.
    pub fn to_json(&self) -> String {
        // maps with text keys and finite numbers always have a JSON form
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

/// The start values of `model` that differ from those of `default`.
pub fn differences(model: &Model, default: &Model) -> StartValues {
    let pairs = model.parameters.iter().zip(&default.parameters);
    let changed = pairs.filter(|(own, other)| own.start.to_bits() != other.start.to_bits());
    let parameters = changed.map(|(own, _)| (own.name.clone(), own.start)).collect();
    StartValues { format_version: 1, model: model.name.to_owned(), parameters }
}

/// Puts the start values that the FMU was packed with into the model.
pub fn load(model: &mut Model, guid: &str, resource_location: Option<&str>) -> Result<(), String> {
    let why = format!("the GUID '{guid}' says that this FMU has start values of its own");
    if let Some(text) = embedded() {
        return read(model, &text).map_err(|what| format!("{why}, but those in the library cannot be used: {what}"));
    }
    let Some(location) = resource_location.filter(|location| !location.is_empty()) else {
        return Err(format!("{why}, but fmuResourceLocation is not given"));
    };
    let folder =
        path(location).ok_or_else(|| format!("{why}, but fmuResourceLocation '{location}' is not a file URI"))?;
    let file = folder.join(FILE);
    let text = std::fs::read_to_string(&file).map_err(|error| format!("{why}, but {}: {error}", file.display()))?;
    read(model, &text).map_err(|what| format!("{why}, but {}: {what}", file.display()))
}

/// Puts the start values of a text into the model.
fn read(model: &mut Model, text: &str) -> Result<(), String> {
    let values: StartValues = serde_json::from_str(text).map_err(|error| error.to_string())?;
    if values.format_version != 1 {
        return Err(format!("format_version {} is not known", values.format_version));
    }
    if values.model != model.name {
        return Err(format!("they are for {}, not for {}", values.model, model.name));
    }
    let mut list = Vec::new();
    for (name, value) in &values.parameters {
        let (index, _) = model.parameter(name).ok_or_else(|| format!("there is no parameter {name}"))?;
        list.push((index, *value));
    }
    model.bake(&list)
}

/// The folder of a resource location: `file:///a`, `file:/a`, `file://localhost/a`, `file:///C:/a`
/// with percent signs decoded, or a plain absolute path.
pub fn path(location: &str) -> Option<PathBuf> {
    let lower = location.get(..5).map(str::to_ascii_lowercase);
    if lower.as_deref() != Some("file:") {
        let plain = PathBuf::from(location);
        return plain.is_absolute().then_some(plain);
    }
    let rest = &location[5..];
    let rest = match rest.strip_prefix("//") {
        Some(authority) => match authority.find('/') {
            Some(0) => authority,
            Some(slash) if authority[..slash].eq_ignore_ascii_case("localhost") => &authority[slash..],
            _ => return None,
        },
        None => rest,
    };
    let decoded = decode(rest)?;
    let bytes = decoded.as_bytes();
    let drive = bytes.len() >= 3 && bytes[0] == b'/' && bytes[1].is_ascii_alphabetic() && bytes[2] == b':';
    Some(PathBuf::from(if drive { &decoded[1..] } else { &decoded }))
}

fn decode(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, after @ ..] = rest {
        rest = after;
        if *first == b'%' {
            let [high, low, after @ ..] = rest else { return None };
            let digit = |byte: u8| char::from(byte).to_digit(16);
            bytes.push((digit(*high)? * 16 + digit(*low)?) as u8);
            rest = after;
        } else {
            bytes.push(*first);
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_is_filled_once_and_not_beyond_its_size() {
        let mut library = vec![7; 100];
        // the mark alone is no slot
        library.extend(stored(0, MARK_SIZE));
        library.extend([7; 100]);
        let at = library.len();
        library.extend(stored(0, SIZE));
        library.push(7);
        let long = "x".repeat(SLOT_SIZE + 1);
        assert!(embed(&mut library, &long).unwrap_err().contains("16385 bytes"));
        embed(&mut library, "values").unwrap();
        assert_eq!(&library[at + MARK_SIZE..at + MARK_SIZE + LENGTH_SIZE + 7], b"\x06\0\0\0values\0");
        assert!(embed(&mut library, "values").is_err());
        assert!(embed(&mut [7; 10], "values").is_err());
    }

    #[test]
    fn every_form_of_a_file_location_is_understood() {
        let found = |location| path(location).map(|path| path.to_string_lossy().into_owned());
        for (location, expected) in [
            ("file:///a/b", "/a/b"),
            ("file:/a/b", "/a/b"),
            ("file://localhost/a/b", "/a/b"),
            ("FILE:///a%20b/%C3%BC", "/a b/\u{fc}"),
            ("file:///C:/a", "C:/a"),
            ("/a/b", "/a/b"),
        ] {
            assert_eq!(found(location).as_deref(), Some(expected), "{location}");
        }
        for location in ["http://a/b", "file://server/a", "file:///a%2", "file:///a%zz", "relative"] {
            assert_eq!(found(location), None, "{location}");
        }
    }
}
