//! Any content of a serialised state under a right checksum, as a host or an attacker could sign it anew: it is refused,
//! or the instance steps on with finite outputs.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};
use wheelstate_fmu::instance::Instance;
use wheelstate_fmu::model::{Place, Type, models};

fuzz_target!(|data: (u8, Vec<(u16, u8)>)| {
    let (number, edits) = data;
    let list = models(&|_| true);
    let model = &list[usize::from(number) % list.len()];
    let period = model.sample_period();
    let mut instance = Instance::new(model.clone(), "{guid}");
    instance.enter_initialization();
    assert!(instance.exit_initialization().is_ok());
    for k in 0..5 {
        assert!(instance.do_step(f64::from(k) * period, period).is_ok());
    }
    let Ok(handle) = instance.get_state(0) else { return };
    let Ok(mut bytes) = instance.serialize_state(handle) else { return };
    // after the magic, the version, the GUID and the length; before the checksum
    let (first, last) = (5 + 1 + 6 + 8, bytes.len() - 16);
    for (at, value) in edits.iter().take(8) {
        let at = first + usize::from(*at) % (last - first);
        bytes[at] = *value;
    }
    let checksum = Sha256::digest(&bytes[..last]);
    bytes[last..].copy_from_slice(&checksum[..16]);
    let Ok(copy) = instance.deserialize_state(&bytes, 0) else { return };
    assert!(instance.set_state(copy).is_ok(), "what was read can be restored");
    for _ in 0..3 {
        let now = instance.time();
        if instance.do_step(now, 1.7 * period).is_err() {
            return;
        }
        for (i, variable) in model.outputs.iter().enumerate() {
            if Type::of(variable.kind) == Type::Real {
                let read = instance.get(Type::Real, &[Place::Output(i).reference()], |_, value| {
                    assert!(value.is_finite(), "{} = {value}", variable.name);
                });
                assert!(read.is_ok());
            }
        }
    }
});
