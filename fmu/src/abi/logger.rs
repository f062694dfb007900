//! Messages to the host.

use super::types::{Callbacks, DISCARD, ERROR, FATAL, LoggerCallback, OK, Status};
use crate::describe::CATEGORIES;
use crate::refusal::{Level, Refusal};
use std::ffi::{CStr, CString, c_void};

/// Place of `logEvents` among the categories.
const EVENTS: usize = 3;

/// Sends messages of the wanted categories. On the success path nothing is sent unless the host
/// turned logging on: some hosts hand out loggers that outlive their use.
#[derive(Clone)]
pub(super) struct Logger {
    callback: Option<LoggerCallback>,
    environment: *mut c_void,
    name: CString,
    wanted: [bool; CATEGORIES.len()],
}

impl Logger {
    /// A logger over a copy of the host's callbacks.
    pub fn new(callbacks: Option<&Callbacks>, name: &CStr, logging: bool) -> Self {
        Self {
            callback: callbacks.and_then(|callbacks| callbacks.logger),
            environment: callbacks.map_or(std::ptr::null_mut(), |callbacks| callbacks.environment),
            name: name.to_owned(),
            wanted: defaults(logging),
        }
    }

    /// `fmi2SetDebugLogging`: off means the default, on without categories means all.
    pub fn choose(&mut self, logging: bool, categories: &[&CStr]) -> Result<(), Refusal> {
        if !logging || categories.is_empty() {
            self.wanted = defaults(logging);
            return Ok(());
        }
        let mut wanted = [false; CATEGORIES.len()];
        for name in categories {
            let Some(index) = CATEGORIES.iter().position(|(known, _)| known == name) else {
                let known: Vec<_> = CATEGORIES.iter().map(|(known, _)| known.to_string_lossy()).collect();
                let text =
                    format!("there is no log category '{}'; there are {}", name.to_string_lossy(), known.join(", "));
                return Err(Refusal::error(text));
            };
            wanted[index] = true;
        }
        self.wanted = wanted;
        Ok(())
    }

    /// Reports a refused call and gives its status.
    pub fn refuse(&self, function: &str, refusal: &Refusal) -> Status {
        let (status, category) = match refusal.level {
            Level::Error => (ERROR, 0),
            Level::Fatal => (FATAL, 1),
            Level::Discard => (DISCARD, 2),
        };
        self.send(status, category, &format!("{function}: {}", refusal.message));
        status
    }

    /// Reports an event, whose text is made only if someone wants it.
    pub fn event(&self, text: impl FnOnce() -> String) {
        if self.wanted[EVENTS] && self.callback.is_some() {
            self.send(OK, EVENTS, &text());
        }
    }

    fn send(&self, status: Status, category: usize, message: &str) {
        let Some(callback) = self.callback.filter(|_| self.wanted[category]) else { return };
        // The host formats the message: no argument must be asked for, and '#' starts a reference.
        let message = message.replace('\0', "").replace('%', "%%").replace('#', "##");
        let Ok(message) = CString::new(message) else { return };
        let (category, _) = CATEGORIES[category];
        // SAFETY: the callback and its environment are the host's own, valid until the instance is
        // freed; all strings end with NUL and outlive the call; the format asks for no argument.
        unsafe { callback(self.environment, self.name.as_ptr(), status, category.as_ptr(), message.as_ptr()) }
    }
}

// SAFETY: the environment is a number that is handed back to the host's own callback; which thread calls it is the
// choice of the host, which may use an instance from any thread, one at a time (FMI 2.0, 2.1.5).
unsafe impl Send for Logger {}

fn defaults(logging: bool) -> [bool; CATEGORIES.len()] {
    let mut wanted = [true; CATEGORIES.len()];
    wanted[EVENTS] = logging;
    wanted
}
