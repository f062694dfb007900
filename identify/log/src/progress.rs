//! How a long computation reports its progress and is asked to stop.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Length of a bar whose progress is given in shares.
const SHARES: f64 = 1000.0;

/// A handle that library functions take by reference. [`Progress::none`] shows nothing.
#[derive(Clone, Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    stop: Arc<AtomicBool>,
    /// What the handle is about, as shares of the present work.
    part: Range<f64>,
}

impl Default for Progress {
    fn default() -> Self {
        Self { bar: None, stop: Arc::default(), part: 0.0..1.0 }
    }
}

impl Progress {
    /// Shows nothing; for tests and for use as a library.
    pub fn none() -> Self {
        Self::default()
    }

    /// A bar on stderr, and only if that is a terminal.
    pub fn terminal() -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
        Self { bar: Some(bar), ..Self::default() }
    }

    /// Shows nothing and remembers what it is told: for programs with a display of their own, which look at
    /// [`now`](Self::now).
    pub fn silent() -> Self {
        Self { bar: Some(ProgressBar::hidden()), ..Self::default() }
    }

    /// What is being done and how far it is, 0 to 1; nothing before the first part of the work and after the last.
    pub fn now(&self) -> Option<(String, f64)> {
        let bar = self.bar.as_ref().filter(|bar| !bar.is_finished())?;
        let length = bar.length()?;
        Some((bar.message(), (bar.position() as f64 / length as f64).min(1.0)))
    }

    /// Begins a part of the work of `total` equal pieces, as in `start("reading log.csv", 3_600)`.
    pub fn start(&self, what: impl Into<String>, total: u64) {
        let Some(bar) = &self.bar else { return };
        let style = ProgressStyle::with_template("{msg:28!} {bar:32} {percent:>3} %  {eta:>5}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        // Also brings back a bar that was taken off the terminal.
        bar.reset();
        bar.set_message(what.into());
        bar.set_length(total.max(1));
        bar.reset_eta();
        bar.enable_steady_tick(Duration::from_millis(200));
    }

    /// Begins a part of the work whose progress is given in shares: by [`reach`](Self::reach) and [`part`](Self::part).
    pub fn start_shares(&self, what: impl Into<String>) {
        self.start(what, SHARES as u64);
    }

    /// A handle for a part of the work that this handle is about, from one share (0 to 1) to another.
    pub fn part(&self, part: Range<f64>) -> Self {
        let at = |share: f64| self.part.start + share * (self.part.end - self.part.start);
        Self { part: at(part.start)..at(part.end), ..self.clone() }
    }

    /// The `index`th of `count` equal parts.
    pub fn piece(&self, index: usize, count: usize) -> Self {
        self.part(index as f64 / count as f64..(index + 1) as f64 / count as f64)
    }

    /// `share` (0 to 1) of what this handle is about is done. The bar never goes back.
    pub fn reach(&self, share: f64) {
        if let Some(bar) = &self.bar {
            let position = (SHARES * self.part(share..1.0).part.start) as u64;
            bar.set_position(position.max(bar.position()));
        }
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
