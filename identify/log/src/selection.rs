//! The median of many numbers, without a copy of them.

/// Numbers of which a copy costs nothing.
const FEW: usize = 4096;
/// Numbers that are looked at first, spread over all of them, and how far from the median of these that of all may be, in
/// numbers: five standard errors, half the square root of their count each.
const SAMPLE: usize = 2048;
const REACH: usize = 113;

/// Numbers that are worked out together.
const CHUNK: usize = 256;

/// The median of the finite ones of `count` numbers, and how many these are: of `n` the one at place `n / 2` in increasing
/// order. `fill` writes the numbers from one on. A sample tells two bounds between which the median lies all but certainly,
/// and only what lies between them is sorted (Floyd and Rivest, "Expected time bounds for selection", Communications of the
/// ACM 18 (1975), 165-172).
///
/// ```
/// let square = |k: usize| (k as f64 - 5000.0).powi(2);
/// let squares = |first: usize, to: &mut [f64]| to.iter_mut().enumerate().for_each(|(k, to)| *to = square(first + k));
/// assert_eq!(wheelstate_log::median(10_001, squares), Some((2500.0 * 2500.0, 10_001)));
/// assert_eq!(wheelstate_log::median(3, |_, to| to.fill(f64::NAN)), None);
/// ```
pub fn median(count: usize, fill: impl Fn(usize, &mut [f64])) -> Option<(f64, usize)> {
    if count == 0 {
        return None;
    }
    let of_all = || {
        let mut all = vec![0.0; count];
        fill(0, &mut all);
        all.retain(|value| value.is_finite());
        let finite = all.len();
        Some((at(&mut all, finite / 2)?, finite))
    };
    if count <= FEW {
        return of_all();
    }
    let mut sample = vec![0.0; SAMPLE];
    sample.iter_mut().enumerate().for_each(|(k, value)| fill(k * (count / SAMPLE), std::slice::from_mut(value)));
    sample.retain(|value| value.is_finite());
    sample.sort_unstable_by(f64::total_cmp);
    let middle = sample.len() / 2;
    if middle <= REACH {
        return of_all();
    }
    // What equals one of these three is only counted: the steps of a clock have few different values.
    let pivots = [sample[middle - REACH], sample[middle], sample[middle + REACH - 1]];
    let [low, guess, high] = pivots;
    let (mut finite, mut below, mut equal, mut near) = (0, 0, [0; 3], Vec::new());
    let (mut chunk, mut kept) = ([0.0; CHUNK], [0.0; CHUNK]);
    for first in (0..count).step_by(CHUNK) {
        let chunk = &mut chunk[..CHUNK.min(count - first)];
        fill(first, chunk);
        finite += chunk.iter().filter(|value| value.is_finite()).count();
        below += chunk.iter().filter(|value| **value < low && **value >= f64::MIN).count();
        for (equal, pivot) in equal.iter_mut().zip(pivots) {
            *equal += chunk.iter().filter(|value| **value == pivot).count();
        }
        let mut length = 0;
        for value in chunk.iter() {
            kept[length] = *value;
            length += usize::from(low < *value && *value < high && *value != guess);
        }
        near.extend_from_slice(&kept[..length]);
    }
    let place = (finite / 2).checked_sub(below);
    let found = place.and_then(|place| among(&mut near, place, pivots, equal));
    found.map_or_else(of_all, |median| Some((median, finite)))
}

/// The number at a place among three that occur so often, and others between the first and the last of them.
fn among(
    near: &mut [f64],
    place: usize,
    [low, guess, high]: [f64; 3],
    [lows, guesses, highs]: [usize; 3],
) -> Option<f64> {
    let less = near.iter().filter(|value| **value < guess).count();
    let lows = if low < guess { lows } else { 0 };
    let highs = if guess < high { highs } else { 0 };
    let Some(place) = place.checked_sub(lows) else { return Some(low) };
    if place < less {
        return at(near, place);
    }
    let Some(place) = place.checked_sub(guesses).filter(|place| *place >= less) else { return Some(guess) };
    if place < near.len() {
        return at(near, place);
    }
    (place < near.len() + highs).then_some(high)
}

/// The number at a place in increasing order.
fn at(numbers: &mut [f64], place: usize) -> Option<f64> {
    (place < numbers.len()).then(|| *numbers.select_nth_unstable_by(place, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn each(number: impl Fn(usize) -> f64) -> impl Fn(usize, &mut [f64]) {
        move |first, to| to.iter_mut().enumerate().for_each(|(k, to)| *to = number(first + k))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Sorting all of them is the oracle; few different numbers, runs, trends and missing ones are what a log has.
        #[test]
        fn the_median_is_the_middle_of_the_sorted_numbers(
            numbers in prop::collection::vec(prop_oneof![8 => -1e3..1e3_f64, 1 => Just(f64::NAN), 1 => Just(7.0)], 3000..9000),
            coarse in any::<bool>(),
            trend in -0.1..0.1_f64,
        ) {
            let number = |k: usize| if coarse { (numbers[k] / 400.0_f64).round() } else { numbers[k] } + trend * k as f64;
            let mut sorted: Vec<f64> = (0..numbers.len()).map(number).filter(|value| value.is_finite()).collect();
            sorted.sort_unstable_by(f64::total_cmp);
            prop_assert_eq!(median(numbers.len(), each(number)), Some((sorted[sorted.len() / 2], sorted.len())));
        }
    }

    #[test]
    fn a_sample_that_misleads_is_not_believed() {
        // Every number that the sample looks at is 1, or missing.
        let every = 10_240 / SAMPLE;
        for odd in [1.0, f64::NAN] {
            let number = |k: usize| if k.is_multiple_of(every) { odd } else { k as f64 };
            let (value, _) = median(10_240, each(number)).unwrap();
            let mut sorted: Vec<f64> = (0..10_240).map(number).filter(|value| value.is_finite()).collect();
            sorted.sort_unstable_by(f64::total_cmp);
            assert_eq!(value, sorted[sorted.len() / 2]);
        }
    }
}
