//! The signals of a fit's logs: kept if they are few, and of many or long logs read again for each equation, one block after
//! the other.

use super::rows::{self, Body, Signals, Windows};
pub use super::signals::Look;
use super::signals::{Has, Scope, signals_of};
use super::sway::{self, Passive};
use super::{COARSE_OVERLAP, SWAY, modulating_function};
use crate::log::Log;
use crate::problem::blocks::Block;
use crate::problem::noise::noise_of;
use crate::problem::weak_form::ModulatingFunction;
use crate::problem::{FitError, Task};
use crate::progress::Progress;
use std::cell::{OnceCell, RefCell};
use std::sync::Arc;

/// Samples that tell the period of a log.
const FEW: usize = 1 << 16;

/// A modulating function and the signals it goes over: of a log, or of a block of a long one.
pub(in super::super) struct Windowed {
    pub signals: Signals,
    pub sway: Arc<ModulatingFunction>,
    pub block: Block,
    overlap: usize,
    speed_noise: OnceCell<f64>,
}

impl Windowed {
    pub fn windows<'a>(&'a self, psi: &'a ModulatingFunction, progress: Progress) -> Windows<'a> {
        let stride = stride(psi, self.overlap);
        Windows { signals: &self.signals, psi, stride, cluster: self.overlap, progress }
    }

    pub fn sway(&self, progress: Progress) -> Windows<'_> {
        self.windows(&self.sway, progress)
    }

    /// Standard deviation of the speed's white noise, m/s, which all equations have in them.
    pub fn speed_noise(&self) -> f64 {
        *self.speed_noise.get_or_init(|| noise_of(&self.signals.speed))
    }
}

fn stride(psi: &ModulatingFunction, overlap: usize) -> usize {
    ((psi.len() - 1) / overlap).max(1)
}

/// The logs of a task.
pub(in super::super) struct Sources<'a> {
    task: &'a Task<'a>,
    blocks: Vec<Block>,
    /// Which channels each log has.
    has: Vec<Has>,
    /// All signals, if they are few.
    kept: Vec<Windowed>,
    overlap: usize,
    /// Whether what roll adds while turning is of interest.
    turning: bool,
    /// With what the sway of logs without tilt is worked out.
    passive: Option<(Body, Passive)>,
    /// The last modulating function: pieces of a log, and logs of one recorder, have one period.
    sway: RefCell<Option<(f64, Arc<ModulatingFunction>)>>,
}

impl<'a> Sources<'a> {
    /// Of `turning` see [`Windows::turning`].
    pub fn new(task: &'a Task, turning: bool) -> Result<Self, FitError> {
        let overlap = if task.coarse { COARSE_OVERLAP } else { rows::OVERLAP };
        // The steps of a few samples are those of all of them, all but exactly.
        let psi_of = |log: &Log| {
            let (_, period) = log.slice(0..log.len().min(FEW), |_| false).on_even_steps();
            modulating_function(period, SWAY)
        };
        let windows = |log: &Log| {
            let psi = psi_of(log);
            let stride = stride(&psi, overlap);
            (stride * overlap, psi.len() - stride)
        };
        let few = task.logs.iter().map(Log::len).sum::<usize>() < task.long;
        let mut all = Self {
            task,
            blocks: Block::cut(task.logs, task.long, windows),
            has: Vec::new(),
            kept: Vec::new(),
            overlap,
            turning,
            passive: None,
            sway: RefCell::default(),
        };
        if few {
            all.kept = all.blocks.iter().map(|block| all.read(block, Look::All)).collect::<Result<_, _>>()?;
            all.has = all.kept.iter().map(|log| Has::of_signals(&log.signals)).collect();
        } else {
            all.has = task.logs.iter().map(Has::of).collect();
        }
        Ok(all)
    }

    /// Number of logs.
    pub fn logs(&self) -> usize {
        self.task.logs.len()
    }

    /// Which channels the log has that signals are of.
    pub fn has(&self, of: &Windowed) -> &Has {
        &self.has[of.block.log]
    }

    /// Whether some log has a channel.
    pub fn some_has(&self, of: impl Fn(&Has) -> bool) -> bool {
        self.has.iter().any(of)
    }

    /// Whether all logs have a channel.
    pub fn all_have(&self, of: impl Fn(&Has) -> bool) -> bool {
        self.has.iter().all(of)
    }

    /// From now on logs without tilt have the pitch of a passive person.
    pub fn sway_by(&mut self, body: &Body, hip: &Passive) {
        self.passive = Some((*body, *hip));
        self.kept.iter_mut().for_each(|log| sways(&mut log.signals, body, hip));
    }

    /// Does something with each log, or with each block of the long ones, in order. Signals that are not looked at may be missing.
    pub fn each(
        &self,
        look: Look,
        progress: &Progress,
        mut of: impl FnMut(&Windowed, Progress),
    ) -> Result<(), FitError> {
        for (index, block) in self.blocks.iter().enumerate() {
            let part = progress.piece(index, self.blocks.len());
            match self.kept.get(index) {
                Some(kept) => of(kept, part),
                None => of(&self.read(block, look)?, part),
            }
        }
        Ok(())
    }

    fn read(&self, block: &Block, look: Look) -> Result<Windowed, FitError> {
        let scope = Scope { look, turning: self.turning, has: self.has.get(block.log) };
        let mut signals = signals_of(&block.of(self.task.logs), self.task.known, scope)?;
        if let Some((body, hip)) = &self.passive {
            sways(&mut signals, body, hip);
        }
        let before = self.sway.borrow().clone();
        let sway = match before {
            Some((period, sway)) if period == signals.period => sway,
            _ => Arc::new(modulating_function(signals.period, SWAY)),
        };
        *self.sway.borrow_mut() = Some((signals.period, Arc::clone(&sway)));
        Ok(Windowed { signals, sway, block: block.clone(), overlap: self.overlap, speed_noise: OnceCell::new() })
    }
}

/// The sway force of a log without tilt comes from the passive model driven by the measured speed.
fn sways(signals: &mut Signals, body: &Body, hip: &Passive) {
    if signals.pitch.is_empty() && body.j > 0.0 {
        signals.pitch = sway::pitch_from_speed(signals, body, hip).into();
    }
}
