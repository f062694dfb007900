//! Column maps: how the columns of a foreign log become the channels of an estimator.
//!
//! A map is a TOML file. Each key is a channel, its value says where the channel comes from:
//!
//! ```toml
//! time = "time_s"
//! speed = { column = "v_kmh", unit = "km/h" }
//! torque_left = { column = "motor_torque_Nm", scale = 4.8325, missing_if = "v_kmh < 10.8 || motor_torque_Nm <= 5" }
//! yaw_rate = "({v right} - {v left}) / 0.55"
//! steering_angle = ["delta_filtered", "delta"]              # the first that exists
//! accel_x = { column = "ax", group = 2, between = "hold" }  # or column = "imu/ax", "2/ax", or column = 7
//! encoder_left = { column = "wheel_speed_left", unit = "rpm", integrate = true }
//! tilt_rate = { column = "pitch", unit = "deg", differentiate = true }
//! drive_force = { column = "motor_torque", scale = 3.2, unit = "N", optional = true }
//! wheel_speed = { column = "n_wheel", unit = "rpm", radius = 0.31 }
//! slope = { value = 0 }
//! ```
//!
//! **Source.** One of
//! - `column`: a name, the place of a column counted from 0, or a list of these of which the first that exists
//!   is taken. A name may be led by its group (see [groups](#groups));
//! - `expression`: arithmetic, comparisons and conditions over columns: `+ - * / ^`, `< <= > >= == !=`, `&& || !`,
//!   `abs sqrt sin cos missing`, parentheses; names with other characters than letters, digits and `_`
//!   stand in braces;
//! - `value`: the same number at every sample.
//!
//! A bare text is a `column`; if no column has this name, it is read as an `expression`.
//!
//! **Value.** `(scale * source + offset)`, read in `unit` and turned into SI. Without `unit` the unit that the
//! file states is used (MDF4, DBC, `speed [km/h]` in the header of a CSV file); a stated unit that is not known, or
//! of another quantity than the channel, is refused, and so is a `scale` without a `unit` for a column that is
//! recorded in anything but SI, as nobody can tell whether the scale already turns it into SI. Expressions
//! and conditions see the numbers as they were recorded.
//! `radius` (m) then turns an angle into a distance (and the same for rates); `differentiate = true` and
//! `integrate = true` follow last, over the log's time: central differences, and the trapezoidal rule from zero,
//! which bridges samples that are missing for up to 0.1 s or two periods and refuses longer gaps.
//!
//! **Missing samples.** A sample is missing where `missing_if` holds or cannot be evaluated because a
//! column that it names has no sample there; a `missing_if` of its own line applies to all mapped
//! channels. Times have no `missing_if`. A channel with `optional = true` whose columns the log lacks is left out.
//!
//! # Groups
//! MDF4, MCAP and CAN logs record groups of channels with clocks of their own. `group` is the group's name or its
//! place counted from 0; `column = "group/channel"` and `column = "1/speed"` say the same. Topics and CAN messages are
//! groups, too: `speed = "/odom.twist.twist.linear.x"`, `speed = "ESP_21.ESP_v_Signal"`.
//! `time` names the group whose clock becomes the log's; without it the group with the most samples per
//! second among those that are used is taken. `between` says what samples of the other groups become:
//!
//! | `between` | value at a time of the log |
//! |---|---|
//! | `"missing"` (default) | each recorded sample at the nearest time of the log, nothing in between |
//! | `"hold"` | the last sample, for at most two periods of its group |
//! | `"nearest"` | the nearest sample, at most one period of its group away |
//! | `"linear"` | interpolated between two samples that are at most two periods apart |
//!
//! A `between` of its own line applies to all channels. `scale`, `offset` and `unit` of `time` apply to the log's time
//! after groups have been brought together.
//!
//! # Joining files
//! ```toml
//! join = [{ file = "{stem}_gps.csv", time = "t", offset = -0.35, as = "gps" }]
//! speed = "gps/v"
//! ```
//! adds the groups of another file; its times plus `offset` (s) are times of the log. `{stem}` is the name
//! of the log without its ending; relative paths start at the map. `time` is the other file's time column (default `time`).
//!
//! # Formats
//! ```toml
//! [csv]                  # what is detected otherwise
//! separator = ";"        # or "tab", ",", "|"
//! decimal = ","
//! comment = "#"          # lines that begin so are skipped
//! skip = 2               # lines before the header
//! units = true           # the line under the header holds units
//! encoding = "latin-1"   # or "utf-8", "utf-16le", "utf-16be"
//! missing = ["-999"]     # further texts that mean a missing sample
//!
//! [mcap]
//! time = "log"           # or "publish", or "header": the stamp in the message's header (default where there is one)
//!
//! [can]
//! dbc = ["car.dbc"]      # relative to the map
//! channel = 1            # the bus, where messages are on several: a number, or a name as candump's "can0"
//! ```
//!
//! Columns that no channel is read from keep their own names where all of a log is wanted, as by `convert`; other commands
//! leave them unread. What is not used never refuses a file.

