//! Column maps: how the columns of a foreign log become the channels of an estimator.
//!
//! ```toml
//! time = "time_s"
//! speed = { column = "v_kmh", unit = "km/h" }
//! torque_left = { column = "motor_torque_Nm", scale = 4.8325, missing_if = "v_kmh < 10.8 || motor_torque_Nm <= 5" }
//! yaw_rate = { expression = "({v right} - {v left}) / 0.55" }
//! slope = { value = 0 }
//! ```
//!
//! A channel is `scale * column + offset`, read in `unit` and turned into SI. Instead of a `column`
//! it may have an `expression` over columns or one `value`. A sample is missing where `missing_if`
//! holds or cannot be evaluated because a column that it names has no sample there; a `missing_if`
//! of its own line applies to all mapped channels. Times have no `missing_if`. Columns that no
//! channel is read from keep their own names.

mod expression;
pub(crate) mod unit;

use expression::Expression;
use std::path::Path;
use toml::{Table, Value};

/// Keys of a channel's table.
const KEYS: [&str; 7] = ["column", "expression", "value", "scale", "offset", "unit", "missing_if"];

/// Named columns with their values.
pub type Columns = Vec<(String, Vec<f64>)>;

/// A column map, read and checked.
#[derive(Clone, Debug)]
pub struct ColumnMap {
    file: String,
    time: Rule,
    channels: Vec<(String, Rule)>,
    missing_if: Option<Expression>,
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

/// Where the values of one channel come from.
#[derive(Clone, Debug)]
struct Rule {
    source: Source,
    scale: f64,
    offset: f64,
    unit: Option<unit::Unit>,
    missing_if: Option<Expression>,
}

#[derive(Clone, Debug)]
enum Source {
    Column(String),
    Expression(Expression),
    Value(f64),
}

impl ColumnMap {
    /// Reads a map.
    pub fn read(path: &Path) -> Result<Self, MapError> {
        let file = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(&file, &text),
            Err(e) => Err(MapError { file, what: e.to_string() }),
        }
    }

    /// Parses a map; `file` is named in errors.
    pub fn parse(file: &str, text: &str) -> Result<Self, MapError> {
        let fail = |what: String| MapError { file: file.to_owned(), what };
        let table: Table = toml::from_str(text).map_err(|e: toml::de::Error| {
            let line = e.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let place = line.map_or(String::new(), |line| format!(":{line}"));
            let what = e.message().lines().collect::<Vec<_>>().join(" ");
            MapError { file: format!("{file}{place}"), what }
        })?;
        let mut time = None;
        let mut channels = Vec::new();
        let mut missing_if = None;
        for (key, value) in &table {
            match (key.as_str(), value) {
                ("missing_if", Value::String(text)) => {
                    missing_if = Some(Expression::parse(text).map_err(|e| fail(format!("missing_if: {e}")))?);
                }
                ("time", value) => {
                    let rule = Rule::parse(value).map_err(|e| fail(format!("time: {e}")))?;
                    if rule.missing_if.is_some() || matches!(rule.source, Source::Value(_)) {
                        return Err(fail("time: needs a column and takes no missing_if".to_owned()));
                    }
                    time = Some(rule);
                }
                (name, value) => {
                    let rule = Rule::parse(value).map_err(|e| fail(format!("{name}: {e}")))?;
                    channels.push((name.to_owned(), rule));
                }
            }
        }
        let time = time.unwrap_or(Rule::plain("time"));
        Ok(Self { file: file.to_owned(), time, channels, missing_if })
    }

    /// Whether the map needs this column of the log.
    pub fn uses(&self, column: &str) -> bool {
        self.rules().any(|(_, rule)| rule.columns().any(|name| name == column))
            || self.missing_if.as_ref().is_some_and(|c| c.names().iter().any(|name| name == column))
    }

    /// The mapped channels whose unit is stated, with the SI unit that their values have after mapping.
    pub fn units(&self) -> impl Iterator<Item = (&str, &'static str)> {
        self.channels.iter().filter_map(|(name, rule)| Some((name.as_str(), rule.unit?.si)))
    }

    /// The mapped channels.
    pub fn channels(&self) -> impl Iterator<Item = &str> {
        self.channels.iter().map(|(name, _)| name.as_str())
    }

    /// An error about this map.
    pub fn error(&self, what: impl Into<String>) -> MapError {
        MapError { file: self.file.clone(), what: what.into() }
    }

    /// Turns the columns of a log into times and channels: the mapped ones first, then those that
    /// the map does not use, under their own names. `log` is named in errors.
    pub fn apply(&self, log: &str, columns: Columns) -> Result<(Vec<f64>, Columns), MapError> {
        let names: Vec<_> = columns.iter().map(|(name, _)| name.as_str()).collect();
        for (key, rule) in self.rules() {
            if let Some(name) = rule.columns().find(|name| !names.contains(name)) {
                return Err(self.error(format!("{key}: {log} has no column '{name}'; {}", hint(name, &names))));
            }
        }
        if let Some(name) = self.missing_if.iter().flat_map(|c| c.names()).find(|n| !names.contains(&n.as_str())) {
            return Err(self.error(format!("missing_if: {log} has no column '{name}'; {}", hint(name, &names))));
        }
        let samples = columns.first().map_or(0, |(_, values)| values.len());
        let time = self.time.values(&columns, samples);
        let mut mapped = Columns::with_capacity(columns.len() + self.channels.len());
        for (name, rule) in &self.channels {
            let mut values = rule.values(&columns, samples);
            if let Some(condition) = &self.missing_if {
                condition.blank(&columns, &mut values);
            }
            mapped.push((name.clone(), values));
        }
        for (name, values) in columns {
            let read = |rule: &Rule| matches!(&rule.source, Source::Column(column) if *column == name);
            let taken = self.channels.iter().any(|(channel, _)| *channel == name) || name == "time";
            if !taken && !self.rules().any(|(_, rule)| read(rule)) {
                mapped.push((name, values));
            }
        }
        Ok((time, mapped))
    }

