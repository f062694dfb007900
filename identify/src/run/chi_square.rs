//! Quantiles of the chi-square distribution.

/// The value below which a chi-square variable with so many degrees of freedom (at least 1) lies with `probability`.
///
/// Bisection of the distribution's series, Abramowitz and Stegun, Handbook of Mathematical Functions, 26.4.6; relative
/// error below 1e-9 up to some hundred degrees of freedom.
pub fn chi_square_quantile(probability: f64, degrees_of_freedom: usize) -> f64 {
    let n = degrees_of_freedom.max(1) as f64;
    let (mut low, mut high) = (0.0, n + 20.0 * (2.0 * n).sqrt() + 40.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if distribution(middle, n) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// `P(x | n) = (x/2)^(n/2) e^(-x/2) / Gamma(n/2 + 1) sum_r x^r / ((n + 2)(n + 4) ... (n + 2 r))`
fn distribution(x: f64, n: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let (mut term, mut sum, mut r) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum && r < 1e5 {
        term *= x / (n + 2.0 * r);
        sum += term;
        r += 1.0;
    }
    (0.5 * n * (0.5 * x).ln() - 0.5 * x - ln_gamma_half(n + 2.0) + sum.ln()).exp().min(1.0)
}

/// `ln Gamma(n/2)` of a whole number n, by `Gamma(z + 1) = z Gamma(z)`.
fn ln_gamma_half(n: f64) -> f64 {
    let odd = n % 2.0 == 1.0;
    let (mut z, mut sum) = if odd { (0.5, 0.5 * std::f64::consts::PI.ln()) } else { (1.0, 0.0) };
    while z < 0.5 * n {
        sum += z.ln();
        z += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::chi_square_quantile;

    /// Values of a printed table.
    #[test]
    fn quantiles_are_those_of_the_table() {
        for (probability, n, quantile) in [
            (0.025, 1, 0.000982069),
            (0.975, 1, 5.02389),
            (0.025, 3, 0.215795),
            (0.975, 6, 14.4494),
            (0.95, 10, 18.3070),
            (0.975, 100, 129.561),
        ] {
            let found = chi_square_quantile(probability, n);
            assert!((found / quantile - 1.0).abs() < 5e-6, "{probability}, {n}: {found} instead of {quantile}");
        }
    }
}
