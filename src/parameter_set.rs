//! Parameter sets of the System Structure and Parameterization standard (SSP 1.0, `.ssv`), and how text and numbers
//! are spelt in XML.

use crate::unit;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The value of one entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// A finite number in this unit.
    Real(f64, &'a str),
    /// A whole number.
    Integer(i32),
    /// A truth value.
    Boolean(bool),
}

/// One parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry<'a> {
    /// Its name.
    pub name: &'a str,
    /// What it is; may be empty.
    pub description: &'a str,
    /// Its value.
    pub value: Value<'a>,
}

/// The text of a parameter set. Every unit made of known symbols is defined by its base units below the parameters.
pub fn write<'a>(name: &str, entries: impl IntoIterator<Item = Entry<'a>>) -> String {
    let mut text = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="{}">
  <ssv:Parameters>
"#,
        escape(name)
    );
    let mut units = BTreeMap::new();
    for entry in entries {
        let _ = write!(text, r#"    <ssv:Parameter name="{}""#, escape(entry.name));
        if !entry.description.is_empty() {
            let _ = write!(text, r#" description="{}""#, escape(entry.description));
        }
        let value = match entry.value {
            Value::Real(value, unit) => match unit::parse(unit) {
                Some(base) => {
                    units.insert(unit, base);
                    format!(r#"<ssv:Real value="{}" unit="{}"/>"#, number(value), escape(unit))
                }
                None => format!(r#"<ssv:Real value="{}"/>"#, number(value)),
            },
            Value::Integer(value) => format!(r#"<ssv:Integer value="{value}"/>"#),
            Value::Boolean(value) => format!(r#"<ssv:Boolean value="{value}"/>"#),
        };
        let _ = writeln!(text, ">{value}</ssv:Parameter>");
    }
    text.push_str("  </ssv:Parameters>\n");
    if !units.is_empty() {
        text.push_str("  <ssv:Units>\n");
        for (name, unit) in units {
            let _ = writeln!(text, r#"    <ssc:Unit name="{}">{}</ssc:Unit>"#, escape(name), base_unit("ssc:", unit));
        }
        text.push_str("  </ssv:Units>\n");
    }
    text + "</ssv:ParameterSet>\n"
}

/// A unit as the element `BaseUnit` of FMI (no prefix) or of SSP (`ssc:`).
pub fn base_unit(prefix: &str, unit: unit::Unit) -> String {
    let mut text = format!("<{prefix}BaseUnit");
    for (base, exponent) in unit::BASE.iter().zip(unit.exponents) {
        if exponent != 0 {
            let _ = write!(text, r#" {base}="{exponent}""#);
        }
    }
    if unit.factor != 1.0 {
        let _ = write!(text, r#" factor="{}""#, number(unit.factor));
    }
    text + "/>"
}

/// A number that reads back as the same bits, in the spelling of `xs:double`.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        "NaN".to_owned()
    } else if value.is_infinite() {
        if value > 0.0 { "INF" } else { "-INF" }.to_owned()
    } else if value.fract() == 0.0 && value.abs() < 1e15 {
        format!("{value:.0}")
    } else {
        format!("{value:?}")
    }
}

/// Text as it may stand in an attribute or between tags.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            '\r' | '\0' => {}
            '\t' => out.push(' '),
            other => out.push(other),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back_as_the_same_bits() {
        for value in [0.1, 1e-300, -7.0, 1.0 / 3.0, 6.02e23, 1e15, f64::MAX, f64::MIN_POSITIVE, -0.0] {
            assert_eq!(number(value).parse::<f64>().map(f64::to_bits), Ok(value.to_bits()));
        }
        assert_eq!([f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(number), ["NaN", "INF", "-INF"]);
    }

    #[test]
    fn a_set_defines_every_unit_it_uses_once() {
        let entry = |name, value| Entry { name, description: "", value };
        let text = write(
            "a & b",
            [
                entry("x", Value::Real(1.5, "N.m.s/rad")),
                entry("y", Value::Real(2.0, "N.m.s/rad")),
                entry("z", Value::Real(2.0, "furlong")),
                entry("k", Value::Integer(-3)),
                entry("b", Value::Boolean(true)),
            ],
        );
        assert_eq!(text.matches("<ssc:Unit ").count(), 1);
        assert!(text.contains(r#"<ssc:Unit name="N.m.s/rad"><ssc:BaseUnit kg="1" m="2" s="-1" rad="-1"/></ssc:Unit>"#));
        assert!(text.contains(r#"<ssv:Real value="2"/>"#), "a unit of unknown symbols is left out: {text}");
        assert!(text.contains(r#"name="a &amp; b""#) && text.contains(r#"<ssv:Integer value="-3"/>"#));
    }
}