    fn rules(&self) -> impl Iterator<Item = (&str, &Rule)> {
        let channels = self.channels.iter().map(|(name, rule)| (name.as_str(), rule));
        std::iter::once(("time", &self.time)).chain(channels)
    }
}

impl Rule {
    fn plain(column: &str) -> Self {
        Self { source: Source::Column(column.to_owned()), scale: 1.0, offset: 0.0, unit: None, missing_if: None }
    }

    fn parse(value: &Value) -> Result<Self, String> {
        let table = match value {
            Value::String(column) => return Ok(Self::plain(column)),
            Value::Table(table) => table,
            _ => return Err("a column name or a table { column = \"...\", ... } is expected".to_owned()),
        };
        if let Some(key) = table.keys().find(|key| !KEYS.contains(&key.as_str())) {
            return Err(format!("unknown key '{key}'; known keys are {}", KEYS.join(", ")));
        }
        let text = |key: &str| match table.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text.as_str())),
            Some(_) => Err(format!("{key} must be a text in quotes")),
        };
        let number = |key: &str| match table.get(key) {
            None => Ok(None),
            Some(Value::Float(number)) if number.is_finite() => Ok(Some(*number)),
            Some(Value::Integer(number)) => Ok(Some(*number as f64)),
            Some(other) => Err(format!("{key} = {other} is not a finite number")),
        };
        let expression = |key: &str| text(key)?.map(Expression::parse).transpose().map_err(|e| format!("{key}: {e}"));
        let source = match (text("column")?, expression("expression")?, number("value")?) {
            (Some(column), None, None) => Source::Column(column.to_owned()),
            (None, Some(expression), None) => Source::Expression(expression),
            (None, None, Some(value)) => Source::Value(value),
            _ => return Err("exactly one of column, expression and value is expected".to_owned()),
        };
        let unit = text("unit")?.map(unit::find).transpose()?;
        let scale = number("scale")?.unwrap_or(1.0);
        if scale == 0.0 {
            return Err("scale = 0 would wipe the channel out; value = 0 is a channel of zeros".to_owned());
        }
        Ok(Self {
            source,
            scale,
            offset: number("offset")?.unwrap_or(0.0),
            unit,
            missing_if: expression("missing_if")?,
        })
    }

    /// All columns that this rule needs.
    fn columns(&self) -> impl Iterator<Item = &str> {
        let (column, names) = match &self.source {
            Source::Column(name) => (Some(name.as_str()), &[][..]),
            Source::Expression(expression) => (None, expression.names()),
            Source::Value(_) => (None, &[][..]),
        };
        let conditions = self.missing_if.as_ref().map_or(&[][..], Expression::names);
        column.into_iter().chain(names.iter().chain(conditions).map(String::as_str))
    }

    fn values(&self, columns: &Columns, samples: usize) -> Vec<f64> {
        let mut values = match &self.source {
            Source::Column(name) => {
                columns.iter().find(|(column, _)| column == name).map(|(_, values)| values.clone()).unwrap_or_default()
            }
            Source::Expression(expression) => expression.evaluate(columns, samples),
            Source::Value(value) => vec![*value; samples],
        };
        let unit = self.unit.unwrap_or(unit::Unit { factor: 1.0, zero: 0.0, si: "" });
        if self.scale != 1.0 || self.offset != 0.0 || unit.factor != 1.0 || unit.zero != 0.0 {
            for value in &mut values {
                *value = (self.scale * *value + self.offset) * unit.factor + unit.zero;
            }
        }
        if let Some(condition) = &self.missing_if {
            condition.blank(columns, &mut values);
        }
        values
    }
}

/// What to say about a name that is not there: the most similar ones, or all if they are few.
pub fn hint(name: &str, names: &[&str]) -> String {
    let mut ranked: Vec<_> = names.iter().map(|candidate| (distance(name, candidate), *candidate)).collect();
    ranked.sort();
    let near: Vec<_> = ranked.iter().filter(|(d, _)| *d <= 1 + name.chars().count() / 4).take(3).collect();
    match near.as_slice() {
        [] if names.is_empty() => "it has no columns".to_owned(),
        [] => {
            let rest = if names.len() > 12 { format!(" and {} more", names.len() - 12) } else { String::new() };
            format!("there are {}{rest}", names[..names.len().min(12)].join(", "))
        }
        near => {
            let words: Vec<_> = near.iter().map(|(_, candidate)| format!("'{candidate}'")).collect();
            format!("did you mean {}?", words.join(" or "))
        }
    }
}

/// The most similar of some names, if any is similar at all.
pub fn nearest<'a>(name: &str, names: &[&'a str]) -> Option<&'a str> {
    let ranked = names.iter().map(|candidate| (distance(name, candidate), *candidate)).min();
    ranked.filter(|(d, _)| *d <= 1 + name.chars().count() / 4).map(|(_, candidate)| candidate)
}

/// Edits between two names, case ignored; 1 if one contains the other, which is no mere letter.
fn distance(a: &str, b: &str) -> usize {
    let (a, b) = (a.to_lowercase(), b.to_lowercase());
    if a == b {
        return 0;
    }
    if a.len().min(b.len()) > 1 && (a.contains(&b) || b.contains(&a)) {
        return 1;
    }
    let b: Vec<char> = b.chars().take(80).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().take(80).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
