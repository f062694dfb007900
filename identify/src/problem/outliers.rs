//! Outliers of single samples.

use crate::log::Log;
use crate::log::columns::fits;
use std::borrow::Cow;

/// Reach to both sides of the filter, s, and its threshold in robust standard deviations.
const REACH: f64 = 0.1;
const THRESHOLD: f64 = 4.0;

/// Share of outliers in a channel from which on they are worth a note.
const MANY: f64 = 0.01;

/// The logs with the outliers of these channels (a `*` stands for any text) replaced, see [`hampel`], and a note on each log that
/// had many.
pub fn replaced<'a>(logs: &'a [Log], channels: &[&str]) -> (Cow<'a, [Log]>, Vec<String>) {
    if channels.is_empty() {
        return (Cow::Borrowed(logs), Vec::new());
    }
    let (mut logs, mut notes) = (logs.to_vec(), Vec::new());
    for log in &mut logs {
        let period = log.period();
        let (mut count, mut all, mut names) = (0, 0, Vec::new());
        for channel in log.channels.iter_mut().filter(|c| channels.iter().any(|pattern| fits(pattern, &c.name))) {
            let (outliers, samples) = (hampel(&mut channel.values, period), channel.values.len());
            if outliers as f64 > MANY * samples as f64 {
                count += outliers;
                all += samples;
                names.push(channel.name.as_str());
            }
        }
        if !names.is_empty() {
            notes.push(format!(
                "{:.1} % of the samples of {} in {} were outliers and were replaced by the median around them",
                100.0 * count as f64 / all as f64,
                names.join(", "),
                log.source
            ));
        }
    }
    (Cow::Owned(logs), notes)
}

/// Replaces outliers by the median around them; on raw samples, because every window of a hundred
/// samples holds some and no robust loss on windows could tell them. Returns how many.
pub fn hampel(x: &mut [f64], period: f64) -> usize {
    let reach = ((REACH / period).round() as usize).max(1);
    let raw = x.to_vec();
    // The samples around the current one in order: its median is in the middle.
    let mut around: Vec<f64> = Vec::with_capacity(2 * reach + 2);
    // Noise decides every comparison of a bisection: to count them all is faster in windows this short.
    let place = |around: &[f64], value: f64| around.iter().filter(|other| **other < value).count();
    let enter = |around: &mut Vec<f64>, value: f64| {
        if value.is_finite() {
            around.insert(place(around, value), value);
        }
    };
    raw.iter().take(reach).for_each(|value| enter(&mut around, *value));
    let mut deviations = Vec::with_capacity(2 * reach + 2);
    let (mut replaced, mut moving) = (0, None);
    for (i, value) in x.iter_mut().enumerate() {
        if let Some(ahead) = raw.get(i + reach) {
            enter(&mut around, *ahead);
        }
        if let Some(behind) = (i > reach).then(|| raw[i - reach - 1]).filter(|value| value.is_finite()) {
            around.remove(place(&around, behind));
        }
        let n = around.len();
        if n == 0 {
            continue;
        }
        let centre = if n % 2 == 1 { around[n / 2] } else { 0.5 * (around[n / 2 - 1] + around[n / 2]) };
        let away = (*value - centre).abs();
        // An outlier has at least half of the others this near to the median; few samples get beyond this count.
        let near = away / (THRESHOLD * 1.4826);
        if around.iter().filter(|other| (**other - centre).abs() < near).count() < n / 2 {
            continue;
        }
        let mut spread = median(&mut deviations, around.iter().map(|v| (v - centre).abs())).unwrap_or(0.0);
        // A counter at rest has no spread to judge by, but how it moves elsewhere.
        if spread == 0.0 && away > 0.0 {
            spread = *moving.get_or_insert_with(|| {
                let steps = raw.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0);
                reach as f64 * median(&mut Vec::new(), steps).unwrap_or(0.0)
            });
        }
        if spread > 0.0 && away > THRESHOLD * 1.4826 * spread {
            *value = centre;
            replaced += 1;
        }
    }
    replaced
}

fn median(buffer: &mut Vec<f64>, values: impl Iterator<Item = f64>) -> Option<f64> {
    buffer.clear();
    buffer.extend(values.filter(|value| value.is_finite()));
    let n = buffer.len();
    if n == 0 {
        return None;
    }
    let (below, middle, _) = buffer.select_nth_unstable_by(n / 2, f64::total_cmp);
    Some(if n % 2 == 1 { *middle } else { 0.5 * (below.iter().copied().fold(f64::MIN, f64::max) + *middle) })
}

#[cfg(test)]
mod tests {
    use super::hampel;

    #[test]
    fn outliers_are_replaced_and_the_rest_is_kept() {
        let clean: Vec<f64> = (0..200).map(|i| (0.05 * f64::from(i)).sin() + 0.01 * f64::from(i % 3)).collect();
        let mut x = clean.clone();
        for i in [0, 20, 21, 77, 199] {
            x[i] += if i % 2 == 0 { 5.0 } else { -3.0 };
        }
        x[100] = f64::NAN;
        assert_eq!(hampel(&mut x, 0.01), 5);
        for (i, (x, clean)) in x.iter().zip(&clean).enumerate() {
            assert!(i == 100 || (x - clean).abs() < 0.5, "{i}: {x} instead of {clean}");
        }
        assert!(x[100].is_nan());
        let mut still = vec![1.0; 50];
        still[3] = 1.1;
        assert_eq!(hampel(&mut still, 0.01), 0);
        // A counter that stands, then moves, and is wrong once in either: a spike; its start is none.
        let moving = |i: usize| 0.02 * i.saturating_sub(100) as f64;
        let mut counter: Vec<f64> = (0..200).map(moving).collect();
        counter[50] += 30.0;
        counter[150] -= 30.0;
        assert_eq!(hampel(&mut counter, 0.01), 2);
        assert!(counter.iter().enumerate().all(|(i, value)| (value - moving(i)).abs() < 0.03));
    }
}
