//! Copied and serialised states of an instance.
//!
//! The host's handles are numbers, never addresses, and no number is used twice: a stale or foreign
//! handle is recognised without touching memory.
//!
//! Serialised: `"WSFMU"`, format version, the FMU's GUID, the length of the content, the content
//! (postcard), and the first 16 bytes of the SHA-256 of all that.

use crate::clock::Clock;
use crate::handle;
use crate::machine::{Machine, Saved};
use crate::model::{Model, check_parameter};
use crate::phase::Phase;
use crate::refusal::{Answer, Refusal};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Everything of an instance that changes, except the estimator's own state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Core {
    pub(crate) phase: Phase,
    pub(crate) clock: Clock,
    pub(crate) stop: Option<f64>,
    pub(crate) parameters: Vec<f64>,
    pub(crate) inputs: Vec<f64>,
    /// Which inputs the host has set.
    pub(crate) given: Vec<bool>,
    /// Time derivatives of the inputs, for the next step only.
    pub(crate) slopes: Vec<f64>,
    pub(crate) sloped: bool,
    /// The inputs of the last sample, brought up to date when the state is copied.
    pub(crate) held: Vec<f64>,
    pub(crate) outputs: Vec<f64>,
    /// The parameters have changed since the estimator was built.
    pub(crate) stale: bool,
}

/// The state of an instance: nothing in it points anywhere.
struct Snapshot {
    handle: usize,
    core: Core,
    state: Option<Saved>,
}

/// The states that a host holds of one instance.
#[derive(Default)]
pub struct Snapshots(Vec<Snapshot>);

const MAGIC: &[u8; 5] = b"WSFMU";
/// 2: the copy always has a core, and says which inputs were set.
const VERSION: u8 = 2;
const CHECKSUM: usize = 16;

impl Snapshots {
    fn position(&self, handle: usize) -> Answer<usize> {
        let found = self.0.iter().position(|snapshot| snapshot.handle == handle);
        let foreign = "is not an FMU state of this instance; it was freed, or is another instance's";
        found.ok_or_else(|| Refusal::error(format!("{handle:#x} {foreign}")))
    }

    /// The copy of this handle.
    pub fn find(&self, handle: usize) -> Answer<(&Core, Option<&Saved>)> {
        let snapshot = &self.0[self.position(handle)?];
        Ok((&snapshot.core, snapshot.state.as_ref()))
    }

    /// Copies the state of an instance into the copy of `handle`, or into a new one if that is 0.
    pub fn copy(&mut self, handle: usize, core: &Core, machine: &dyn Machine) -> Answer<usize> {
        let index = if handle == 0 {
            self.0.push(Snapshot { handle: handle::unique(), core: core.clone(), state: None });
            self.0.len() - 1
        } else {
            let index = self.position(handle)?;
            self.0[index].core.clone_from(core);
            index
        };
        let snapshot = &mut self.0[index];
        machine.save(&mut snapshot.state);
        Ok(snapshot.handle)
    }

    /// Drops the copy of this handle.
    pub fn free(&mut self, handle: usize) -> Answer<()> {
        let index = self.position(handle)?;
        self.0.swap_remove(index);
        Ok(())
    }

