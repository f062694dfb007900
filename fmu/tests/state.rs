//! Copied, restored and serialised states.
#![allow(unsafe_code)]

use crate::support::host::{Host, last_message};
use crate::support::random;
use proptest::prelude::*;
use std::ptr::null_mut;
use wheelstate_fmu::abi::*;

const PERIOD: f64 = 0.01;

/// What a host can see.
fn seen(host: &Host) -> (u64, u64, u64, i32, i32) {
    let bits = |name| host.get(name).to_bits();
    (bits("position"), bits("position_std"), bits("drive_sum"), host.get_integer("count"), host.get_integer("status"))
}

/// One step with inputs that depend on the time alone.
fn go(host: &Host, size: f64) {
    let t = host.time();
    host.set("signal", if (t * 7.0).fract() < 0.2 { f64::NAN } else { t.sin() });
    host.set("drive", (2.0 * t).cos());
    host.slope("drive", -0.7);
    assert_eq!(host.step(t, size), OK, "{}", last_message());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rolling_back_repeats_every_bit(seed in any::<u64>(), start in -10.0..1e4_f64) {
        let mut seed = seed;
        let host = Host::started(start);
        let mut state = null_mut();
        for _ in 0..8 {
            let sizes: Vec<f64> = (0..6).map(|_| PERIOD * 10.0 * random(&mut seed) + 1e-6).collect();
            assert_eq!(host.get_state(&mut state), OK);
            let first: Vec<_> = sizes.iter().map(|size| { go(&host, *size); seen(&host) }).collect();
            assert_eq!(unsafe { fmi2SetFMUstate(host.c, state) }, OK);
            let again: Vec<_> = sizes.iter().map(|size| { go(&host, *size); seen(&host) }).collect();
            assert_eq!(first, again);
        }
        assert_eq!(unsafe { fmi2FreeFMUstate(host.c, &mut state) }, OK);
        assert!(state.is_null());
    }

    #[test]
    fn bytes_bring_a_fresh_instance_to_the_same_place(seed in any::<u64>(), steps in 0..40_usize) {
        let mut seed = seed;
        let host = Host::new();
        host.set("filter.gain", 0.5 + random(&mut seed));
        host.start(1000.05);
        for _ in 0..steps {
            go(&host, 3.0 * PERIOD * random(&mut seed) + 1e-6);
        }
        host.set("filter.time_constant", 0.3);
        host.slope("drive", 0.25); // pending derivatives belong to the state
        let mut state = null_mut();
        host.get_state(&mut state);
        let bytes = host.serialize(state);
        let other = Host::new();
        let mut copy = null_mut();
        assert_eq!(other.deserialize(&bytes, &mut copy), OK, "{}", last_message());
        assert_eq!(unsafe { fmi2SetFMUstate(other.c, copy) }, OK, "{}", last_message());
        assert_eq!(other.serialize(copy), bytes);
        for host in [&host, &other] {
            assert_eq!(host.step(host.time(), 0.07), OK);
        }
        assert_eq!(seen(&host), seen(&other));
        for _ in 0..10 {
            go(&host, 0.013);
            go(&other, 0.013);
            assert_eq!(seen(&host), seen(&other));
        }
    }

    #[test]
    fn altered_and_cut_bytes_are_refused(position in any::<prop::sample::Index>(), flip in 1..=255_u8, cut in any::<prop::sample::Index>()) {
        let host = Host::started(0.0);
        go(&host, 0.05);
        let before = seen(&host);
        let mut state = null_mut();
        host.get_state(&mut state);
        let bytes = host.serialize(state);
        let mut altered = bytes.clone();
        altered[position.index(bytes.len())] ^= flip;
        let mut handle = null_mut();
        for other in [&altered[..], &bytes[..cut.index(bytes.len())], &[&bytes[..], &[flip]].concat()] {
            assert_eq!(host.deserialize(other, &mut handle), ERROR);
            assert!(handle.is_null());
        }
        assert_eq!(seen(&host), before);
    }

    #[test]
    fn random_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let host = Host::new();
        assert_eq!(host.deserialize(&bytes, &mut null_mut()), ERROR);
        let mut marked = b"WSFMU\x01".to_vec();
        marked.extend(bytes);
        assert_eq!(host.deserialize(&marked, &mut null_mut()), ERROR);
    }
}

