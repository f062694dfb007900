//! The GUID of an FMU, made from its content: `{nnnnnnnn-iiii-iiii-ssss-ssssssssssss}`.
//!
//! `n` is a hash of the model's name, `i` one of its interface (the XML without GUID and without the
//! parameters' start values) and `s` one of those start values. So the library finds the model
//! without looking at the others, refuses an XML of another version, and knows whether the FMU was
//! packed with start values of its own, which it then looks for.

use super::start_values;
use crate::model::{Catalogue, Model};
use sha2::{Digest, Sha256};
use std::sync::{Mutex, PoisonError};

/// The GUID of a model with its present start values.
pub fn of(model: &Model) -> String {
    format!("{{{}-{}-{}}}", name_part(model.name), interface_part(interface_hash(model)), start_part(model))
}

fn hex(digest: &[u8], digits: usize) -> String {
    let nibbles = digest.iter().flat_map(|byte| [byte >> 4, byte & 15]).take(digits);
    nibbles.map(|nibble| char::from_digit(nibble.into(), 16).unwrap_or('0')).collect()
}

fn name_part(name: &str) -> String {
    hex(&Sha256::digest(name), 8)
}

fn interface_part(hash: u32) -> String {
    format!("{:04x}-{:04x}", hash >> 16, hash & 0xffff)
}

fn interface_hash(model: &Model) -> u32 {
    let digest = Sha256::digest(super::write(model, "", false));
    u32::from_be_bytes([digest[0], digest[1], digest[2], digest[3]])
}

/// [`interface_hash`] of a model as its estimator declares it, which every instance has: worked out once, since writing
/// the XML takes longer than all else that makes an instance. What it is kept in takes no memory that unloading the
/// library would lose.
fn declared_interface_hash(model: &Model) -> u32 {
    const UNUSED: (usize, u32) = (0, 0);
    static KNOWN: Mutex<[(usize, u32); 8]> = Mutex::new([UNUSED; 8]);
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let key = model.type_key();
    if let Some((_, hash)) = known().iter().find(|(other, _)| *other == key) {
        return *hash;
    }
    let hash = interface_hash(model);
    if let Some(place) = known().iter_mut().find(|place| **place == UNUSED) {
        *place = (key, hash);
    }
    hash
}

fn start_part(model: &Model) -> String {
    let starts: Vec<u8> = model.parameters.iter().flat_map(|variable| variable.start.to_bits().to_le_bytes()).collect();
    let text = hex(&Sha256::digest(&starts), 16);
    format!("{}-{}", &text[..4], &text[4..])
}

/// The model that a GUID names, with the start values it was packed with.
pub fn find(catalogue: Catalogue, guid: &str, resource_location: Option<&str>) -> Result<Model, String> {
    let parts: Vec<_> = guid.trim_start_matches('{').trim_end_matches('}').split('-').collect();
    let [name, interface @ .., _, _] = parts.as_slice() else {
        return Err(format!("the GUID '{guid}' is not one of this library"));
    };
    let Some(mut model) = catalogue(&|known| name_part(known) == *name).pop() else {
        return Err(format!("the GUID '{guid}' belongs to no model of this library"));
    };
    let own = interface_part(declared_interface_hash(&model));
    if interface.join("-") != own {
        let version = env!("CARGO_PKG_VERSION");
        return Err(format!(
            "the GUID '{guid}' is of another version of {}; this is wheelstate {version} with {}",
            model.name,
            of(&model)
        ));
    }
    let fits = |model: &Model| guid == format!("{{{name}-{own}-{}}}", start_part(model));
    if fits(&model) {
        return Ok(model);
    }
    start_values::load(&mut model, guid, resource_location)?;
    if fits(&model) {
        return Ok(model);
    }
    Err(format!("the start values that this FMU was packed with do not belong to the GUID '{guid}'"))
}
