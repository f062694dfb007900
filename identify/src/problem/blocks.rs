//! Blocks of long logs, of which one after the other is in memory.
//!
//! Windows that overlap make rows, and a row belongs to the block that its window begins in: a block holds beyond its own
//! samples those that its last windows reach to. So every window of the log is complete and none counts twice.

use crate::log::Log;
use std::ops::Range;

/// Samples of a block: some ten megabytes of a machine's channels.
pub const BLOCK: usize = 1 << 17;

/// A block of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Which log it is of.
    pub log: usize,
    /// Its samples, with those that its last windows reach to.
    pub samples: Range<usize>,
    /// How many of them are its own.
    pub own: usize,
    /// Which block of its log it is, and of how many.
    pub place: (usize, usize),
}

impl Block {
    /// Cuts logs: those from `long` samples on into blocks of a multiple of `unit(log)` samples, which the windows of so many
    /// samples as it says, too, overlap.
    pub fn cut(logs: &[Log], long: usize, windows: impl Fn(&Log) -> (usize, usize)) -> Vec<Self> {
        let mut all = Vec::new();
        for (log, of) in logs.iter().enumerate() {
            let (mut size, mut window, mut count) = (of.len(), 0, 1);
            if of.len() >= long {
                let (unit, samples) = windows(of);
                window = samples;
                size = (BLOCK.min(long / 2) / unit).max(1) * unit;
                // A rest that is no block of its own goes with the last one.
                count = ((of.len() as f64 / size as f64).round() as usize).max(1);
            }
            all.extend((0..count).map(|k| {
                let (first, last) = (k * size, if k + 1 == count { of.len() } else { (k + 1) * size });
                Self { log, samples: first..(last + window).min(of.len()), own: last - first, place: (k, count) }
            }));
        }
        all
    }

    /// The block of its log without references, to be read when it is looked at.
    pub fn of(&self, logs: &[Log]) -> Log {
        logs[self.log].slice(self.samples.clone(), |name| !name.starts_with("true_"))
    }

    /// Of so many things from all over a log, how many are taken from this block.
    pub fn share(&self, of: usize) -> usize {
        let (place, count) = self.place;
        (0..of).filter(|k| k * count / of == place).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_of_one_block_and_every_window_of_the_log_in_one() {
        let log = |n: usize| Log { time: (0..n).map(|k| k as f64).collect(), ..Log::default() };
        let logs = [log(900), log(5678), log(1000)];
        let (stride, window) = (10, 121);
        let blocks = Block::cut(&logs, 1000, |_| (12 * stride, window - stride));
        for (index, log) in logs.iter().enumerate() {
            let of: Vec<&Block> = blocks.iter().filter(|block| block.log == index).collect();
            assert_eq!(of.iter().map(|block| block.own).sum::<usize>(), log.len());
            let starts = |samples: usize| (0..(samples + 1).saturating_sub(window)).step_by(stride);
            let all = of.iter().flat_map(|block| starts(block.samples.len()).map(|at| at + block.samples.start));
            assert_eq!(all.collect::<Vec<_>>(), starts(log.len()).collect::<Vec<_>>());
            assert_eq!(of.iter().map(|block| block.share(8)).sum::<usize>(), 8);
        }
        assert!(blocks.iter().filter(|block| block.log == 1).count() > 5);
    }
}
