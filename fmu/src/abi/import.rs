//! The other side of the boundary: an FMU's library loaded and called as a host would, for `pack verify`.

use super::types::{Boolean, Callbacks, Component, OK, Status};
use crate::model::Type;
use libloading::{Library, Symbol};
use std::ffi::{CString, c_char, c_int, c_uint};
use std::path::Path;

type Instantiate = unsafe extern "C" fn(
    *const c_char,
    c_uint,
    *const c_char,
    *const c_char,
    *const Callbacks,
    Boolean,
    Boolean,
) -> Component;
type Plain = unsafe extern "C" fn(Component) -> Status;
type Setup = unsafe extern "C" fn(Component, Boolean, f64, f64, Boolean, f64) -> Status;
type Step = unsafe extern "C" fn(Component, f64, f64, Boolean) -> Status;
type SetReal = unsafe extern "C" fn(Component, *const c_uint, usize, *const f64) -> Status;
type GetReal = unsafe extern "C" fn(Component, *const c_uint, usize, *mut f64) -> Status;
type GetWhole = unsafe extern "C" fn(Component, *const c_uint, usize, *mut c_int) -> Status;

/// An instance of a loaded FMU.
pub struct Imported {
    component: Component,
    library: Library,
}

impl Imported {
    /// Loads the library and instantiates the model of this GUID for co-simulation, without a logger.
    pub fn new(library: &Path, guid: &str, resources: &str) -> Result<Self, String> {
        let text = |text: &str| CString::new(text).map_err(|_| format!("'{}' has a NUL", text.escape_debug()));
        let (guid, resources) = (text(guid)?, text(resources)?);
        // SAFETY: loading runs the initialisers of a library that the user asked to have run.
        let loaded = unsafe { Library::new(library) };
        let loaded = loaded.map_err(|error| format!("{} cannot be loaded: {error}", library.display()))?;
        let mut imported = Self { component: std::ptr::null_mut(), library: loaded };
        let instantiate: Symbol<'_, Instantiate> = imported.function("fmi2Instantiate")?;
        // SAFETY: the function has this type by the standard; all strings end with NUL and outlive the call.
        let component =
            unsafe { instantiate(c"verify".as_ptr(), 1, guid.as_ptr(), resources.as_ptr(), std::ptr::null(), 0, 0) };
        imported.component = component;
        if component.is_null() { Err("fmi2Instantiate refuses".to_owned()) } else { Ok(imported) }
    }

    /// From the instance to the first communication point.
    pub fn start(&self, start: f64, stop: f64) -> Result<(), String> {
        let setup: Symbol<'_, Setup> = self.function("fmi2SetupExperiment")?;
        // SAFETY: the function has this type by the standard, and the component is alive.
        done("fmi2SetupExperiment", unsafe { setup(self.component, 0, 0.0, start, 1, stop) })?;
        self.call("fmi2EnterInitializationMode")
    }

    /// A function that takes the component alone.
    pub fn call(&self, name: &str) -> Result<(), String> {
        let function: Symbol<'_, Plain> = self.function(name)?;
        // SAFETY: as above.
        done(name, unsafe { function(self.component) })
    }

    /// Sets Real inputs.
    pub fn set(&self, references: &[u32], values: &[f64]) -> Result<(), String> {
        let function: Symbol<'_, SetReal> = self.function("fmi2SetReal")?;
        let count = references.len().min(values.len());
        // SAFETY: as above; there are `count` references and values.
        done("fmi2SetReal", unsafe { function(self.component, references.as_ptr(), count, values.as_ptr()) })
    }

    /// Reads a variable of any type.
    pub fn get(&self, class: Type, reference: u32) -> Result<f64, String> {
        let (mut real, mut whole) = (0.0, 0);
        let name = match class {
            Type::Real => "fmi2GetReal",
            Type::Integer => "fmi2GetInteger",
            Type::Boolean => "fmi2GetBoolean",
        };
        if class == Type::Real {
            let function: Symbol<'_, GetReal> = self.function(name)?;
            // SAFETY: as above; there is one reference and room for one value.
            done(name, unsafe { function(self.component, &reference, 1, &mut real) })?;
            return Ok(real);
        }
        let function: Symbol<'_, GetWhole> = self.function(name)?;
        // SAFETY: as above.
        done(name, unsafe { function(self.component, &reference, 1, &mut whole) })?;
        Ok(f64::from(whole))
    }

    /// One communication step.
    pub fn step(&self, point: f64, size: f64) -> Result<(), String> {
        let function: Symbol<'_, Step> = self.function("fmi2DoStep")?;
        // SAFETY: as above.
        done("fmi2DoStep", unsafe { function(self.component, point, size, 1) })
    }

    fn function<T>(&self, name: &str) -> Result<Symbol<'_, T>, String> {
        // SAFETY: the caller names the type that FMI 2.0 gives this function.
        unsafe { self.library.get(name.as_bytes()) }.map_err(|error| format!("{name}: {error}"))
    }
}

impl Drop for Imported {
    fn drop(&mut self) {
        if let Ok(free) = self.function::<unsafe extern "C" fn(Component)>("fmi2FreeInstance") {
            // SAFETY: the component is this library's own, or NULL, and is not used any more.
            unsafe { free(self.component) }
        }
    }
}

fn done(function: &str, status: Status) -> Result<(), String> {
    if status == OK { Ok(()) } else { Err(format!("{function} gives status {status}")) }
}