    /// The copy of this handle as bytes.
    pub fn serialize(&self, handle: usize, guid: &str, machine: &dyn Machine) -> Answer<Vec<u8>> {
        let (core, state) = self.find(handle)?;
        let failed = |_| Refusal::error("the FMU state cannot be serialised");
        let state = match state {
            Some(state) => Some(machine.encode(state).map_err(|error| Refusal::error(error.to_string()))?),
            None => None,
        };
        let content = postcard::to_stdvec(&(core, state)).map_err(failed)?;
        let mut bytes = Vec::with_capacity(content.len() + 80);
        bytes.extend_from_slice(MAGIC);
        bytes.push(VERSION);
        bytes.extend_from_slice(guid.as_bytes());
        bytes.extend_from_slice(&(content.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&content);
        let checksum = Sha256::digest(&bytes);
        bytes.extend_from_slice(&checksum[..CHECKSUM]);
        Ok(bytes)
    }

    /// Reads bytes into the copy of `handle`, or into a new one if that is 0. What it accepts can be restored without
    /// any further check.
    pub fn deserialize(
        &mut self,
        bytes: &[u8],
        handle: usize,
        model: &Model,
        guid: &str,
        machine: &dyn Machine,
    ) -> Answer<usize> {
        let index = if handle == 0 { None } else { Some(self.position(handle)?) };
        let content = open(bytes, guid)?;
        let corrupt = |why: &str| Refusal::error(format!("the serialised FMU state is corrupt: {why}"));
        let ((core, state), rest) = postcard::take_from_bytes::<(Core, Option<Vec<u8>>)>(content)
            .map_err(|_| corrupt("its content cannot be read"))?;
        if !rest.is_empty() {
            return Err(corrupt("something follows its content"));
        }
        check_core(model, &core, state.is_some())?;
        let state = match state {
            Some(bytes) => {
                let state = machine.decode(&core.parameters, &bytes);
                Some(state.map_err(|error| Refusal::error(error.to_string()))?)
            }
            None => None,
        };
        let handle = if handle == 0 { handle::unique() } else { handle };
        let snapshot = Snapshot { handle, core, state };
        match index {
            Some(index) => self.0[index] = snapshot,
            None => self.0.push(snapshot),
        }
        Ok(handle)
    }
}

/// Refuses what no instance of the model can hold.
fn check_core(model: &Model, core: &Core, has_state: bool) -> Answer<()> {
    let corrupt = |what: &str| Err(Refusal::error(format!("the serialised FMU state is corrupt: {what}")));
    let [parameters, inputs, outputs] = [&model.parameters, &model.inputs, &model.outputs].map(Vec::len);
    let sizes = core.parameters.len() == parameters
        && [&core.inputs, &core.slopes, &core.held].iter().all(|list| list.len() == inputs)
        && core.given.len() == inputs
        && core.outputs.len() == outputs;
    if !sizes {
        return corrupt("it has another number of variables");
    }
    for (variable, value) in model.parameters.iter().zip(&core.parameters) {
        check_parameter(variable, *value).map_err(Refusal::error)?;
    }
    let built = matches!(core.phase, Phase::Stepping | Phase::Terminated);
    if core.phase == Phase::Fatal || (built && (!has_state || core.stale)) {
        return corrupt("its phase does not fit its content");
    }
    if !core.clock.is_sound(model.sample_period_among(&core.parameters)) || core.stop.is_some_and(f64::is_nan) {
        return corrupt("it has a time that no clock can have");
    }
    let mut inputs = model.inputs.iter().zip(core.inputs.iter().zip(&core.held));
    let sound = inputs.all(|(variable, (set, held))| {
        variable.may_be_missing() || (check_parameter(variable, *set).is_ok() && held.is_finite())
    });
    if !sound || core.slopes.iter().chain(&core.outputs).any(|value| !value.is_finite()) {
        return corrupt("it has a value that is not finite");
    }
    Ok(())
}

/// The content of a serialised state of the FMU with this GUID.
fn open<'a>(bytes: &'a [u8], guid: &str) -> Answer<&'a [u8]> {
    let refuse = |why: String| Err(Refusal::error(format!("the serialised FMU state is refused: {why}")));
    let Some(rest) = bytes.strip_prefix(MAGIC.as_slice()) else {
        return refuse("it was not written by this kind of FMU".to_owned());
    };
    match rest.first() {
        Some(&VERSION) => {}
        Some(other) => return refuse(format!("its format version is {other}, this library reads {VERSION}")),
        None => return refuse("it is cut off".to_owned()),
    }
    let Some(rest) = rest[1..].strip_prefix(guid.as_bytes()) else {
        return refuse(format!("it is not from the FMU with the GUID {guid}"));
    };
    let Some((length, rest)) = rest.split_first_chunk::<8>() else {
        return refuse("it is cut off".to_owned());
    };
    let length = u64::from_le_bytes(*length);
    if rest.len() < CHECKSUM || length != (rest.len() - CHECKSUM) as u64 {
        return refuse(format!("it has {} bytes of content instead of {length}", rest.len().saturating_sub(CHECKSUM)));
    }
    let (content, checksum) = rest.split_at(rest.len() - CHECKSUM);
    if Sha256::digest(&bytes[..bytes.len() - CHECKSUM])[..CHECKSUM] != *checksum {
        return refuse("its checksum is wrong, so it was altered".to_owned());
    }
    Ok(content)
}
