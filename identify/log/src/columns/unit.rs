//! Units that logs are recorded in, and their way to SI.

/// A unit: `SI value = factor * value + zero`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    pub factor: f64,
    pub zero: f64,
    /// The SI unit it turns into, in the FMI spelling.
    pub si: &'static str,
}

impl Unit {
    /// Whether values in it are values in SI.
    pub fn is_si(&self) -> bool {
        self.factor == 1.0 && self.zero == 0.0
    }
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const RPM: f64 = std::f64::consts::PI / 30.0;
/// Standard gravity, m/s2.
const GRAVITY: f64 = 9.80665;

/// Edits between two spellings, case ignored.
fn distance(a: &str, b: &str) -> usize {
    let fold = |text: &str| text.to_lowercase().replace([' ', '.', '*', '·'], "").chars().collect::<Vec<_>>();
    let (a, b) = (fold(a), fold(b));
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().take(40).enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// All spellings, the factor to SI and the SI unit; grouped by quantity.
const UNITS: &[(&[&str], f64, f64, &str)] = &[
    (&["1", "-"], 1.0, 0.0, "1"),
    (&["%", "percent"], 0.01, 0.0, "1"),
    (&["s", "sec"], 1.0, 0.0, "s"),
    (&["ms"], 1e-3, 0.0, "s"),
    (&["us", "µs", "μs"], 1e-6, 0.0, "s"),
    (&["ns"], 1e-9, 0.0, "s"),
    (&["min"], 60.0, 0.0, "s"),
    (&["h"], 3600.0, 0.0, "s"),
    (&["m"], 1.0, 0.0, "m"),
    (&["mm"], 1e-3, 0.0, "m"),
    (&["cm"], 1e-2, 0.0, "m"),
    (&["km"], 1e3, 0.0, "m"),
    (&["in", "inch"], 0.0254, 0.0, "m"),
    (&["ft"], 0.3048, 0.0, "m"),
    (&["m/s"], 1.0, 0.0, "m/s"),
    (&["mm/s"], 1e-3, 0.0, "m/s"),
    (&["cm/s"], 1e-2, 0.0, "m/s"),
    (&["km/h", "kph", "kmh"], 1.0 / 3.6, 0.0, "m/s"),
    (&["mph"], 0.44704, 0.0, "m/s"),
    (&["kn", "knot"], 1852.0 / 3600.0, 0.0, "m/s"),
    (&["ft/s"], 0.3048, 0.0, "m/s"),
    (&["m/s2", "m/s^2", "m/s²", "m/s/s", "m/s**2"], 1.0, 0.0, "m/s2"),
    (&["g"], GRAVITY, 0.0, "m/s2"),
    (&["mg"], 1e-3 * GRAVITY, 0.0, "m/s2"),
    (&["rad"], 1.0, 0.0, "rad"),
    (&["mrad"], 1e-3, 0.0, "rad"),
    (&["deg", "°"], DEGREE, 0.0, "rad"),
    (&["rev"], std::f64::consts::TAU, 0.0, "rad"),
    (&["rad/s"], 1.0, 0.0, "rad/s"),
    (&["mrad/s"], 1e-3, 0.0, "rad/s"),
    (&["deg/s", "°/s", "dps"], DEGREE, 0.0, "rad/s"),
    (&["rpm", "1/min", "rev/min", "r/min", "U/min"], RPM, 0.0, "rad/s"),
    (&["rev/s"], std::f64::consts::TAU, 0.0, "rad/s"),
    (&["rad/s2", "rad/s^2", "rad/s²", "rad/s/s"], 1.0, 0.0, "rad/s2"),
    (&["deg/s2", "deg/s^2", "°/s²", "°/s^2"], DEGREE, 0.0, "rad/s2"),
    (&["N"], 1.0, 0.0, "N"),
    (&["kN"], 1e3, 0.0, "N"),
    (&["kgf"], GRAVITY, 0.0, "N"),
    (&["lbf"], 4.448_221_615_260_5, 0.0, "N"),
    (&["N.m", "Nm", "N*m", "N m", "N·m"], 1.0, 0.0, "N.m"),
    (&["mNm", "mN.m"], 1e-3, 0.0, "N.m"),
    (&["kNm", "kN.m"], 1e3, 0.0, "N.m"),
    (&["lbf.ft", "lb.ft", "ft.lbf"], 1.355_817_948_331_4, 0.0, "N.m"),
    (&["kg"], 1.0, 0.0, "kg"),
    (&["t"], 1e3, 0.0, "kg"),
    (&["lb"], 0.453_592_37, 0.0, "kg"),
    (&["K"], 1.0, 0.0, "K"),
    (&["degC", "°C"], 1.0, 273.15, "K"),
    (&["degF", "°F"], 5.0 / 9.0, 273.15 - 32.0 * 5.0 / 9.0, "K"),
    (&["W"], 1.0, 0.0, "W"),
    (&["kW"], 1e3, 0.0, "W"),
    (&["V"], 1.0, 0.0, "V"),
    (&["mV"], 1e-3, 0.0, "V"),
    (&["A"], 1.0, 0.0, "A"),
    (&["mA"], 1e-3, 0.0, "A"),
    (&["Pa"], 1.0, 0.0, "Pa"),
    (&["kPa"], 1e3, 0.0, "Pa"),
    (&["bar"], 1e5, 0.0, "Pa"),
];

/// The unit of this spelling; the error names the nearest known ones, or all.
pub fn find(text: &str) -> Result<Unit, String> {
    let found = UNITS.iter().find(|(spellings, ..)| spellings.contains(&text.trim()));
    let (_, factor, zero, si) = found.ok_or_else(|| {
        let text = text.trim();
        let mut ranked: Vec<_> =
            UNITS.iter().flat_map(|(spellings, ..)| *spellings).map(|known| (distance(text, known), *known)).collect();
        ranked.sort();
        let near = ranked.iter().take_while(|(d, _)| *d <= 1 && text.len() > 1 || *d == 0).take(4);
        let near: Vec<_> = near.map(|(_, known)| *known).collect();
        let text: String = text.chars().take(40).flat_map(char::escape_debug).collect();
        match near.as_slice() {
            [] => {
                let known: Vec<_> = UNITS.iter().map(|(spellings, ..)| spellings[0]).collect();
                format!("unknown unit '{text}'; known are {}", known.join(", "))
            }
            near => format!("unknown unit '{text}'; the nearest known ones are {}", near.join(", ")),
        }
    })?;
    Ok(Unit { factor: *factor, zero: *zero, si })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_is_unique_and_known() {
        let spellings: Vec<_> = UNITS.iter().flat_map(|(spellings, ..)| spellings.iter()).collect();
        for (index, spelling) in spellings.iter().enumerate() {
            assert!(!spellings[..index].contains(spelling), "{spelling} stands twice");
            assert!(find(spelling).is_ok());
        }
    }

    #[test]
    fn quantities_come_out_in_si() {
        for (text, value, expected) in [
            ("km/h", 36.0, 10.0),
            ("mph", 60.0, 26.8224),
            ("deg", 180.0, std::f64::consts::PI),
            ("rpm", 60.0, std::f64::consts::TAU),
            ("degC", 25.0, 298.15),
            ("degF", 212.0, 373.15),
            ("g", 1.0, 9.80665),
            ("ms", 10.0, 0.01),
            ("kN", 2.5, 2500.0),
        ] {
            let unit = find(text).unwrap();
            let si = unit.factor * value + unit.zero;
            assert!((si - expected).abs() < 1e-12 * expected.abs(), "{value} {text} = {si} {}", unit.si);
        }
    }

    #[test]
    fn an_unknown_unit_lists_the_known_ones() {
        let error = find("furlong").unwrap_err();
        assert!(error.contains("'furlong'") && error.contains("km/h") && error.contains("N.m"), "{error}");
    }
}
