//! Errors as Python exceptions, with the one-line messages of the programs.

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::fmt::Display;

create_exception!(wheelstate, Error, PyValueError, "What was asked for cannot be done; one line says why.");
create_exception!(wheelstate, LogError, Error, "A log cannot be read or used.");
create_exception!(
    wheelstate,
    Refused,
    Error,
    "Logs that no fit can be made of; `fit` holds what was read and what is wrong."
);

/// One line of text as an [`Error`].
pub fn error(what: impl Display) -> PyErr {
    Error::new_err(line(what))
}

/// One line of text as a [`LogError`].
pub fn log_error(what: impl Display) -> PyErr {
    LogError::new_err(line(what))
}

fn line(what: impl Display) -> String {
    what.to_string().replace(['\n', '\r'], " ")
}
