//! Get, set and serialise the state of an instance.
//!
//! The host's handles are numbers, never addresses, and no number is used twice: a stale or foreign
//! handle is recognised without touching memory.
//!
//! Serialised: `"WSFMU"`, format version, the FMU's GUID, the length of the content, the content
//! (postcard), and the first 16 bytes of the SHA-256 of all that.

use crate::instance::{Answer, Core, Instance, Refusal};
use crate::machine::Saved;
use crate::model::check_parameter;
use crate::phase::Phase;
use sha2::{Digest, Sha256};

/// The state of an instance: nothing in it points anywhere.
#[derive(Default)]
struct Snapshot {
    core: Option<Core>,
    state: Option<Saved>,
}

/// The states that a host holds of one instance.
#[derive(Default)]
pub struct Snapshots {
    last: usize,
    held: Vec<(usize, Snapshot)>,
}

const MAGIC: &[u8; 5] = b"WSFMU";
const VERSION: u8 = 1;
const CHECKSUM: usize = 16;

impl Snapshots {
    /// Whether `handle` is held.
    pub fn contains(&self, handle: usize) -> bool {
        self.held.iter().any(|(number, _)| *number == handle)
    }

    fn find(&self, handle: usize) -> Answer<&Snapshot> {
        let found = self.held.iter().find(|(number, _)| *number == handle);
        found.map(|(_, snapshot)| snapshot).ok_or_else(|| foreign(handle))
    }

    /// The snapshot of `handle` to be overwritten, or a new one if `handle` is 0.
    fn slot(&mut self, handle: usize) -> Answer<(usize, &mut Snapshot)> {
        let index = if handle == 0 {
            // steps of 64 look like addresses to a host that checks their alignment
            self.last += 64;
            self.held.push((self.last, Snapshot::default()));
            self.held.len() - 1
        } else {
            self.held.iter().position(|(number, _)| *number == handle).ok_or_else(|| foreign(handle))?
        };
        let (number, snapshot) = &mut self.held[index];
        Ok((*number, snapshot))
    }
}

fn foreign(handle: usize) -> Refusal {
    Refusal::error(format!("{handle} is not an FMU state of this instance; it was freed, or is another instance's"))
}

impl Instance {
    /// `fmi2GetFMUstate`; overwrites the state of `handle` unless that is 0.
    pub fn get_state(&mut self, handle: usize) -> Answer<usize> {
        self.settle();
        let (number, snapshot) = self.snapshots.slot(handle)?;
        self.machine.held(&mut self.core.held);
        match &mut snapshot.core {
            Some(core) => core.clone_from(&self.core),
            None => snapshot.core = Some(self.core.clone()),
        }
        self.machine.save(&mut snapshot.state);
        Ok(number)
    }

    /// `fmi2SetFMUstate`
    pub fn set_state(&mut self, handle: usize) -> Answer<()> {
        let snapshot = self.snapshots.find(handle)?;
        let Some(core) = &snapshot.core else { return Err(foreign(handle)) };
        // a stale estimator is built anew from the parameters
        if let Some(state) = snapshot.state.as_ref().filter(|_| !core.stale) {
            // parameters that differ call for an estimator of their own; the present one is kept until it stands
            if self.period == 0.0 || self.core.stale || self.core.parameters != core.parameters {
                let mut machine = self.model().machine();
                machine.build(&core.parameters).map_err(|error| Refusal::error(error.to_string()))?;
                machine.load(state).map_err(|error| Refusal::error(error.to_string()))?;
                self.period = machine.sample_period();
                self.machine = machine;
            } else {
                self.machine.load(state).map_err(|error| Refusal::error(error.to_string()))?;
            }
        }
        self.core.clone_from(core);
        self.unread = false;
        self.machine.hold(&core.held);
        Ok(())
    }

    /// `fmi2FreeFMUstate`
    pub fn free_state(&mut self, handle: usize) -> Answer<()> {
        self.snapshots.find(handle)?;
        self.snapshots.held.retain(|(number, _)| *number != handle);
        Ok(())
    }

    /// `fmi2SerializeFMUstate`
    pub fn serialize_state(&self, handle: usize) -> Answer<Vec<u8>> {
        let snapshot = self.snapshots.find(handle)?;
        let failed = |_| Refusal::error("the FMU state cannot be serialised");
        let state = match &snapshot.state {
            Some(state) => Some(self.machine.encode(state).map_err(|error| Refusal::error(error.to_string()))?),
            None => None,
        };
        let content = postcard::to_stdvec(&(&snapshot.core, state)).map_err(failed)?;
        let mut bytes = Vec::with_capacity(content.len() + 80);
        bytes.extend_from_slice(MAGIC);
        bytes.push(VERSION);
        bytes.extend_from_slice(self.guid().as_bytes());
        bytes.extend_from_slice(&(content.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&content);
        let checksum = Sha256::digest(&bytes);
        bytes.extend_from_slice(&checksum[..CHECKSUM]);
        Ok(bytes)
    }

    /// `fmi2DeSerializeFMUstate`; overwrites the state of `handle` unless that is 0. What it accepts
    /// can be set without any further check.
    pub fn deserialize_state(&mut self, bytes: &[u8], handle: usize) -> Answer<usize> {
        let content = open(bytes, self.guid())?;
        let garbled = |_| Refusal::error("the serialised FMU state is corrupt: its content cannot be read");
        let ((core, state), rest) =
            postcard::take_from_bytes::<(Option<Core>, Option<Vec<u8>>)>(content).map_err(garbled)?;
        let Some(core) = core.filter(|_| rest.is_empty()) else {
            return Err(Refusal::error("the serialised FMU state is corrupt: it has no content"));
        };
        self.check_core(&core, state.is_some())?;
        let state = match state {
            Some(bytes) => {
                let state = self.machine.decode(&core.parameters, &bytes);
                Some(state.map_err(|error| Refusal::error(error.to_string()))?)
            }
            None => None,
        };
        let (number, snapshot) = self.snapshots.slot(handle)?;
        *snapshot = Snapshot { core: Some(core), state };
        Ok(number)
    }

    fn check_core(&self, core: &Core, has_state: bool) -> Answer<()> {
        let model = self.model();
        let corrupt = |what: &str| Err(Refusal::error(format!("the serialised FMU state is corrupt: {what}")));
        let [parameters, inputs, outputs] = [&model.parameters, &model.inputs, &model.outputs].map(Vec::len);
        let sizes = core.parameters.len() == parameters
            && [&core.inputs, &core.slopes, &core.held].iter().all(|list| list.len() == inputs)
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
        if !core.clock.is_sound() || core.slopes.iter().any(|slope| !slope.is_finite()) {
            return corrupt("it has a time or derivative that is not finite");
        }
        Ok(())
    }
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
