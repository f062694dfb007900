//! How a column map points at a column of a log.

use std::fmt;
use toml::Value;

/// One of several things: by its name, or by its place counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Which {
    Name(String),
    Index(usize),
}

/// A column, and the group that it is in where that is given.
///
/// A name alone is looked for in all groups; if there is none, the text before a `/` or a `.` in it is
/// taken for a group, by name or by place: `engine/speed`, `1/speed`, `/odom.twist.twist.linear.x`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Selector {
    pub group: Option<Which>,
    pub column: Which,
}

impl Which {
    pub fn parse(key: &str, value: &Value) -> Result<Self, String> {
        match value {
            Value::String(name) => Ok(Self::Name(name.clone())),
            Value::Integer(index) => usize::try_from(*index)
                .map(Self::Index)
                .map_err(|_| format!("{key} = {index} is not a place; 0 is the first")),
            _ => Err(format!("{key} must be a name in quotes or a place counted from 0")),
        }
    }
}

impl Selector {
    pub fn named(name: &str) -> Self {
        Self { group: None, column: Which::Name(name.to_owned()) }
    }

    /// The ways to read a name as group and column, whole name first.
    pub fn splits(name: &str) -> impl Iterator<Item = (&str, &str)> {
        name.char_indices().filter(|(_, c)| matches!(c, '/' | '.')).map(|(at, _)| (&name[..at], &name[at + 1..]))
    }

    /// The name as written in the map, if the column is given by name.
    pub fn name(&self) -> Option<&str> {
        match &self.column {
            Which::Name(name) => Some(name),
            Which::Index(_) => None,
        }
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match &self.column {
            Which::Name(name) => write!(f, "'{}'", name.escape_debug())?,
            Which::Index(index) => write!(f, "number {index}")?,
        }
        match &self.group {
            None => Ok(()),
            Some(Which::Name(name)) => write!(f, " in group '{}'", name.escape_debug()),
            Some(Which::Index(index)) => write!(f, " in group {index}"),
        }
    }
}
