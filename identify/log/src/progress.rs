//! How a long computation tells how far it is and learns that it shall stop.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A handle that library functions take by reference. [`Progress::none`] shows nothing.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    bar: Option<ProgressBar>,
    stop: Arc<AtomicBool>,
}

impl Progress {
    /// Shows nothing; for tests and for use as a library.
    pub fn none() -> Self {
        Self::default()
    }

    /// A bar on stderr, and only if that is a terminal.
    pub fn terminal() -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
        Self { bar: Some(bar), stop: Arc::default() }
    }

    /// Begins a part of the work of `total` equal pieces, as in `start("reading log.csv", 3_600)`.
    pub fn start(&self, what: impl Into<String>, total: u64) {
        let Some(bar) = &self.bar else { return };
        let style = ProgressStyle::with_template("{msg:28!} {bar:32} {percent:>3} %  {eta:>5}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_message(what.into());
        bar.set_length(total.max(1));
        bar.set_position(0);
        bar.reset_eta();
        bar.enable_steady_tick(Duration::from_millis(200));
    }

    /// Changes what is shown beside the bar, as in `describe("tuning, best 1.23")`.
    pub fn describe(&self, what: impl Into<String>) {
        if let Some(bar) = &self.bar {
            bar.set_message(what.into());
        }
    }

    /// `pieces` more are done.
    pub fn advance(&self, pieces: u64) {
        if let Some(bar) = &self.bar {
            bar.inc(pieces);
        }
    }

    /// Takes the bar off the terminal.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// Asks the computation to stop at the next convenient place.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Whether to stop: long loops look at this now and then and return early with [`Interrupted`].
    pub fn check(&self) -> Result<(), Interrupted> {
        if self.stop.load(Ordering::Relaxed) { Err(Interrupted) } else { Ok(()) }
    }
}

/// The user asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;
