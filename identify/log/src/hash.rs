//! SHA-256 of files, by which a log says what it came from.

use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// From so many bytes on another thread hashes a file, beside its reader.
const LARGE: u64 = 1 << 20;
/// Bytes of a file that are hashed at once.
const BLOCK: usize = 1 << 18;

/// Passes bytes on, counts them and takes their SHA-256 if that is not taken beside.
pub struct Hashed<'a> {
    from: Box<dyn Read + 'a>,
    hash: Option<Sha256>,
    /// How many bytes have passed.
    pub count: u64,
}

impl<'a> Hashed<'a> {
    pub fn new(from: impl Read + 'a) -> Self {
        Self { hash: Some(Sha256::new()), ..Self::beside(from) }
    }

    /// For bytes whose hash is taken beside.
    pub fn beside(from: impl Read + 'a) -> Self {
        Self { from: Box::new(from), hash: None, count: 0 }
    }

    /// Of what has passed, hexadecimal; empty if it is taken beside.
    pub fn sha256(&mut self) -> String {
        self.hash.take().map(|hash| hexadecimal(&hash.finalize())).unwrap_or_default()
    }
}

impl Read for Hashed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(buffer)?;
        if let Some(hash) = &mut self.hash {
            hash.update(&buffer[..count]);
        }
        self.count += count as u64;
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
    fn files_of_any_length_have_the_published_hashes() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("file");
        // NIST's examples for FIPS 180-4, and for a file that is hashed beside its reader `head -c 16M /dev/zero | tr '\\0' a | sha256sum`.
        for (text, count, hash) in [
            ("", 1, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
            ("abc", 1, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"),
            ("a", 1_000_000, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0"),
            ("a", 16_777_216, "5b6ff2e19d0da0fe323061018fc381393492884e74af8296c81ab9cb2694783a"),
        ] {
            std::fs::write(&path, text.repeat(count)).unwrap();
            let (result, found) = beside(&path, || 7);
            assert_eq!((result, found.unwrap().as_str()), (7, hash), "{count} times {text:?}");
            assert_eq!(of_bytes(text.repeat(count).as_bytes()), hash);
        }
        assert!(beside(&folder.path().join("nothing"), || ()).1.is_err());
    }
}
