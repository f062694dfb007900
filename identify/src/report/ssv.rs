//! The result as a parameter set of the System Structure and Parameterization standard (SSP 1.0).

use crate::result::FitReport;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The XML text; identified parameters only.
pub fn ssv(report: &FitReport) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    text += "<ssv:ParameterSet xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\" \
             xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\" version=\"1.0\" name=\"";
    let _ = writeln!(text, "{}\">\n  <ssv:Parameters>", escaped(&report.vehicle));
    let mut units = BTreeMap::new();
    for (name, parameter) in report.identified() {
        let _ = write!(text, "    <ssv:Parameter name=\"{}\">", escaped(name));
        let _ = write!(text, "<ssv:Real value=\"{:?}\"", parameter.value);
        if let Some(exponents) = base_units(&parameter.unit) {
            let _ = write!(text, " unit=\"{}\"", escaped(&parameter.unit));
            units.insert(parameter.unit.clone(), exponents);
        }
        text += "/></ssv:Parameter>\n";
    }
    text += "  </ssv:Parameters>\n";
    if !units.is_empty() {
        text += "  <ssv:Units>\n";
        for (name, exponents) in units {
            let bases = exponents.iter().filter(|(_, exponent)| *exponent != 0);
            let bases: String = bases.map(|(base, exponent)| format!(" {base}=\"{exponent}\"")).collect();
            let _ = writeln!(text, "    <ssc:Unit name=\"{}\"><ssc:BaseUnit{bases}/></ssc:Unit>", escaped(&name));
        }
        text += "  </ssv:Units>\n";
    }
    text + "</ssv:ParameterSet>\n"
}

type Exponents = [(&'static str, i32); 5];

/// Exponents of the base units in a unit of the FMI spelling, as `N.m.s/rad`.
fn base_units(unit: &str) -> Option<Exponents> {
    let mut sum: Exponents = [("kg", 0), ("m", 0), ("s", 0), ("K", 0), ("rad", 0)];
    let mut parts = unit.split('/');
    let (above, below) = (parts.next()?, parts.next());
    if parts.next().is_some() {
        return None;
    }
    let factors =
        above.split('.').map(|factor| (factor, 1)).chain(below.iter().flat_map(|b| b.split('.').map(|f| (f, -1))));
    for (factor, sign) in factors {
        let factor = factor.trim_matches(['(', ')']);
        let symbol = factor.trim_end_matches(|c: char| c.is_ascii_digit() || c == '-');
        let power: i32 = if symbol.len() < factor.len() { factor[symbol.len()..].parse().ok()? } else { 1 };
        // kg, m, s, K, rad
        let bases = match symbol {
            "1" | "" => [0; 5],
            "kg" => [1, 0, 0, 0, 0],
            "m" => [0, 1, 0, 0, 0],
            "s" => [0, 0, 1, 0, 0],
            "K" => [0, 0, 0, 1, 0],
            "rad" => [0, 0, 0, 0, 1],
            "N" => [1, 1, -2, 0, 0],
            "W" => [1, 2, -3, 0, 0],
            "Pa" => [1, -1, -2, 0, 0],
            _ => return None,
        };
        for (entry, exponent) in sum.iter_mut().zip(bases) {
            entry.1 += sign * power * exponent;
        }
    }
    Some(sum)
}

/// Text for an XML attribute.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_come_apart() {
        let exponents = |unit: &str| base_units(unit).unwrap().map(|(_, exponent)| exponent);
        assert_eq!(exponents("1"), [0, 0, 0, 0, 0]);
        assert_eq!(exponents("m/s2"), [0, 1, -2, 0, 0]);
        assert_eq!(exponents("N.m.s/rad"), [1, 2, -1, 0, -1]);
        assert_eq!(exponents("kg.m2"), [1, 2, 0, 0, 0]);
        assert_eq!(base_units("furlong"), None);
    }
}