mod expression;
mod names;
mod rule;
mod select;
pub(crate) mod unit;

pub use names::{fits, hint, listed, nearest, quoted};
pub(crate) use rule::{Candidate, Rule, Source};
pub(crate) use select::{Selector, Which};

use crate::between::Between;
pub(crate) use expression::Expression;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A column map, read and checked.
#[derive(Clone, Debug)]
pub struct ColumnMap {
    pub(crate) file: String,
    /// Where relative paths in the map start.
    folder: PathBuf,
    pub(crate) time: Option<Rule>,
    pub(crate) channels: Vec<(String, Rule)>,
    pub(crate) missing_if: Option<Expression>,
    pub(crate) between: Option<Between>,
    pub(crate) joins: Vec<Join>,
    pub(crate) csv: CsvOptions,
    pub(crate) stamps: Option<Stamps>,
    pub(crate) dbc: Vec<PathBuf>,
    /// The bus of a CAN log.
    pub(crate) can_channel: Option<String>,
}

/// Another file whose groups are added.
#[derive(Clone, Debug)]
pub(crate) struct Join {
    pub file: String,
    pub time: Option<Rule>,
    pub offset: f64,
    pub name: Option<String>,
}

/// What a map says about the dialect of CSV files; `None` is detected.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CsvOptions {
    pub separator: Option<u8>,
    pub decimal: Option<u8>,
    pub comment: Option<u8>,
    pub skip: usize,
    pub units: Option<bool>,
    pub encoding: Option<Encoding>,
    pub missing: Vec<String>,
}

/// Encodings of text files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Utf8,
    Latin1,
    Utf16Le,
    Utf16Be,
}

/// Which of a message's times counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stamps {
    Log,
    Publish,
    Header,
}

/// A column map that is wrong, or does not fit the log.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{file}: {what}")]
pub struct MapError {
    /// Path of the map.
    pub file: String,
    /// The key, what is wrong with it, and what is expected.
    pub what: String,
}

