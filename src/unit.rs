//! Units in the FMI spelling (`N.m`, `m/s2`, `(rad/s)2`) as SI base units: what every file that states a unit
//! (`modelDescription.xml`, `.ssv`) says about it.

/// The SI base units of the `BaseUnit` of FMI and SSP, in the order of [`Unit::exponents`].
pub const BASE: [&str; 8] = ["kg", "m", "s", "A", "K", "mol", "cd", "rad"];

/// A unit: `factor` times a product of powers of the base units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Exponents of [`BASE`].
    pub exponents: [i32; 8],
    /// What one of it is in base units.
    pub factor: f64,
}

const NONE: Unit = Unit { exponents: [0; 8], factor: 1.0 };

#[rustfmt::skip]
const SYMBOLS: [(&str, [i32; 8], f64); 18] = [
    ("kg",  [1,  0,  0,  0, 0, 0, 0, 0], 1.0),
    ("g",   [1,  0,  0,  0, 0, 0, 0, 0], 1e-3),
    ("m",   [0,  1,  0,  0, 0, 0, 0, 0], 1.0),
    ("km",  [0,  1,  0,  0, 0, 0, 0, 0], 1e3),
    ("s",   [0,  0,  1,  0, 0, 0, 0, 0], 1.0),
    ("h",   [0,  0,  1,  0, 0, 0, 0, 0], 3600.0),
    ("A",   [0,  0,  0,  1, 0, 0, 0, 0], 1.0),
    ("K",   [0,  0,  0,  0, 1, 0, 0, 0], 1.0),
    ("mol", [0,  0,  0,  0, 0, 1, 0, 0], 1.0),
    ("cd",  [0,  0,  0,  0, 0, 0, 1, 0], 1.0),
    ("rad", [0,  0,  0,  0, 0, 0, 0, 1], 1.0),
    ("deg", [0,  0,  0,  0, 0, 0, 0, 1], std::f64::consts::PI / 180.0),
    ("Hz",  [0,  0, -1,  0, 0, 0, 0, 0], 1.0),
    ("N",   [1,  1, -2,  0, 0, 0, 0, 0], 1.0),
    ("J",   [1,  2, -2,  0, 0, 0, 0, 0], 1.0),
    ("W",   [1,  2, -3,  0, 0, 0, 0, 0], 1.0),
    ("Pa",  [1, -1, -2,  0, 0, 0, 0, 0], 1.0),
    ("V",   [1,  2, -3, -1, 0, 0, 0, 0], 1.0),
];

/// The unit people like to see, with the factor from the SI unit to it.
pub fn display(unit: &str) -> Option<(&'static str, f64)> {
    const DEGREES: f64 = 180.0 / std::f64::consts::PI;
    match unit {
        "rad" => Some(("deg", DEGREES)),
        "rad/s" => Some(("deg/s", DEGREES)),
        _ => None,
    }
}

/// Reads a product of powers. `.` multiplies, `/` divides by the one factor after it, a number after
/// a factor is its power. `None` for what is not built of known symbols with whole powers.
///
/// ```
/// use wheelstate::unit;
///
/// assert_eq!(unit::parse("N.m.s/rad"), unit::parse("J.s/rad"));
/// assert!(unit::parse("furlong").is_none());
/// ```
pub fn parse(text: &str) -> Option<Unit> {
    let (unit, rest) = product(text)?;
    rest.is_empty().then_some(unit)
}

fn product(text: &str) -> Option<(Unit, &str)> {
    let (mut unit, mut rest) = factor(text)?;
    loop {
        let sign = match rest.chars().next() {
            Some('.') => 1,
            Some('/') => -1,
            _ => return Some((unit, rest)),
        };
        let (next, after) = factor(&rest[1..])?;
        unit = times(unit, next, sign);
        rest = after;
    }
}

fn factor(text: &str) -> Option<(Unit, &str)> {
    let (unit, rest) = if let Some(inner) = text.strip_prefix('(') {
        let (unit, rest) = product(inner)?;
        (unit, rest.strip_prefix(')')?)
    } else if let Some(rest) = text.strip_prefix('1') {
        return Some((NONE, rest));
    } else {
        let end = text.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(text.len());
        let (symbol, rest) = text.split_at(end);
        let (_, exponents, factor) = SYMBOLS.iter().find(|(name, ..)| *name == symbol)?;
        (Unit { exponents: *exponents, factor: *factor }, rest)
    };
    let signed = usize::from(rest.starts_with('-'));
    let end = rest[signed..].find(|c: char| !c.is_ascii_digit()).map_or(rest.len(), |i| i + signed);
    if end == 0 {
        return Some((unit, rest));
    }
    let power: i32 = rest[..end].parse().ok()?;
    Some((times(NONE, unit, power), &rest[end..]))
}

fn times(unit: Unit, other: Unit, power: i32) -> Unit {
    let mut exponents = unit.exponents;
    for (sum, exponent) in exponents.iter_mut().zip(other.exponents) {
        *sum += power * exponent;
    }
    Unit { exponents, factor: unit.factor * other.factor.powi(power) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exponents(text: &str) -> Option<[i32; 8]> {
        parse(text).map(|unit| unit.exponents)
    }

    #[test]
    fn products_and_powers_are_read() {
        assert_eq!(exponents("1"), Some([0; 8]));
        assert_eq!(exponents("kg"), Some([1, 0, 0, 0, 0, 0, 0, 0]));
        assert_eq!(exponents("m/s2"), Some([0, 1, -2, 0, 0, 0, 0, 0]));
        assert_eq!(exponents("N.m.s/rad"), Some([1, 2, -1, 0, 0, 0, 0, -1]));
        assert_eq!(exponents("(rad/s)2"), Some([0, 0, -2, 0, 0, 0, 0, 2]));
        assert_eq!(exponents("1/s"), Some([0, 0, -1, 0, 0, 0, 0, 0]));
        assert_eq!(exponents("J/(kg.K)"), Some([0, 2, -2, 0, -1, 0, 0, 0]));
        assert_eq!(exponents("s-1"), Some([0, 0, -1, 0, 0, 0, 0, 0]));
        assert_eq!(parse("km/h").map(|unit| unit.factor), Some(1e3 / 3600.0));
    }

    #[test]
    fn what_is_no_unit_is_none() {
        for text in ["", "furlong", "m/", "m..s", "(m", "m/s/Hz0.5", "m s"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
