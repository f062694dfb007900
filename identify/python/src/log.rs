//! Logs.

use crate::error::{error, log_error};
use crate::{arrow, work};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule, PyDict};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wheelstate_identify::checked;
use wheelstate_identify::log::{ColumnMap, Input, Log as Inner, Samples as Content, TableColumn};
use wheelstate_identify::output::Outputs;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::vehicle::Vehicle;

/// A log: one time base and named channels, which never change.
#[pyclass(frozen, from_py_object, module = "wheelstate._native")]
#[derive(Clone)]
pub struct Log {
    pub inner: Arc<Inner>,
}

/// The memory of one channel of a log, for numpy.
#[pyclass(frozen, module = "wheelstate._native")]
pub struct Samples {
    log: Arc<Inner>,
    channel: Option<usize>,
}

#[pymethods]
impl Samples {
    /// numpy's array interface: the log's own memory, not to be written to.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values = match self.channel {
            Some(channel) => &self.log.channels[channel].values,
            None => &self.log.time,
        };
        let interface = PyDict::new(py);
        interface.set_item("shape", (values.len(),))?;
        interface.set_item("typestr", if cfg!(target_endian = "little") { "<f8" } else { ">f8" })?;
        interface.set_item("data", (values.as_ptr() as usize, true))?;
        interface.set_item("version", 3)?;
        Ok(interface)
    }
}

impl Log {
    pub fn new(log: Inner) -> Self {
        Self { inner: Arc::new(log) }
    }
}

#[pymethods]
impl Log {
    fn __len__(&self) -> usize {
        self.inner.len()
    }

    #[getter]
    fn source(&self) -> &str {
        &self.inner.source
    }

    #[getter]
    fn sha256(&self) -> &str {
        &self.inner.sha256
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.inner.notes.clone()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.channels.iter().map(|channel| channel.name.clone()).collect()
    }

    #[getter]
    fn period(&self) -> f64 {
        self.inner.period()
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.inner.duration()
    }

    fn samples(&self, name: &str) -> PyResult<Samples> {
        if name == "time" {
            return Ok(Samples { log: self.inner.clone(), channel: None });
        }
        match self.inner.channels.iter().position(|channel| channel.name == name) {
            channel @ Some(_) => Ok(Samples { log: self.inner.clone(), channel }),
            None => Err(PyKeyError::new_err(self.inner.require(name).err().map_or(String::new(), |e| e.to_string()))),
        }
    }

    /// The samples from one time to another, those in the excluded spans as missing.
    fn within(&self, span: (f64, f64), exclude: Vec<(f64, f64)>) -> PyResult<Self> {
        let mut log = (*self.inner).clone();
        checked::within(&mut log, span, &exclude).map_err(log_error)?;
        Ok(Self::new(log))
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let write = || -> Result<(), String> {
            Outputs::check(&path).map_err(|e| e.to_string())?;
            let mut outputs = Outputs::new();
            outputs.file(&path, |file| self.inner.write(&path, file)).map_err(|e| e.to_string())?;
            outputs.commit().map_err(|e| e.to_string())
        };
        py.detach(write).map_err(error)
    }

    /// All of it as few bytes, for pickling.
    fn packed<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &py.detach(|| self.inner.to_compact()))
    }

    /// From such bytes.
    #[staticmethod]
    fn unpacked(data: &[u8]) -> PyResult<Self> {
        Inner::from_compact("log", data).map(Self::new).map_err(log_error)
    }

    fn stream<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        arrow::export(py, &self.inner)
    }
}

/// How a log is to be read: a map as a file, or as JSON of the same shape, and the machine whose inputs it is for.
struct Reading {
    map: Option<ColumnMap>,
    inputs: Option<Vec<(String, &'static str)>>,
}

impl Reading {
    fn new(map: Option<PathBuf>, json: Option<&str>, vehicle: Option<&Vehicle>) -> PyResult<Self> {
        let map = match (map, json) {
            (Some(path), _) => Some(ColumnMap::read(&path).map_err(error)?),
            (None, Some(json)) => {
                let table: toml::Table = serde_json::from_str(json).map_err(|e| error(format!("columns: {e}")))?;
                let text = toml::to_string(&table).map_err(|e| error(format!("columns: {e}")))?;
                Some(ColumnMap::parse("columns", &text).map_err(error)?)
            }
            (None, None) => None,
        };
        let inputs =
            vehicle.map(|vehicle| vehicle.inputs().into_iter().map(|input| (input.name, input.unit)).collect());
        Ok(Self { map, inputs })
    }

    fn inputs(&self) -> Option<Vec<Input<'_>>> {
        Some(self.inputs.as_ref()?.iter().map(|(name, unit)| Input { name, unit }).collect())
    }

    fn file(&self, path: &Path, progress: &Progress) -> Result<Inner, wheelstate_identify::log::LogError> {
        match self.inputs() {
            Some(inputs) => Inner::read_inputs(path, self.map.as_ref(), &inputs, &|_| true, progress),
            None => Inner::read(path, self.map.as_ref(), progress),
        }
    }

    fn table(&self, name: &str, columns: Vec<TableColumn>) -> PyResult<Log> {
        let log = Inner::from_table(name, columns, self.map.as_ref(), self.inputs().as_deref());
        log.map(Log::new).map_err(log_error)
    }
}

/// Reads a file.
#[pyfunction]
#[pyo3(signature = (path, map, json, vehicle, tell))]
pub fn read(
    py: Python,
    path: PathBuf,
    map: Option<PathBuf>,
    json: Option<&str>,
    vehicle: Option<&str>,
    tell: Option<&Bound<PyAny>>,
) -> PyResult<Log> {
    let reading = Reading::new(map, json, vehicle.map(crate::names::vehicle).transpose()?)?;
    let log = work::run(py, tell, |progress| reading.file(&path, progress))?;
    log.map(Log::new).map_err(log_error)
}

/// A log from anything that gives an Arrow stream.
#[pyfunction]
#[pyo3(signature = (name, table, map, json, vehicle))]
pub fn from_arrow(
    name: &str,
    table: &Bound<PyAny>,
    map: Option<PathBuf>,
    json: Option<&str>,
    vehicle: Option<&str>,
) -> PyResult<Log> {
    let reading = Reading::new(map, json, vehicle.map(crate::names::vehicle).transpose()?)?;
    reading.table(name, arrow::import(table)?)
}

/// One column: its name, its numbers if it has any, whether they are times in s, and what it holds otherwise.
type PyColumn<'py> = (String, Option<Bound<'py, PyAny>>, bool, String);

/// A log from arrays of doubles.
#[pyfunction]
#[pyo3(signature = (name, columns, map, json, vehicle))]
pub fn from_columns(
    py: Python,
    name: &str,
    columns: Vec<PyColumn>,
    map: Option<PathBuf>,
    json: Option<&str>,
    vehicle: Option<&str>,
) -> PyResult<Log> {
    let reading = Reading::new(map, json, vehicle.map(crate::names::vehicle).transpose()?)?;
    let mut table = Vec::new();
    for (name, numbers, is_time, what) in columns {
        let samples = match numbers {
            None => Content::Other(what),
            Some(numbers) => {
                let values = PyBuffer::<f64>::get(&numbers)?.to_vec(py)?;
                if is_time { Content::Times(values) } else { Content::Numbers(values) }
            }
        };
        table.push(TableColumn { name, samples });
    }
    reading.table(name, table)
}