#[test]
fn handles_are_reused_checked_and_never_followed() {
    let host = Host::started(0.0);
    let other = Host::started(0.0);
    let mut state = null_mut();
    assert_eq!(host.get_state(&mut state), OK);
    let first = state;
    go(&host, 0.1);
    assert_eq!(host.get_state(&mut state), OK);
    assert_eq!(state, first, "a given handle is overwritten");
    go(&host, 0.1);
    unsafe {
        assert_eq!(fmi2SetFMUstate(host.c, state), OK);
        assert_eq!(host.get_integer("count"), 10);
        // another instance's, and a number that never was a handle
        assert_eq!(fmi2SetFMUstate(other.c, state), ERROR);
        let mut foreign = state;
        assert_eq!(fmi2FreeFMUstate(other.c, &mut foreign), ERROR);
        assert_eq!(foreign, state);
        assert_eq!(fmi2SetFMUstate(host.c, state), OK, "the real one is not lost");
        let mut wild = 0xdead_beef_usize as State;
        assert_eq!(fmi2GetFMUstate(host.c, &mut wild), ERROR);
        assert_eq!(fmi2FreeFMUstate(host.c, &mut wild), ERROR);
        assert_eq!(fmi2FreeFMUstate(host.c, &mut state), OK);
        assert_eq!(fmi2SetFMUstate(host.c, first), ERROR);
        let mut stale = first;
        assert_eq!(fmi2FreeFMUstate(host.c, &mut stale), ERROR);
        assert_eq!(host.get_state(&mut state), OK);
        assert_ne!(state, first, "no handle is given out twice");
    }
}

#[test]
fn a_handle_in_the_place_of_its_address_is_served_or_refused_but_not_followed() {
    let host = Host::started(0.0);
    let other = Host::started(0.0);
    let (mut kept, mut state, mut foreign) = (null_mut(), null_mut(), null_mut());
    assert_eq!((host.get_state(&mut kept), host.get_state(&mut state), other.get_state(&mut foreign)), (OK, OK, OK));
    unsafe {
        // as fmusim does
        assert_eq!(fmi2FreeFMUstate(host.c, state.cast()), OK);
        assert_eq!(fmi2SetFMUstate(host.c, state), ERROR);
        for handle in [state, foreign, host.c, other.c] {
            assert_eq!(fmi2FreeFMUstate(host.c, handle.cast()), ERROR);
            assert_eq!(fmi2GetFMUstate(host.c, handle.cast()), ERROR);
            assert!(last_message().contains("instead of an address"), "{}", last_message());
            assert_eq!(fmi2SerializedFMUstateSize(host.c, kept, handle.cast()), ERROR);
            assert_eq!(fmi2GetReal(host.c, handle.cast(), 1, handle.cast()), ERROR);
        }
        assert_eq!(fmi2FreeFMUstate(host.c, 24 as _), ERROR);
        assert_eq!(fmi2SetFMUstate(host.c, kept), OK, "the others are not lost");
        assert_eq!(fmi2SetFMUstate(other.c, foreign), OK);
    }
}

#[test]
fn room_for_the_bytes_is_checked() {
    let host = Host::started(0.0);
    let mut state = null_mut();
    host.get_state(&mut state);
    let size = host.serialize(state).len();
    let mut bytes = vec![0; size];
    assert_eq!(unsafe { fmi2SerializeFMUstate(host.c, state, bytes.as_mut_ptr(), size - 1) }, ERROR);
    assert!(last_message().contains(&size.to_string()));
}

#[test]
fn a_state_brings_its_parameters_and_phase_along() {
    let host = Host::new();
    let mut fresh = null_mut();
    host.get_state(&mut fresh);
    host.set("filter.gain", 4.0);
    host.start(0.0);
    go(&host, 0.2);
    let mut running = null_mut();
    host.get_state(&mut running);
    let there = seen(&host);
    unsafe {
        assert_eq!(fmi2SetFMUstate(host.c, fresh), OK);
        assert_eq!(host.step(0.0, 0.1), ERROR, "instantiated again");
        host.start(0.0);
        assert_eq!(host.get("filter.gain"), 1.0);
        go(&host, 0.2);
        assert_ne!(seen(&host), there);
        assert_eq!(fmi2SetFMUstate(host.c, running), OK);
    }
    assert_eq!((seen(&host), host.get("filter.gain"), host.time()), (there, 4.0, 0.2));
}
