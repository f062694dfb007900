//! From the number in a record to the physical one.

use super::Failure;
use super::block::{Block, block, named, text};
use super::bytes::Bytes;
use exmex::{Express, FlatEx};

/// Conversions refer to others at most so deep.
const DEEPEST: usize = 8;

/// A conversion rule (block CC of the ASAM MDF standard, 4.x). Rules that lead from numbers to texts keep the number.
#[derive(Debug)]
pub enum Conversion {
    Identity,
    /// `a + b x`.
    Linear(f64, f64),
    /// `(p0 x^2 + p1 x + p2) / (p3 x^2 + p4 x + p5)`.
    Rational([f64; 6]),
    Formula(Box<FlatEx<f64>>),
    /// Keys and values, by key; linear in between.
    Interpolated(Vec<(f64, f64)>),
    /// Keys and values, by key; the nearest counts, the lower one in the middle.
    Nearest(Vec<(f64, f64)>),
    /// Lower and upper bound with their value, and the value of everything else.
    Ranges(Vec<(f64, f64, f64)>, f64),
    /// Bounds with a rule of their own or, where they have a text, none; and the rule of everything else.
    Partly(Vec<(f64, f64, Option<Conversion>)>, Option<Box<Conversion>>),
}

impl Conversion {
    /// Reads a rule; the error says which kind is not known. `whole`: the raw values are integers.
    pub fn read(file: &Bytes, link: u64, whole: bool, depth: usize) -> Result<Self, Failure> {
        if link == 0 {
            return Ok(Self::Identity);
        }
        if depth > DEEPEST {
            return Err(Failure::damaged("conversions refer to each other in a circle".to_owned()));
        }
        let cc = named(file, link, b"##CC")?;
        let count = usize::from(cc.u16(6)?);
        let value = |index: usize| cc.f64(24 + 8 * index);
        let values = || (0..count).map(value).collect::<Result<Vec<_>, _>>();
        let pairs = || {
            let values = values()?;
            let mut pairs: Vec<_> = values.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            if pairs.is_empty() { Err(Failure::damaged("a conversion table is empty".to_owned())) } else { Ok(pairs) }
        };
        Ok(match cc.u8(0)? {
            0 => Self::Identity,
            1 => Self::Linear(value(0)?, value(1)?),
            2 => {
                let mut p = [0.0; 6];
                for (index, p) in p.iter_mut().enumerate() {
                    *p = value(index)?;
                }
                Self::Rational(p)
            }
            3 => Self::formula(&text(file, cc.link(4))?)?,
            4 => Self::Interpolated(pairs()?),
            5 => Self::Nearest(pairs()?),
            6 => {
                let values = values()?;
                let ranges = values.chunks_exact(3).map(|range| (range[0], above(range[1], whole), range[2]));
                let other = values.chunks_exact(3).remainder().first().copied().unwrap_or(f64::NAN);
                Self::Ranges(ranges.collect(), other)
            }
            7 => {
                let bounds = values()?.into_iter().map(|value| (value, value.next_up())).collect();
                Self::partly(file, &cc, bounds, whole, depth)?
            }
            8 => {
                let values = values()?;
                let bounds = values.chunks_exact(2).map(|range| (range[0], above(range[1], whole))).collect();
                Self::partly(file, &cc, bounds, whole, depth)?
            }
            11 => Self::Identity,
            kind => return Err(Failure::foreign(format!("values with a conversion of type {kind}"))),
        })
    }

    /// Bounds whose references are texts or rules of their own. If all are texts, the numbers stay.
    fn partly(file: &Bytes, cc: &Block, bounds: Vec<(f64, f64)>, whole: bool, depth: usize) -> Result<Self, Failure> {
        let rule = |index: usize| -> Result<Option<Self>, Failure> {
            let link = cc.link(4 + index);
            let is_rule = link != 0 && block(file, link)?.name == *b"##CC";
            if is_rule { Self::read(file, link, whole, depth + 1).map(Some) } else { Ok(None) }
        };
        let mut parts = Vec::with_capacity(bounds.len());
        for (index, (from, to)) in bounds.into_iter().enumerate() {
            parts.push((from, to, rule(index)?));
        }
        let other = rule(parts.len())?;
        if other.is_none() && parts.iter().all(|(.., rule)| rule.is_none()) {
            return Ok(Self::Identity);
        }
        Ok(Self::Partly(parts, other.map(Box::new)))
    }

    /// A formula over `X`.
    fn formula(text: &str) -> Result<Self, Failure> {
        let foreign = || Failure::foreign(format!("values with the formula '{}'", text.escape_debug()));
        if text.len() > 1000 {
            return Err(foreign());
        }
        let formula = FlatEx::parse(text).map_err(|_| foreign())?;
        let known = matches!(formula.var_names(), [])
            || matches!(formula.var_names(), [x] if matches!(x.as_str(), "X" | "X1" | "x" | "x1"));
        if known { Ok(Self::Formula(Box::new(formula))) } else { Err(foreign()) }
    }

    /// The physical value of a raw one; NaN where it is a text among numbers.
    pub fn apply(&self, x: f64) -> f64 {
        match self {
            Self::Identity => x,
            Self::Linear(a, b) => a + b * x,
            Self::Rational(p) => (p[0] * x * x + p[1] * x + p[2]) / (p[3] * x * x + p[4] * x + p[5]),
            Self::Formula(formula) => {
                let arguments = [x];
                formula.eval(&arguments[..formula.var_names().len()]).unwrap_or(f64::NAN)
            }
            Self::Interpolated(pairs) => interpolate(pairs, x),
            Self::Nearest(pairs) => {
                let next = pairs.partition_point(|(key, _)| *key < x).min(pairs.len() - 1);
                let before = next.saturating_sub(1);
                let lower = x - pairs[before].0 <= pairs[next].0 - x || pairs[next].0 == pairs[before].0;
                if lower { pairs[before].1 } else { pairs[next].1 }
            }
            Self::Ranges(ranges, other) => {
                ranges.iter().find(|(from, to, _)| (*from..*to).contains(&x)).map_or(*other, |(.., value)| *value)
            }
            Self::Partly(parts, other) => match parts.iter().find(|(from, to, _)| (*from..*to).contains(&x)) {
                Some((.., rule)) => rule.as_ref().map_or(f64::NAN, |rule| rule.apply(x)),
                None => other.as_ref().map_or(f64::NAN, |rule| rule.apply(x)),
            },
        }
    }
}

/// The bound that a value must stay below: ranges of integers include their upper end, those of floats do not.
fn above(bound: f64, whole: bool) -> f64 {
    if whole { bound.next_up() } else { bound }
}

fn interpolate(pairs: &[(f64, f64)], x: f64) -> f64 {
    let next = pairs.partition_point(|(key, _)| *key < x);
    match (next.checked_sub(1).map(|before| pairs[before]), pairs.get(next).copied()) {
        _ if x.is_nan() => x,
        (None, Some((_, value))) | (Some((_, value)), None) => value,
        (Some((k0, a)), Some((k1, b))) => a + (x - k0) / (k1 - k0) * (b - a),
        (None, None) => f64::NAN,
    }
}
