//! Samples that a log shares with its parts and copies.

use std::fmt;
use std::ops::{Deref, DerefMut, Range};
use std::sync::Arc;

/// The samples of one channel, or the times of a log: a slice of numbers. Clones and [`part`](Self::part)s stand for the same
/// memory, so that the parts of a log, and a log of which one channel is changed, cost nothing but what differs. A write
/// copies first what others share.
///
/// ```
/// use wheelstate_log::Series;
///
/// let speed = Series::from(vec![0.0, 1.0, 2.0, 3.0]);
/// let mut late = speed.part(2..4);
/// late[0] = 5.0;
/// assert!(late == [5.0, 3.0] && speed == [0.0, 1.0, 2.0, 3.0]);
/// ```
#[derive(Clone, Default)]
pub struct Series {
    shared: Arc<Vec<f64>>,
    part: Range<usize>,
}

impl Series {
    /// The samples.
    #[inline]
    pub fn as_slice(&self) -> &[f64] {
        self
    }

    /// A part of the samples, counted from the first one.
    pub fn part(&self, samples: Range<usize>) -> Self {
        let part = self.part.start + samples.start..self.part.start + samples.end;
        assert!(samples.start <= samples.end && part.end <= self.part.end, "{samples:?} of {} samples", self.len());
        Self { shared: Arc::clone(&self.shared), part }
    }
}

impl Deref for Series {
    type Target = [f64];

    #[inline]
    fn deref(&self) -> &[f64] {
        &self.shared[self.part.clone()]
    }
}

impl DerefMut for Series {
    fn deref_mut(&mut self) -> &mut [f64] {
        if Arc::get_mut(&mut self.shared).is_none() {
            *self = Self::from(self.to_vec());
        }
        // Nobody shares it any more, so that this copies nothing.
        &mut Arc::make_mut(&mut self.shared)[self.part.clone()]
    }
}

impl From<Vec<f64>> for Series {
    fn from(samples: Vec<f64>) -> Self {
        Self { part: 0..samples.len(), shared: Arc::new(samples) }
    }
}

impl FromIterator<f64> for Series {
    fn from_iter<I: IntoIterator<Item = f64>>(samples: I) -> Self {
        Self::from(Vec::from_iter(samples))
    }
}

impl<'a> IntoIterator for &'a Series {
    type Item = &'a f64;
    type IntoIter = std::slice::Iter<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a> IntoIterator for &'a mut Series {
    type Item = &'a mut f64;
    type IntoIter = std::slice::IterMut<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

impl<T: AsRef<[f64]> + ?Sized> PartialEq<T> for Series {
    fn eq(&self, other: &T) -> bool {
        **self == *other.as_ref()
    }
}

impl AsRef<[f64]> for Series {
    fn as_ref(&self) -> &[f64] {
        self
    }
}

impl fmt::Debug for Series {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::Series;

    #[test]
    fn a_write_changes_no_other_series_and_copies_only_what_is_shared() {
        let mut whole = Series::from(vec![0.0, 1.0, 2.0, 3.0]);
        let place = whole.as_ptr();
        let part = whole.part(1..4).part(1..3);
        assert_eq!(part, [2.0, 3.0]);
        assert_eq!(part.as_ptr(), whole[2..].as_ptr());
        whole[3] = 7.0;
        assert_eq!((whole.to_vec(), part.to_vec()), (vec![0.0, 1.0, 2.0, 7.0], vec![2.0, 3.0]));
        assert_ne!(whole.as_ptr(), place);
        let place = whole.as_ptr();
        whole[0] = 9.0;
        assert_eq!(whole.as_ptr(), place);
    }

    #[test]
    #[should_panic(expected = "1..4 of 3 samples")]
    fn a_part_beyond_the_end_is_refused() {
        let _ = Series::from(vec![0.0; 8]).part(2..5).part(1..4);
    }
}
