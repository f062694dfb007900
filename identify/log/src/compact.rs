//! A log as few bytes, from which it comes back with every bit.
//!
//! ```text
//! "wheelstate log 1\n"   the format and its version
//! u32 n, n bytes         source, hash, notes, names of the channels (each led by its length), number of samples
//! deflated               per channel, the times first: the first sample, then each XOR the one before it,
//!                        all first bytes, all second bytes, ... all eighth bytes
//! ```
//!
//! Neighbouring samples share sign, exponent and leading digits, which the XOR turns into zeros; bytes of one rank stand
//! together because they have much in common and the others are noise. Numbers are little-endian.

use crate::{Channel, Log, LogError, Series};
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use std::io::{Read, Write};

const MAGIC: &[u8] = b"wheelstate log 1\n";
/// Bytes of a double.
const BYTES: usize = 8;

impl Log {
    /// The log as few bytes.
    ///
    /// ```
    /// use wheelstate_log::{Channel, Log};
    ///
    /// let time = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
    /// let gear = Channel { name: "gear".into(), values: vec![3.0; 1000].into() };
    /// let log = Log { source: "ride.csv".into(), time, channels: vec![gear], ..Log::default() };
    /// let bytes = log.to_compact();
    /// assert!(bytes.len() < 8000 && Log::from_compact("block", &bytes)? == log);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn to_compact(&self) -> Vec<u8> {
        let names: Vec<&str> = self.channels.iter().map(|channel| channel.name.as_str()).collect();
        let mut head = Vec::new();
        for text in [&self.source, &self.sha256].into_iter().map(String::as_str) {
            push(&mut head, text.as_bytes());
        }
        for texts in [self.notes.iter().map(String::as_str).collect(), names] {
            head.extend_from_slice(&length(texts.len()));
            texts.iter().for_each(|text| push(&mut head, text.as_bytes()));
        }
        head.extend_from_slice(&(self.len() as u64).to_le_bytes());
        let mut bytes = MAGIC.to_vec();
        push(&mut bytes, &head);
        let mut deflate = DeflateEncoder::new(bytes, Compression::default());
        for values in std::iter::once(&self.time).chain(self.channels.iter().map(|channel| &channel.values)) {
            // Writing to memory does not fail.
            let _ = deflate.write_all(&planes(values));
        }
        deflate.finish().unwrap_or_default()
    }

    /// The log that became these bytes; `name` is named in errors.
    pub fn from_compact(name: &str, bytes: &[u8]) -> Result<Self, LogError> {
        parse(bytes).ok_or_else(|| LogError::file(name, "these bytes are no log of wheelstate, or are damaged"))
    }
}

fn parse(bytes: &[u8]) -> Option<Log> {
    let mut rest = bytes.strip_prefix(MAGIC)?;
    let mut head = take(&mut rest)?;
    let (source, sha256) = (text(&mut head)?, text(&mut head)?);
    let mut texts = || -> Option<Vec<String>> {
        let count = u32::from_le_bytes(*head.split_off(..4)?.first_chunk()?);
        (0..count).map(|_| text(&mut head)).collect()
    };
    let (notes, names) = (texts()?, texts()?);
    let samples = usize::try_from(u64::from_le_bytes(*head.first_chunk()?)).ok()?;
    let size = samples.checked_mul(BYTES)?;
    let mut inflate = DeflateDecoder::new(rest);
    let mut values = || -> Option<Series> {
        let mut planes = Vec::new();
        inflate.by_ref().take(size as u64).read_to_end(&mut planes).ok()?;
        (planes.len() == size).then(|| of_planes(&planes, samples))
    };
    let time = values()?;
    let channels: Option<Vec<Channel>> =
        names.into_iter().map(|name| values().map(|values| Channel { name, values })).collect();
    let log = Log { source, sha256, time, channels: channels?, notes, unread: Vec::new() };
    let increase = log.time.windows(2).all(|pair| pair[0] < pair[1]) && log.time.iter().all(|time| time.is_finite());
    increase.then_some(log)
}

fn length(count: usize) -> [u8; 4] {
    u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes()
}

fn push(to: &mut Vec<u8>, bytes: &[u8]) {
    to.extend_from_slice(&length(bytes.len()));
    to.extend_from_slice(bytes);
}

fn take<'a>(from: &mut &'a [u8]) -> Option<&'a [u8]> {
    let count = u32::from_le_bytes(*from.split_off(..4)?.first_chunk()?);
    from.split_off(..usize::try_from(count).ok()?)
}

fn text(from: &mut &[u8]) -> Option<String> {
    String::from_utf8(take(from)?.to_vec()).ok()
}

/// The bytes of samples by rank, each sample XOR the one before it.
fn planes(values: &[f64]) -> Vec<u8> {
    let mut planes = vec![0; BYTES * values.len()];
    let mut before = 0;
    for (k, value) in values.iter().enumerate() {
        let bits = value.to_bits();
        for (rank, byte) in (bits ^ before).to_le_bytes().into_iter().enumerate() {
            planes[rank * values.len() + k] = byte;
        }
        before = bits;
    }
    planes
}

fn of_planes(planes: &[u8], samples: usize) -> Series {
    let mut before = 0;
    let sample = |k: usize| {
        let bytes: [u8; BYTES] = std::array::from_fn(|rank| planes[rank * samples + k]);
        before ^= u64::from_le_bytes(bytes);
        f64::from_bits(before)
    };
    (0..samples).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_bit_of_every_sample_comes_back(bits in prop::collection::vec(any::<u64>(), 2..40), name in ".{0,12}") {
            let values: Series = bits.iter().map(|bits| f64::from_bits(*bits)).collect();
            let time = (0..values.len()).map(|k| k as f64).collect();
            let notes = vec![name.clone(), String::new()];
            let log = Log { source: name.clone(), time, notes, channels: vec![Channel { name, values }], ..Log::default() };
            let back = Log::from_compact("block", &log.to_compact()).unwrap();
            let bits_of = |log: &Log| log.channels[0].values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits_of(&back), bits_of(&log));
            prop_assert_eq!((back.source, back.notes, back.time), (log.source, log.notes, log.time));
        }

        #[test]
        fn damaged_bytes_are_refused_and_never_a_panic(at in 0_usize..200, byte in any::<u8>(), cut in 0_usize..400) {
            let channel = Channel { name: "speed".into(), values: (0..20).map(f64::from).collect() };
            let log = Log { time: (0..20).map(f64::from).collect(), channels: vec![channel], ..Log::default() };
            let mut bytes = log.to_compact();
            let place = at % bytes.len();
            bytes[place] = byte;
            bytes.truncate(cut);
            let _ = Log::from_compact("block", &bytes);
        }
    }
}
