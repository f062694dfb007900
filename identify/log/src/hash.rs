//! SHA-256 of files, by which a log says what it came from.

use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Passes bytes on and remembers their number and SHA-256.
pub struct Hashed<R> {
    from: R,
    hash: Sha256,
    /// How many bytes have passed.
    pub count: u64,
}

impl<R: Read> Hashed<R> {
    /// From the first byte on.
    pub fn new(from: R) -> Self {
        Self { from, hash: Sha256::new(), count: 0 }
    }

    /// Of what has passed, hexadecimal.
    pub fn sha256(&self) -> String {
        hexadecimal(&self.hash.clone().finalize())
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.from.read(buffer)?;
        self.hash.update(&buffer[..count]);
        self.count += count as u64;
        Ok(count)
    }
}

/// Of a whole file, hexadecimal.
pub fn of_file(path: &Path) -> io::Result<String> {
    let mut hashed = Hashed::new(File::open(path)?);
    io::copy(&mut hashed, &mut io::sink())?;
    Ok(hashed.sha256())
}

/// Of bytes, hexadecimal.
pub fn of_bytes(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Two digits for each byte.
fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
