//! Long work beside the interpreter.
//!
//! The work runs on a thread of its own. The thread that asked for it lets go of the interpreter's lock, and looks now
//! and then whether a signal came (Ctrl-C stops the work) and tells how far the work is.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;
use wheelstate_identify::progress::Progress;

/// Between two looks.
const LOOK: Duration = Duration::from_millis(100);
/// What a parse of deep structures may need.
const STACK: usize = 16 << 20;

/// Runs `job`; `tell`, if it is not `None`, is called with words and a share from 0 to 1 while it runs.
pub fn run<T: Send>(py: Python, tell: Option<&Bound<PyAny>>, job: impl FnOnce(&Progress) -> T + Send) -> PyResult<T> {
    let progress = Progress::silent();
    let over = AtomicBool::new(false);
    let asking = thread::current();
    thread::scope(|scope| {
        let (progress, over) = (&progress, &over);
        let work = move || {
            let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| job(progress)));
            over.store(true, Ordering::Release);
            asking.unpark();
            result
        };
        let worker = thread::Builder::new().stack_size(STACK).spawn_scoped(scope, work)?;
        let mut wrong = None;
        while !over.load(Ordering::Acquire) {
            py.detach(|| thread::park_timeout(LOOK));
            if wrong.is_none() && !over.load(Ordering::Acquire) {
                wrong = look(py, tell, progress).err();
                if wrong.is_some() {
                    progress.stop();
                }
            }
        }
        match (wrong, py.detach(|| worker.join())) {
            (Some(error), _) => Err(error),
            (None, Ok(Ok(result))) => Ok(result),
            (None, _) => Err(PyRuntimeError::new_err("wheelstate failed; this is a bug of it")),
        }
    })
}

/// Whether a signal came; tells how far the work is.
fn look(py: Python, tell: Option<&Bound<PyAny>>, progress: &Progress) -> PyResult<()> {
    py.check_signals()?;
    if let (Some(tell), Some((what, share))) = (tell, progress.now()) {
        tell.call1((what, share))?;
    }
    Ok(())
}