impl ColumnMap {
    /// Reads a map.
    pub fn read(path: &Path) -> Result<Self, MapError> {
        let file = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => {
                let mut map = Self::parse(&file, &text)?;
                map.folder = path.parent().unwrap_or(Path::new("")).to_owned();
                Ok(map)
            }
            Err(e) => Err(MapError { file, what: e.to_string() }),
        }
    }

    /// Parses a map; `file` is named in errors, and relative paths start at the working directory.
    ///
    /// ```
    /// use wheelstate_log::{ColumnMap, Log};
    ///
    /// let map = ColumnMap::parse("map.toml", "speed = { column = 'v_kmh', unit = 'km/h', missing_if = 'v_kmh > 300' }")?;
    /// let log = Log::from_csv("log.csv", "time,v_kmh\n0,36\n1,999\n".as_bytes(), Some(&map))?;
    /// let speed = log.require("speed")?;
    /// assert!(speed[0] == 10.0 && speed[1].is_nan());
    /// assert!(ColumnMap::parse("map.toml", "speed = 1").unwrap_err().to_string().starts_with("map.toml"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn parse(file: &str, text: &str) -> Result<Self, MapError> {
        let table: Table = toml::from_str(text).map_err(|e: toml::de::Error| {
            let line = e.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let place = line.map_or(String::new(), |line| format!(":{line}"));
            let what = e.message().lines().collect::<Vec<_>>().join(" ");
            MapError { file: format!("{file}{place}"), what }
        })?;
        let mut map = Self {
            file: file.to_owned(),
            folder: PathBuf::new(),
            time: None,
            channels: Vec::new(),
            missing_if: None,
            between: None,
            joins: Vec::new(),
            csv: CsvOptions::default(),
            stamps: None,
            dbc: Vec::new(),
            can_channel: None,
        };
        for (key, value) in &table {
            map.entry(key, value).map_err(|what| MapError { file: file.to_owned(), what: format!("{key}: {what}") })?;
        }
        Ok(map)
    }

    fn entry(&mut self, key: &str, value: &Value) -> Result<(), String> {
        match (key, value) {
            ("missing_if", Value::String(text)) => self.missing_if = Some(Expression::parse(text)?),
            ("between", Value::String(text)) => self.between = Some(Between::parse(text)?),
            ("time", value) => {
                let rule = Rule::parse(value)?;
                if rule.missing_if.is_some() || matches!(rule.source, Source::Value(_)) || !rule.is_plain_time() {
                    return Err("needs a column and takes no missing_if".to_owned());
                }
                self.time = Some(rule);
            }
            ("join", Value::Array(joins)) => {
                self.joins = joins.iter().map(Join::parse).collect::<Result<_, _>>()?;
            }
            ("join", _) => return Err("a list of tables { file = \"...\", offset = 0.0 } is expected".to_owned()),
            ("csv", Value::Table(table)) if !Rule::is_rule(table) => self.csv = CsvOptions::parse(table)?,
            ("mcap", Value::Table(table)) if !Rule::is_rule(table) => {
                known(table, &["time"])?;
                self.stamps = match table.get("time").and_then(Value::as_str) {
                    Some("log") => Some(Stamps::Log),
                    Some("publish") => Some(Stamps::Publish),
                    Some("header") => Some(Stamps::Header),
                    _ => return Err("time must be \"log\", \"publish\" or \"header\"".to_owned()),
                };
            }
            ("can", Value::Table(table)) if !Rule::is_rule(table) => {
                known(table, &["dbc", "channel"])?;
                self.can_channel = match table.get("channel") {
                    None => None,
                    Some(Value::String(name)) => Some(name.clone()),
                    Some(Value::Integer(number)) => Some(number.to_string()),
                    Some(_) => return Err("channel must be a number or a name in quotes".to_owned()),
                };
                let paths = table.get("dbc").map(|value| texts("dbc", value)).transpose()?.unwrap_or_default();
                self.dbc = paths.into_iter().map(PathBuf::from).collect();
            }
            (name, value) => {
                let rule = Rule::parse(value)?;
                self.channels.push((name.to_owned(), rule));
            }
        }
        Ok(())
    }

    /// The mapped channels whose unit is stated, with the SI unit that their values have after mapping.
    pub fn units(&self) -> impl Iterator<Item = (&str, &'static str)> {
        self.channels.iter().filter_map(|(name, rule)| Some((name.as_str(), rule.si_after(rule.unit?.si).ok()?)))
    }

    /// The mapped channels.
    pub fn channels(&self) -> impl Iterator<Item = &str> {
        self.channels.iter().map(|(name, _)| name.as_str())
    }

    /// An error about this map.
    pub fn error(&self, what: impl Into<String>) -> MapError {
        MapError { file: self.file.clone(), what: what.into() }
    }

    /// A path that stands in the map, as seen from the working directory.
    pub(crate) fn path(&self, path: &Path) -> PathBuf {
        self.folder.join(path)
    }
}

