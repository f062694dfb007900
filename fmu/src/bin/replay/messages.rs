//! What the FMU logs. The `fmi` crate hands it to the `log` crate, and its errors carry no text.

use log::{Level, Log, Metadata, Record};
use std::sync::Mutex;

/// The reasons of refusals so far.
static REASONS: Mutex<Vec<String>> = Mutex::new(Vec::new());

struct Collector;

/// Begins to collect.
pub fn collect() {
    // a second logger would be refused, and there is none
    let _ = log::set_logger(&Collector);
}

impl Log for Collector {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.level() == Level::Error
    }

    fn log(&self, record: &Record) {
        if self.enabled(record.metadata())
            && let Ok(mut reasons) = REASONS.lock()
        {
            reasons.push(record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// The reason that the FMU gave last, or the error itself if it gave none.
pub fn reason(error: impl std::fmt::Display) -> String {
    let last = REASONS.lock().ok().and_then(|mut reasons| reasons.pop());
    last.unwrap_or_else(|| error.to_string())
}
