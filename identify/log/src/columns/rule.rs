//! Where the values of one channel come from.

use super::expression::Expression;
use super::select::{Selector, Which};
use super::{texts, unit};
use crate::between::Between;
use crate::series::Series;
use toml::{Table, Value};

/// Keys of a channel's table.
const KEYS: [&str; 13] = [
    "column",
    "expression",
    "value",
    "group",
    "scale",
    "offset",
    "unit",
    "radius",
    "integrate",
    "differentiate",
    "missing_if",
    "between",
    "optional",
];

/// Where the values of one channel come from and what is done to them.
#[derive(Clone, Debug)]
pub(crate) struct Rule {
    pub source: Source,
    pub scale: f64,
    pub offset: f64,
    pub unit: Option<unit::Unit>,
    /// Turns angles into distances, m.
    pub radius: Option<f64>,
    pub calculus: Option<Calculus>,
    pub missing_if: Option<Expression>,
    pub between: Option<Between>,
    pub optional: bool,
}

#[derive(Clone, Debug)]
pub(crate) enum Source {
    /// The first of these that the log has.
    Column(Vec<Candidate>),
    Expression(Expression),
    Value(f64),
}

/// A column, or the formula that its name is if no column is called so.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    pub selector: Selector,
    pub formula: Option<Expression>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Calculus {
    Integrate,
    Differentiate,
}

impl Rule {
    /// A column as it is.
    pub fn plain(selector: Selector) -> Self {
        Self::of(Source::Column(vec![Candidate { selector, formula: None }]))
    }

    fn of(source: Source) -> Self {
        Self {
            source,
            scale: 1.0,
            offset: 0.0,
            unit: None,
            radius: None,
            calculus: None,
            missing_if: None,
            between: None,
            optional: false,
        }
    }

    /// Whether a table is meant for a channel.
    pub fn is_rule(table: &Table) -> bool {
        ["column", "expression", "value"].iter().any(|key| table.contains_key(*key))
    }

