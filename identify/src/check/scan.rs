//! Passes over all samples of a channel, in lanes that a processor takes side by side.

/// Samples that are taken side by side.
const LANES: usize = 8;

/// What the finite values of a channel extend over.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    pub count: usize,
    pub low: f64,
    pub high: f64,
}

/// Count, smallest and largest of the finite values; infinite bounds the wrong way round if there are none.
pub fn extent(values: &[f64]) -> Extent {
    let (mut count, mut low, mut high) = ([0_u64; LANES], [f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut last = [f64::NAN; LANES];
    last[..rest.len()].copy_from_slice(rest);
    for chunk in chunks.iter().chain([&last]) {
        for lane in 0..LANES {
            let (value, finite) = (chunk[lane], chunk[lane].is_finite());
            count[lane] += u64::from(finite);
            low[lane] = if finite && value < low[lane] { value } else { low[lane] };
            high[lane] = if finite && value > high[lane] { value } else { high[lane] };
        }
    }
    Extent {
        count: count.iter().sum::<u64>() as usize,
        low: low.into_iter().fold(f64::INFINITY, f64::min),
        high: high.into_iter().fold(f64::NEG_INFINITY, f64::max),
    }
}

/// The smallest change from one value to the next that is larger than `least`, infinite if there is none, and how many
/// neighbours are equal.
pub fn smallest_change(values: &[f64], least: f64) -> (f64, usize) {
    let (mut smallest, mut equal) = ([f64::INFINITY; LANES], [0_u64; LANES]);
    let (befores, before) = values[..values.len() - 1].as_chunks::<LANES>();
    let (afters, after) = values[1..].as_chunks::<LANES>();
    for (before, after) in befores.iter().zip(afters) {
        for lane in 0..LANES {
            let change = (after[lane] - before[lane]).abs();
            equal[lane] += u64::from(change == 0.0);
            smallest[lane] = if change > least && change < smallest[lane] { change } else { smallest[lane] };
        }
    }
    let rest = before.iter().zip(after).map(|(before, after)| (after - before).abs());
    let smallest = rest.clone().filter(|change| *change > least).chain(smallest).fold(f64::INFINITY, f64::min);
    (smallest, equal.iter().sum::<u64>() as usize + rest.filter(|change| *change == 0.0).count())
}

/// Sum of the squared changes over so many samples, and their number; those from and to missing values are left out.
pub fn squared_changes(values: &[f64], samples: usize) -> (f64, usize) {
    let (mut sums, mut counts) = ([0.0; LANES], [0_u64; LANES]);
    let (befores, before) = values[..values.len() - samples].as_chunks::<LANES>();
    let (afters, after) = values[samples..].as_chunks::<LANES>();
    for (before, after) in befores.iter().zip(afters) {
        for lane in 0..LANES {
            let change = after[lane] - before[lane];
            let finite = change.is_finite();
            sums[lane] += if finite { change * change } else { 0.0 };
            counts[lane] += u64::from(finite);
        }
    }
    let rest = before.iter().zip(after).map(|(before, after)| after - before).filter(|change| change.is_finite());
    let (sum, count) = rest.fold((0.0, 0), |(sum, count), change| (sum + change * change, count + 1));
    (sums.iter().sum::<f64>() + sum, counts.iter().sum::<u64>() as usize + count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Channels of all lengths with repeated, missing and infinite values.
    fn channels() -> impl Iterator<Item = Vec<f64>> {
        (1..90).map(|length| {
            let value = |k: usize| match (length * 31 + k * k * 7) % 23 {
                0 => f64::NAN,
                1 => f64::INFINITY,
                remainder if length % 3 == 0 => (remainder / 6) as f64,
                remainder => ((remainder + k) as f64).sin(),
            };
            (0..length).map(value).collect()
        })
    }

    #[test]
    fn lanes_see_what_one_value_after_the_other_shows() {
        for values in channels() {
            let finite = || values.iter().copied().filter(|value| value.is_finite());
            let all = extent(&values);
            assert_eq!(all.count, finite().count());
            assert_eq!(all.low, finite().fold(f64::INFINITY, f64::min));
            assert_eq!(all.high, finite().fold(f64::NEG_INFINITY, f64::max));
            for samples in 0..values.len() {
                let changes = values.iter().zip(&values[samples..]).map(|(a, b)| b - a);
                let changes: Vec<f64> = changes.filter(|change| change.is_finite()).collect();
                let (sum, count) = squared_changes(&values, samples);
                assert_eq!(count, changes.len());
                assert!((sum - changes.iter().map(|change| change * change).sum::<f64>()).abs() <= 1e-12 * sum);
            }
            let whole: Vec<f64> = finite().collect();
            for least in [0.0, 0.1, 1.5].into_iter().filter(|_| !whole.is_empty()) {
                let changes = || whole.windows(2).map(|pair| (pair[1] - pair[0]).abs());
                let smallest = changes().filter(|change| *change > least).fold(f64::INFINITY, f64::min);
                let equal = changes().filter(|change| *change == 0.0).count();
                assert_eq!(smallest_change(&whole, least), (smallest, equal));
            }
        }
    }
}
