//! The best settings within limits: a grid, then golden sections, one setting after the other.

use crate::progress::Interrupted;

/// Values of the settings, and what they are worth: the less, the better.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    pub values: Vec<f64>,
    pub score: f64,
}

/// What values of the settings are worth; nothing if they cannot be tried.
pub type Worth<'a> = dyn Fn(&[f64]) -> Result<Option<f64>, Interrupted> + 'a;

/// Evaluations per setting within the bracket that the grid leaves.
const SECTIONS: usize = 4;

/// The best point that was found; nothing if no point has a value. A function with several valleys may have a better one.
pub fn search(limits: &[(String, f64, f64)], value: &Worth) -> Result<Option<Point>, Interrupted> {
    // Ends and middles, together.
    let mut best: Option<Point> = None;
    let take = |best: &mut Option<Point>, values: Vec<f64>| -> Result<f64, Interrupted> {
        let Some(score) = value(&values)? else { return Ok(f64::INFINITY) };
        if best.as_ref().is_none_or(|known| score < known.score) {
            *best = Some(Point { values, score });
        }
        Ok(score)
    };
    let at = |index: usize, step: usize| limits[index].1 + 0.5 * step as f64 * (limits[index].2 - limits[index].1);
    for code in 0..3usize.pow(limits.len() as u32) {
        let values = (0..limits.len()).map(|index| at(index, code / 3usize.pow(index as u32) % 3)).collect();
        take(&mut best, values)?;
    }
    for (index, (_, low, high)) in limits.iter().enumerate() {
        let Some(start) = best.clone() else { return Ok(None) };
        let half = 0.5 * (high - low);
        let (mut a, mut b) = ((start.values[index] - half).max(*low), (start.values[index] + half).min(*high));
        let mut with = |x: f64| {
            let mut values = start.values.clone();
            values[index] = x;
            take(&mut best, values)
        };
        let ratio = 0.5 * (5f64.sqrt() - 1.0);
        let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
        let (mut at_c, mut at_d) = (with(c)?, with(d)?);
        for _ in 2..SECTIONS {
            if at_c < at_d {
                (b, d, at_d) = (d, c, at_c);
                c = b - ratio * (b - a);
                at_c = with(c)?;
            } else {
                (a, c, at_c) = (c, d, at_d);
                d = a + ratio * (b - a);
                at_d = with(d)?;
            }
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bottom_of_a_valley_is_found_within_the_limits() {
        let limits = [("x".to_owned(), 0.0, 4.0), ("y".to_owned(), -1.0, 1.0)];
        let bowl = |v: &[f64]| Ok(Some((v[0] - 1.3).powi(2) + (v[1] - 5.0).powi(2)));
        let best = search(&limits, &bowl).unwrap().unwrap();
        assert!((best.values[0] - 1.3).abs() < 0.5 && best.values[1] == 1.0, "{best:?}");
        assert_eq!(search(&limits, &|_| Ok(None)), Ok(None));
        assert_eq!(search(&[], &|_| Ok(Some(2.0))), Ok(Some(Point { values: vec![], score: 2.0 })));
    }
}
