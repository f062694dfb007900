//! Arrays of any length in serde (`#[serde(with = ...)]`).

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// Writes the array as a list.
pub fn serialize<S: Serializer, const D: usize>(array: &[f64; D], serializer: S) -> Result<S::Ok, S::Error> {
    array.as_slice().serialize(serializer)
}

/// Reads a list of exactly the array's length.
pub fn deserialize<'a, T: Deserializer<'a>, const D: usize>(deserializer: T) -> Result<[f64; D], T::Error> {
    let list = Vec::<f64>::deserialize(deserializer)?;
    list.try_into().map_err(|_| T::Error::custom("array of another length"))
}
