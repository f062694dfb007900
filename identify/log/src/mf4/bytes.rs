//! The bytes of a file, read where they are asked for: a recording may be larger than the memory.

use super::Failure;
use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

/// What describes the records is spread over the file in small blocks, near others of their kind: it is read by pages of
/// so many bytes, of which so many are kept.
const PAGE: u64 = 1 << 14;
const KEPT: u64 = 64;

/// A file that is open for reading.
pub struct Bytes {
    file: File,
    length: u64,
    pages: RefCell<Vec<Page>>,
}

/// A page of the file, by its number.
#[derive(Clone, Default)]
struct Page {
    number: Option<u64>,
    bytes: Vec<u8>,
}

impl Bytes {
    pub fn new(file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        Ok(Self { file, length, pages: RefCell::new(vec![Page::default(); KEPT as usize]) })
    }

    /// Length of the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Up to `count` bytes from a place on; fewer where the file ends.
    pub fn few(&self, at: u64, count: usize) -> Result<Vec<u8>, Failure> {
        let end = at.saturating_add(count as u64).min(self.length);
        let mut bytes = Vec::with_capacity(end.saturating_sub(at) as usize);
        let mut at = at;
        while at < end {
            let number = at / PAGE;
            let mut pages = self.pages.borrow_mut();
            let page = &mut pages[(number % KEPT) as usize];
            if page.number != Some(number) {
                page.bytes.clear();
                page.number = None;
                self.append(number * PAGE, PAGE.min(self.length - number * PAGE), &mut page.bytes)?;
                page.number = Some(number);
            }
            let from = (at - number * PAGE) as usize;
            let to = (end - number * PAGE).min(PAGE) as usize;
            bytes.extend_from_slice(&page.bytes[from..to]);
            at += (to - from) as u64;
        }
        Ok(bytes)
    }

    /// Appends exactly `count` bytes from a place on.
    pub fn append(&self, at: u64, count: u64, to: &mut Vec<u8>) -> Result<(), Failure> {
        let mut file = &self.file;
        let read = || -> io::Result<u64> {
            file.seek(SeekFrom::Start(at))?;
            to.reserve(count as usize);
            Ok(file.take(count).read_to_end(to)? as u64)
        };
        match { read }() {
            Ok(read) if read == count => Ok(()),
            Ok(_) => Err(Failure::damaged("the file became shorter while it was read".to_owned())),
            Err(error) => Err(Failure::damaged(error.to_string())),
        }
    }
}
