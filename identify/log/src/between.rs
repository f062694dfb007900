//! What a channel is at times at which it was not sampled.

/// How samples are carried to other times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Between {
    /// Each sample at the nearest of the other times, nothing in between.
    Missing,
    /// The last sample, for at most two periods.
    Hold,
    /// The nearest sample, at most one period away.
    Nearest,
    /// Linear between two samples at most two periods apart.
    Linear,
}

/// Times that differ by less, s, are the same: clocks are written with about this many digits.
const SAME: f64 = 1e-9;

impl Between {
    pub fn parse(text: &str) -> Result<Self, String> {
        match text {
            "missing" => Ok(Self::Missing),
            "hold" => Ok(Self::Hold),
            "nearest" => Ok(Self::Nearest),
            "linear" => Ok(Self::Linear),
            _ => Err(format!(
                "between '{}' is not known; known are missing, hold, nearest and linear",
                text.escape_debug()
            )),
        }
    }
}

/// The mean time between samples, s; infinite for less than two.
pub(crate) fn period(times: &[f64]) -> f64 {
    match times {
        [first, .., last] => (last - first) / (times.len() - 1) as f64,
        _ => f64::INFINITY,
    }
}

/// Values at the times `from`, carried to the times `to`; both increase.
pub(crate) fn carry(from: &[f64], values: &[f64], to: &[f64], how: Between) -> Vec<f64> {
    let period = period(from);
    if how == Between::Missing {
        return place(from, values, to);
    }
    let mut next = 0;
    let at = |time: &f64| {
        while next < from.len() && from[next] <= time + SAME {
            next += 1;
        }
        let last = next.checked_sub(1);
        let (before, after) = (last.map(|k| (from[k], values[k])), from.get(next).map(|t| (*t, values[next])));
        match (how, before, after) {
            (Between::Hold, Some((t, value)), _) if time - t <= 2.0 * period => value,
            (Between::Nearest, before, after) => {
                let near = [before, after]
                    .into_iter()
                    .flatten()
                    .min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
                near.filter(|(t, _)| (t - time).abs() <= period.min(f64::MAX)).map_or(f64::NAN, |(_, value)| value)
            }
            (Between::Linear, Some((t, value)), _) if (time - t).abs() <= SAME => value,
            (Between::Linear, Some((t0, a)), Some((t1, b))) if t1 - t0 <= 2.0 * period => {
                a + (time - t0) / (t1 - t0) * (b - a)
            }
            _ => f64::NAN,
        }
    };
    to.iter().map(at).collect()
}

/// Each sample at the nearest time within half a step, where it is the nearest sample.
fn place(from: &[f64], values: &[f64], to: &[f64]) -> Vec<f64> {
    let mut placed = vec![f64::NAN; to.len()];
    let mut away = vec![f64::INFINITY; to.len()];
    let mut after = 0;
    for (time, value) in from.iter().zip(values) {
        while after < to.len() && to[after] < *time {
            after += 1;
        }
        // The nearer one of the times around this sample.
        let nearest = match after.checked_sub(1) {
            Some(before) if after == to.len() || time - to[before] <= to[after] - time => before,
            _ if after < to.len() => after,
            _ => continue,
        };
        // At the ends of the log there is only one step to compare with.
        let step = |a: usize, b: usize| to.get(a).zip(to.get(b)).map_or(0.0, |(a, b)| b - a);
        let reach =
            0.5 * if to[nearest] < *time { step(nearest, nearest + 1) } else { step(nearest.wrapping_sub(1), nearest) };
        let reach = if reach > 0.0 { reach } else { 0.5 * step(0, 1) };
        let distance = (time - to[nearest]).abs();
        if distance <= reach + SAME && distance < away[nearest] {
            placed[nearest] = *value;
            away[nearest] = distance;
        }
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    const FROM: [f64; 4] = [0.1, 1.1, 2.1, 5.1];
    const VALUES: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

    fn at(times: &[f64], how: Between) -> Vec<f64> {
        carry(&FROM, &VALUES, times, how)
    }

    #[test]
    fn a_sample_stands_once_and_at_the_nearest_time() {
        let times: Vec<f64> = (0..28).map(|k| 0.2 * f64::from(k)).collect();
        let placed = at(&times, Between::Missing);
        let present: Vec<_> = placed.iter().enumerate().filter(|(_, value)| !value.is_nan()).collect();
        assert_eq!(present.len(), 4, "{placed:?}");
        for ((k, value), (time, expected)) in present.into_iter().zip(FROM.iter().zip(VALUES)) {
            assert_eq!(*value, expected);
            assert!((times[k] - time).abs() <= 0.1 + 1e-9);
        }
        // Far outside the log there is no place for a sample.
        assert!(at(&[-3.0, -2.0, -1.5], Between::Missing).iter().all(|value| value.is_nan()));
    }

    #[test]
    fn holding_ends_and_lines_do_not_cross_gaps() {
        // The mean period is 5/3 s.
        assert_eq!(at(&[0.1, 1.0, 2.2, 5.3], Between::Hold)[..], [1.0, 1.0, 4.0, 8.0]);
        assert!(at(&[0.0, 9.0], Between::Hold).iter().all(|value| value.is_nan()));
        assert_eq!(at(&[0.6, 1.1, 1.6], Between::Linear)[..], [1.5, 2.0, 3.0]);
        assert_eq!(at(&[0.0, 0.7, 4.9], Between::Nearest)[..], [1.0, 2.0, 8.0]);
        assert!(at(&[-2.0, 7.0], Between::Nearest).iter().all(|value| value.is_nan()));
    }
}
