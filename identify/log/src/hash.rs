//! SHA-256 of files, by which a log says what it came from.

use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// From so many bytes on another thread hashes, beside the reader.
const LARGE: u64 = 1 << 20;
/// Bytes of a file that are hashed at once.
const BLOCK: usize = 1 << 18;
/// Blocks that may wait for the other thread.
const WAITING: usize = 16;

/// Passes bytes on and remembers their number and SHA-256.
pub struct Hashed<R> {
    from: R,
    hasher: Hasher,
    /// How many bytes have passed.
    pub count: u64,
}

enum Hasher {
    Here(Sha256),
    Beside { blocks: SyncSender<Vec<u8>>, used: Receiver<Vec<u8>>, thread: JoinHandle<Sha256> },
}

impl Hasher {
    /// Goes on with another thread, if there can be one.
    fn beside(hash: Sha256) -> Self {
        let (blocks, waiting) = sync_channel::<Vec<u8>>(WAITING);
        let (done, used) = sync_channel(WAITING + 2);
        let mut other = hash.clone();
        let work = move || {
            for block in waiting {
                other.update(&block);
                let _ = done.try_send(block);
            }
            other
        };
        match std::thread::Builder::new().spawn(work) {
            Ok(thread) => Self::Beside { blocks, used, thread },
            Err(_) => Self::Here(hash),
        }
    }
}

impl<R> Hashed<R> {
    /// From the first byte on.
    pub fn new(from: R) -> Self {
        Self { from, hasher: Hasher::Here(Sha256::new()), count: 0 }
    }

    /// Of what has passed, hexadecimal.
    pub fn sha256(&mut self) -> String {
        match std::mem::replace(&mut self.hasher, Hasher::Here(Sha256::new())) {
            Hasher::Here(hash) => hexadecimal(&hash.finalize()),
            Hasher::Beside { blocks, thread, .. } => {
                drop(blocks);
                // hashing does not panic
                thread.join().map(|hash| hexadecimal(&hash.finalize())).unwrap_or_default()
            }
        }
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(buffer)?;
        let bytes = &buffer[..count];
        self.count += count as u64;
        match &mut self.hasher {
            Hasher::Here(hash) => {
                hash.update(bytes);
                if self.count >= LARGE {
                    self.hasher = Hasher::beside(hash.clone());
                }
            }
            Hasher::Beside { blocks, used, .. } => {
                let mut block = used.try_recv().unwrap_or_default();
                block.clear();
                block.extend_from_slice(bytes);
                // the other end is open until this one closes
                let _ = blocks.send(block);
            }
        }
        Ok(count)
    }
}

/// Does some work while another thread, if the file is worth it, takes its SHA-256, hexadecimal.
pub fn beside<T>(path: &Path, work: impl FnOnce() -> T) -> (T, io::Result<String>) {
    if std::fs::metadata(path).is_ok_and(|file| file.len() < LARGE) {
        return (work(), of_file(path));
    }
    std::thread::scope(|scope| match std::thread::Builder::new().spawn_scoped(scope, || of_file(path)) {
        Ok(thread) => {
            let result = work();
            // hashing does not panic
            (result, thread.join().unwrap_or_else(|_| Err(io::Error::other("the file could not be hashed"))))
        }
        Err(_) => (work(), of_file(path)),
    })
}

/// Of a whole file, hexadecimal.
fn of_file(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let mut hash = Sha256::new();
    let mut block = vec![0; BLOCK];
    loop {
        match file.read(&mut block) {
            Ok(0) => return Ok(hexadecimal(&hash.finalize())),
            Ok(count) => hash.update(&block[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Of bytes, hexadecimal.
pub fn of_bytes(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Two digits for each byte.
fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_hashed_beside_the_reader_has_the_hash_of_its_bytes() {
        for length in [0, 1000, LARGE as usize - 1, LARGE as usize, 3 * LARGE as usize + 12_345] {
            let bytes: Vec<u8> = (0..length).map(|k| ((k * k) >> 7) as u8).collect();
            let mut hashed = Hashed::new(bytes.as_slice());
            assert_eq!(io::copy(&mut hashed, &mut io::sink()).unwrap(), length as u64);
            assert_eq!(hashed.sha256(), of_bytes(&bytes), "{length} bytes");
        }
    }
}
