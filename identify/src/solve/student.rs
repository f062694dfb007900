//! Quantiles for few degrees of freedom.

/// The 97.5 % quantile of Student's distribution over that of the normal one, 1.96.
///
/// Cornish and Fisher's expansion from 3 degrees of freedom on (within 1 %), exact at 1 and 2, straight lines between.
pub fn student(degrees_of_freedom: f64) -> f64 {
    const Z: f64 = 1.959964;
    let expanded = |v: f64| {
        let z = Z;
        z + (z.powi(3) + z) / (4.0 * v)
            + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * v * v)
            + (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / (384.0 * v.powi(3))
    };
    let between = |a: f64, b: f64, share: f64| a + share * (b - a);
    let quantile = match degrees_of_freedom {
        v if v.is_nan() || v <= 1.0 => 12.706,
        v if v < 2.0 => between(12.706, 4.303, v - 1.0),
        v if v < 3.0 => between(4.303, 3.182, v - 2.0),
        v if v < 1e6 => expanded(v),
        _ => Z,
    };
    quantile / Z
}

#[cfg(test)]
mod tests {
    use super::student;

    /// Values of a printed table.
    #[test]
    fn quantiles_are_those_of_the_table() {
        for (v, quantile) in [(1.0, 12.706), (2.0, 4.303), (3.0, 3.182), (5.0, 2.571), (10.0, 2.228), (60.0, 2.000)] {
            let found = 1.959964 * student(v);
            assert!((found / quantile - 1.0).abs() < 0.01, "{v}: {found} instead of {quantile}");
        }
    }
}
