//! Samples in a temporary file, so that long logs and many logs do not fill the memory.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Samples from which a log is a long one: its columns stand in a file, and who can takes it in blocks.
pub const LONG: usize = 1 << 20;
/// Samples of a column that stand together in the file.
pub(crate) const PIECE: usize = 1 << 16;
/// Samples that are turned into bytes and back at once; with their bytes they fit the second-level cache.
const TURNED: usize = 1 << 13;
/// Bytes of a sample.
const BYTES: usize = size_of::<f64>();

/// What to do about it stands in the message.
fn failed(error: &io::Error) -> io::Error {
    let folder = folder();
    let what =
        format!("no temporary file for its samples in {}: {error}; TMPDIR chooses another folder", folder.display());
    io::Error::new(error.kind(), what)
}

/// A temporary file without a name that samples are put away in, see [`Log::put_away`](crate::Log::put_away). It goes with
/// the last series that stands in it, also when the program is stopped. What is read again soon is still in the system's
/// cache of files, which gives way to whoever needs memory.
#[derive(Clone, Debug)]
pub struct Store {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    file: File,
    end: AtomicU64,
}

/// Where large temporary files belong: `/tmp` may be in memory.
fn folder() -> PathBuf {
    let large = PathBuf::from("/var/tmp");
    if std::env::var_os("TMPDIR").is_none() && cfg!(unix) && large.is_dir() { large } else { std::env::temp_dir() }
}

impl Store {
    /// A new file in `TMPDIR`, or where the system keeps large temporary files.
    pub fn new() -> io::Result<Self> {
        let file = tempfile::tempfile_in(folder()).map_err(|error| failed(&error))?;
        Ok(Self { shared: Arc::new(Shared { file, end: AtomicU64::new(0) }) })
    }

    /// Writes samples and returns where they stand.
    fn write(&self, samples: &[f64]) -> io::Result<u64> {
        let place = self.shared.end.fetch_add((BYTES * samples.len()) as u64, Ordering::Relaxed);
        let mut bytes = vec![0; BYTES * samples.len().min(TURNED)];
        let mut at = place;
        for samples in samples.chunks(TURNED) {
            let bytes = &mut bytes[..BYTES * samples.len()];
            let (turned, _) = bytes.as_chunks_mut::<BYTES>();
            turned.iter_mut().zip(samples).for_each(|(bytes, sample)| *bytes = sample.to_le_bytes());
            write_at(&self.shared.file, bytes, at).map_err(|error| failed(&error))?;
            at += bytes.len() as u64;
        }
        Ok(place)
    }

    /// Appends so many samples from a place.
    fn read(&self, place: u64, count: usize, to: &mut Vec<f64>) -> io::Result<()> {
        let mut bytes = vec![0; BYTES * count.min(TURNED)];
        let mut at = place;
        let mut left = count;
        while left > 0 {
            let bytes = &mut bytes[..BYTES * left.min(TURNED)];
            read_at(&self.shared.file, bytes, at)?;
            let (turned, _) = bytes.as_chunks::<BYTES>();
            to.extend(turned.iter().map(|bytes| f64::from_le_bytes(*bytes)));
            at += bytes.len() as u64;
            left -= turned.len();
        }
        Ok(())
    }
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], place: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, place)
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], place: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, place)
}

#[cfg(windows)]
fn write_at(file: &File, mut bytes: &[u8], mut place: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, place)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            count => (bytes, place) = (&bytes[count..], place + count as u64),
        }
    }
    Ok(())
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut place: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, place)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => (bytes, place) = (&mut bytes[count..], place + count as u64),
        }
    }
    Ok(())
}

/// A column in a [`Store`].
#[derive(Debug)]
pub(crate) struct Stored {
    store: Store,
    /// Where its pieces stand, of [`PIECE`] samples each but the last.
    pieces: Vec<u64>,
    len: usize,
    /// Whether a sample is infinite, which is seen while they pass.
    infinite: bool,
}

impl Stored {
    /// An empty column.
    pub fn new(store: &Store) -> Self {
        Self { store: store.clone(), pieces: Vec::new(), len: 0, infinite: false }
    }

    pub fn len(&self) -> usize {
        self.len
    }

    /// Appends samples; all calls but the last take whole pieces.
    pub fn append(&mut self, samples: &[f64]) -> io::Result<()> {
        debug_assert!(self.len.is_multiple_of(PIECE));
        for piece in samples.chunks(PIECE) {
            self.pieces.push(self.store.write(piece)?);
            self.len += piece.len();
            self.infinite |= piece.iter().filter(|value| value.is_infinite()).count() > 0;
        }
        Ok(())
    }

    /// Whether a sample may be infinite.
    pub fn infinite(&self) -> bool {
        self.infinite
    }

    /// Appends a part.
    pub fn read(&self, part: Range<usize>, samples: &mut Vec<f64>) {
        samples.reserve_exact(part.len());
        let mut at = part.start;
        while at < part.end {
            let within = at % PIECE;
            let count = (PIECE - within).min(part.end - at);
            let place = self.pieces[at / PIECE] + (BYTES * within) as u64;
            if let Err(error) = self.store.read(place, count, samples) {
                // The file was written by this very process: its disk has failed, and any number in its place were a guess.
                panic!("samples in a temporary file cannot be read back: {error}");
            }
            at += count;
        }
    }
}
