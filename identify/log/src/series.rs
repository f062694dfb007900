//! Samples that a log shares with its parts and copies.

use crate::store::{PIECE, Store, Stored};
use std::fmt;
use std::io;
use std::ops::{Deref, DerefMut, Range};
use std::sync::{Arc, OnceLock};

/// The samples of one channel, or the times of a log: a slice of numbers. Clones and [`part`](Self::part)s stand for the same
/// memory, so that the parts of a log, and a log of which one channel is changed, cost nothing but what differs. A write
/// copies first what others share.
///
/// The samples of a long log stand in a file ([`Store`]). Then a series reads its own part when it is looked at for the first
/// time and keeps it as long as it lives: who looks at all of it piece by piece takes [`pieces`](Self::pieces), and who has
/// done with it lets a [`clone`](Clone::clone) or a [`part`](Self::part) go.
///
/// ```
/// use wheelstate_log::Series;
///
/// let speed = Series::from(vec![0.0, 1.0, 2.0, 3.0]);
/// let mut late = speed.part(2..4);
/// late[0] = 5.0;
/// assert!(late == [5.0, 3.0] && speed == [0.0, 1.0, 2.0, 3.0]);
/// ```
#[derive(Clone)]
pub struct Series {
    held: Held,
    part: Range<usize>,
}

#[derive(Clone)]
enum Held {
    /// All samples, of which the series has a part.
    Memory(Arc<Vec<f64>>),
    /// A column in a file, and once it was looked at the part that the series has.
    Stored(Arc<Stored>, OnceLock<Arc<Vec<f64>>>),
}

impl Series {
    /// The samples.
    #[inline]
    pub fn as_slice(&self) -> &[f64] {
        self
    }

    /// Number of samples.
    #[inline]
    pub fn len(&self) -> usize {
        self.part.len()
    }

    /// Whether there is no sample.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.part.is_empty()
    }

    /// A part of the samples, counted from the first one.
    pub fn part(&self, samples: Range<usize>) -> Self {
        let part = self.part.start + samples.start..self.part.start + samples.end;
        assert!(samples.start <= samples.end && part.end <= self.part.end, "{samples:?} of {} samples", self.len());
        match &self.held {
            Held::Memory(all) => Self { held: Held::Memory(Arc::clone(all)), part },
            Held::Stored(column, own) => match own.get() {
                Some(own) => Self { held: Held::Memory(Arc::clone(own)), part: samples },
                None => Self { held: Held::Stored(Arc::clone(column), OnceLock::new()), part },
            },
        }
    }

    /// The samples one piece after the other: of a file some ten thousand at a time, so that never more of them are in memory.
    pub fn pieces(&self) -> impl Iterator<Item = Self> {
        let size = match &self.held {
            Held::Memory(_) => self.len().max(1),
            Held::Stored(..) => PIECE,
        };
        (0..self.len()).step_by(size).map(move |first| self.part(first..(first + size).min(self.len())))
    }

    /// Whether a sample is of some kind; what comes after the first one is not looked at.
    pub fn any(&self, of_kind: impl Fn(f64) -> bool) -> bool {
        self.pieces().any(|piece| piece.iter().any(|value| of_kind(*value)))
    }

    /// All samples, where they stand in a file read into this room: one series after the other takes it.
    pub fn look<'a>(&'a self, room: &'a mut Vec<f64>) -> &'a [f64] {
        match &self.held {
            Held::Stored(column, own) if own.get().is_none() => {
                room.clear();
                column.read(self.part.clone(), room);
                room
            }
            _ => self,
        }
    }

    /// Whether a sample may be infinite: of a file it was seen when it was written.
    pub(crate) fn may_be_infinite(&self) -> bool {
        !matches!(&self.held, Held::Stored(column, _) if !column.infinite())
    }

    /// One sample.
    pub fn at(&self, sample: usize) -> f64 {
        self.part(sample..sample + 1)[0]
    }

    /// The same, in a file where it is in one, and nothing of it in memory.
    pub(crate) fn put_back(&mut self) {
        if let Held::Stored(_, own) = &mut self.held {
            own.take();
        }
    }

    /// Puts the samples into a file, if they do not stand in one, and lets go what was read of them.
    pub fn put_away(&mut self, store: &Store) -> io::Result<()> {
        if let Held::Memory(_) = &self.held {
            let mut column = Stored::new(store);
            column.append(self)?;
            *self = Self::from(column);
        }
        self.put_back();
        Ok(())
    }
}

impl Default for Series {
    fn default() -> Self {
        Self::from(Vec::new())
    }
}

impl Deref for Series {
    type Target = [f64];

    #[inline]
    fn deref(&self) -> &[f64] {
        match &self.held {
            Held::Memory(all) => &all[self.part.clone()],
            Held::Stored(column, own) => own.get_or_init(|| {
                let mut samples = Vec::new();
                column.read(self.part.clone(), &mut samples);
                Arc::new(samples)
            }),
        }
    }
}

impl DerefMut for Series {
    fn deref_mut(&mut self) -> &mut [f64] {
        let alone = match &mut self.held {
            Held::Memory(all) => Arc::get_mut(all).is_some(),
            Held::Stored(..) => false,
        };
        if !alone {
            *self = Self::from(self.to_vec());
        }
        match &mut self.held {
            // Nobody shares it any more, so that this copies nothing.
            Held::Memory(all) => &mut Arc::make_mut(all)[self.part.clone()],
            Held::Stored(..) => &mut [],
        }
    }
}

impl From<Stored> for Series {
    fn from(column: Stored) -> Self {
        Self { part: 0..column.len(), held: Held::Stored(Arc::new(column), OnceLock::new()) }
    }
}

impl From<Vec<f64>> for Series {
    fn from(samples: Vec<f64>) -> Self {
        Self { part: 0..samples.len(), held: Held::Memory(Arc::new(samples)) }
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
    use super::*;

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
    fn what_is_put_away_comes_back_in_whole_and_in_parts() {
        let values: Vec<f64> =
            (0..2 * PIECE + 7).map(|k| f64::from_bits((k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))).collect();
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        let mut series = Series::from(values.clone()).part(3..values.len());
        let before = Series::from(vec![1.0; 5]);
        let store = Store::new().unwrap();
        for column in [&mut before.clone(), &mut series] {
            column.put_away(&store).unwrap();
        }
        assert_eq!(series.len(), values.len() - 3);
        let part = series.part(PIECE - 5..PIECE + 9);
        assert_eq!(bits(&part.part(2..14)), bits(&values[PIECE..PIECE + 12]));
        assert_eq!(bits(&part.part(2..14)), bits(&part[2..14]));
        assert_eq!(series.at(9).to_bits(), values[12].to_bits());
        let pieces: Vec<f64> = series.pieces().flat_map(|piece| piece.to_vec()).collect();
        assert_eq!(bits(&pieces), bits(&values[3..]));
        series[0] = 7.0;
        assert_eq!((series[0], bits(&series[1..])), (7.0, bits(&values[4..])));
    }

    #[test]
    #[should_panic(expected = "1..4 of 3 samples")]
    fn a_part_beyond_the_end_is_refused() {
        let _ = Series::from(vec![0.0; 8]).part(2..5).part(1..4);
    }
}