    pub fn parse(value: &Value) -> Result<Self, String> {
        let table = match value {
            Value::String(_) | Value::Array(_) => return Ok(Self::of(Source::Column(candidates(value, None)?))),
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
        let flag = |key: &str| match table.get(key) {
            None => Ok(false),
            Some(Value::Boolean(flag)) => Ok(*flag),
            Some(_) => Err(format!("{key} must be true or false")),
        };
        let number = |key: &str| number(table, key);
        let expression = |key: &str| text(key)?.map(Expression::parse).transpose().map_err(|e| format!("{key}: {e}"));
        let group = table.get("group").map(|value| Which::parse("group", value)).transpose()?;
        let column = table.get("column").map(|value| candidates(value, group)).transpose()?;
        let source = match (column, expression("expression")?, number("value")?) {
            (Some(column), None, None) => Source::Column(column),
            (None, Some(expression), None) => Source::Expression(expression),
            (None, None, Some(value)) => Source::Value(value),
            _ => return Err("exactly one of column, expression and value is expected".to_owned()),
        };
        if table.contains_key("group") && !matches!(source, Source::Column(_)) {
            return Err("group goes with a column; in an expression write {group/column}".to_owned());
        }
        let calculus = match (flag("integrate")?, flag("differentiate")?) {
            (false, false) => None,
            (true, false) => Some(Calculus::Integrate),
            (false, true) => Some(Calculus::Differentiate),
            (true, true) => return Err("integrate and differentiate exclude each other".to_owned()),
        };
        let rule = Self {
            source,
            scale: number("scale")?.unwrap_or(1.0),
            offset: number("offset")?.unwrap_or(0.0),
            unit: text("unit")?.map(unit::find).transpose()?,
            radius: number("radius")?,
            calculus,
            missing_if: expression("missing_if")?,
            between: text("between")?.map(Between::parse).transpose()?,
            optional: flag("optional")?,
        };
        if rule.scale == 0.0 {
            return Err("scale = 0 would wipe the channel out; value = 0 is a channel of zeros".to_owned());
        }
        if rule.radius.is_some_and(|radius| radius <= 0.0) {
            return Err("radius must be above 0 m".to_owned());
        }
        if let Some(unit) = rule.unit {
            rule.si_after(unit.si)?;
        }
        Ok(rule)
    }

    /// Whether nothing stands in the rule that makes no sense for times.
    pub fn is_plain_time(&self) -> bool {
        self.radius.is_none() && self.calculus.is_none() && self.between.is_none() && !self.optional
    }

    /// The SI unit after `radius` and calculus of values in the SI unit `si`.
    pub fn si_after(&self, si: &'static str) -> Result<&'static str, String> {
        let through = |table: &[(&'static str, &'static str)], what: &str| {
            let found = table.iter().find(|(from, _)| *from == si).map(|(_, to)| *to);
            found.ok_or_else(|| format!("{what} makes no sense of {si}"))
        };
        let si = match self.radius {
            None => si,
            Some(_) => through(&[("rad", "m"), ("rad/s", "m/s"), ("rad/s2", "m/s2")], "radius")?,
        };
        let rates = [("m", "m/s"), ("m/s", "m/s2"), ("rad", "rad/s"), ("rad/s", "rad/s2")];
        let found = match self.calculus {
            None => return Ok(si),
            Some(Calculus::Differentiate) => rates.iter().find(|(from, _)| *from == si).map(|(_, to)| *to),
            Some(Calculus::Integrate) => rates.iter().find(|(_, to)| *to == si).map(|(from, _)| *from),
        };
        found.ok_or_else(|| format!("integrate and differentiate know m, m/s, m/s2, rad, rad/s and rad/s2, not {si}"))
    }
}

impl Rule {
    /// Applies `radius`, `integrate` and `differentiate` to values in SI.
    pub fn shape(&self, time: &[f64], values: &mut Series) -> Result<(), String> {
        if let Some(radius) = self.radius {
            values.iter_mut().for_each(|value| *value *= radius);
        }
        match self.calculus {
            None => {}
            Some(Calculus::Integrate) => *values = integral(time, values)?.into(),
            Some(Calculus::Differentiate) => *values = derivative(time, values),
        }
        Ok(())
    }
}

/// The integral over time by the trapezoidal rule, 0 at the first sample. Samples that are missing for up to 0.1 s
/// or two periods are bridged by a straight line; their own integral is missing.
fn integral(time: &[f64], values: &[f64]) -> Result<Vec<f64>, String> {
    let longest = f64::max(0.1, 2.0 * crate::between::period(time)) + 1e-9;
    let mut result = vec![f64::NAN; values.len()];
    let mut sum = 0.0;
    let mut last: Option<(f64, f64)> = None;
    for ((time, value), to) in time.iter().zip(values).zip(&mut result).filter(|((_, value), _)| !value.is_nan()) {
        if let Some((before, old)) = last {
            if time - before > longest {
                return Err(format!(
                    "integrate: there is no sample from {before} s to {time} s, and the integral is unknown after that"
                ));
            }
            sum += 0.5 * (old + value) * (time - before);
        }
        *to = sum;
        last = Some((*time, *value));
    }
    Ok(result)
}

/// The derivative over time: of the parabola through a sample and its neighbours, of a line at the ends.
fn derivative(time: &[f64], values: &[f64]) -> Series {
    let slope = |a: usize, b: usize| (values[b] - values[a]) / (time[b] - time[a]);
    let last = values.len().saturating_sub(1);
    let at = |k: usize| match k {
        _ if last == 0 => f64::NAN,
        0 => slope(0, 1),
        k if k == last => slope(k - 1, k),
        k => {
            let (before, after) = (time[k] - time[k - 1], time[k + 1] - time[k]);
            (after * slope(k - 1, k) + before * slope(k, k + 1)) / (before + after)
        }
    };
    (0..values.len()).map(at).collect()
}

/// A finite number of a table.
pub(super) fn number(table: &Table, key: &str) -> Result<Option<f64>, String> {
    match table.get(key) {
        None => Ok(None),
        Some(Value::Float(number)) if number.is_finite() => Ok(Some(*number)),
        Some(Value::Integer(number)) => Ok(Some(*number as f64)),
        Some(other) => Err(format!("{key} = {other} is not a finite number")),
    }
}

/// The columns of a `column` key or of a bare text or list.
fn candidates(value: &Value, group: Option<Which>) -> Result<Vec<Candidate>, String> {
    if matches!(value, Value::Integer(_)) {
        let selector = Selector { group, column: Which::parse("column", value)? };
        return Ok(vec![Candidate { selector, formula: None }]);
    }
    let names = texts("column", value)?;
    if names.is_empty() {
        return Err("the list of columns is empty".to_owned());
    }
    let candidate = |name: String| {
        let formula = if group.is_some() { None } else { Expression::parse(&name).ok() };
        let formula = formula.filter(|formula| formula.names() != [name.as_str()]);
        Candidate { selector: Selector { group: group.clone(), column: Which::Name(name) }, formula }
    };
    Ok(names.into_iter().map(candidate).collect())
}