impl Join {
    /// The other file, for a log; `{stem}` is the log's name without its ending.
    pub fn path(&self, log: &Path) -> PathBuf {
        let name = log.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.split_once('.').map_or(name.as_str(), |(stem, _)| stem);
        PathBuf::from(self.file.replace("{stem}", stem))
    }

    fn parse(value: &Value) -> Result<Self, String> {
        let Value::Table(table) = value else {
            return Err("a list of tables { file = \"...\", offset = 0.0 } is expected".to_owned());
        };
        known(table, &["file", "time", "offset", "as"])?;
        let text = |key: &str| match table.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text.clone())),
            Some(_) => Err(format!("{key} must be a text in quotes")),
        };
        Ok(Self {
            file: text("file")?.ok_or("file is missing")?,
            time: table.get("time").map(Rule::parse).transpose().map_err(|e| format!("time: {e}"))?,
            offset: rule::number(table, "offset")?.unwrap_or(0.0),
            name: text("as")?,
        })
    }
}

impl CsvOptions {
    fn parse(table: &Table) -> Result<Self, String> {
        known(table, &["separator", "decimal", "comment", "skip", "units", "encoding", "missing"])?;
        let text = |key: &str| match table.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text.as_str())),
            Some(_) => Err(format!("{key} must be a text in quotes")),
        };
        let byte = |key: &str| match text(key)? {
            None => Ok(None),
            Some("tab" | "\t") => Ok(Some(b'\t')),
            Some(one) if one.len() == 1 && !matches!(one, "\"" | "\n" | "\r") => Ok(Some(one.as_bytes()[0])),
            Some(_) => Err(format!("{key} must be a single character, or \"tab\"")),
        };
        Ok(Self {
            separator: byte("separator")?,
            decimal: match byte("decimal")? {
                None | Some(b'.' | b',') => byte("decimal")?,
                Some(_) => return Err("decimal must be \".\" or \",\"".to_owned()),
            },
            comment: byte("comment")?,
            skip: match table.get("skip") {
                None => 0,
                Some(Value::Integer(lines)) if *lines >= 0 => *lines as usize,
                Some(_) => return Err("skip must be a number of lines".to_owned()),
            },
            units: match table.get("units") {
                None => None,
                Some(Value::Boolean(units)) => Some(*units),
                Some(_) => return Err("units must be true or false".to_owned()),
            },
            encoding: match text("encoding")?.map(str::to_ascii_lowercase).as_deref() {
                None => None,
                Some("utf-8" | "utf8") => Some(Encoding::Utf8),
                Some("latin-1" | "latin1" | "iso-8859-1" | "windows-1252" | "cp1252") => Some(Encoding::Latin1),
                Some("utf-16le" | "utf-16") => Some(Encoding::Utf16Le),
                Some("utf-16be") => Some(Encoding::Utf16Be),
                Some(other) => {
                    let other = other.escape_debug();
                    return Err(format!(
                        "encoding '{other}' is not known; known are utf-8, latin-1, utf-16le, utf-16be"
                    ));
                }
            },
            missing: table.get("missing").map(|value| texts("missing", value)).transpose()?.unwrap_or_default(),
        })
    }
}

/// Refuses keys that are not known.
fn known(table: &Table, keys: &[&str]) -> Result<(), String> {
    match table.keys().find(|key| !keys.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(format!("unknown key '{key}'; known keys are {}", keys.join(", "))),
    }
}

/// One text or a list of texts.
fn texts(key: &str, value: &Value) -> Result<Vec<String>, String> {
    let values = match value {
        Value::Array(values) => values.as_slice(),
        value => std::slice::from_ref(value),
    };
    let text = |value: &Value| value.as_str().map(str::to_owned);
    values.iter().map(text).collect::<Option<_>>().ok_or_else(|| format!("{key} must be a text or a list of texts"))
}
