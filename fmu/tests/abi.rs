//! The C functions: which are allowed when, and what garbage, panics and refusals do.
#![allow(unsafe_code)]

use crate::support::catalogue;
use crate::support::host::{Host, callbacks, instantiate, last_message, messages, model};
use std::ffi::{CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};
use wheelstate_fmu::abi::*;
use wheelstate_fmu::describe::guid;

/// A call with valid arguments where it is allowed.
type Call = fn(&Host) -> Status;

fn state_of(host: &Host) -> State {
    let mut state = null_mut();
    host.get_state(&mut state);
    state
}

/// Every function with the phases in which FMI 2.0.4 (4.2.4) allows it for a synchronous slave
/// without pending steps: I instantiated, M initialization mode, S step complete, T terminated.
const TABLE: [(&str, &str, Call); 27] = unsafe {
    [
        ("fmi2SetDebugLogging", "IMST", |h| fmi2SetDebugLogging(h.c, 0, 0, null())),
        ("fmi2SetupExperiment", "I", |h| fmi2SetupExperiment(h.c, 0, 0.0, 0.0, 0, 0.0)),
        ("fmi2EnterInitializationMode", "I", |h| fmi2EnterInitializationMode(h.c)),
        ("fmi2ExitInitializationMode", "M", |h| fmi2ExitInitializationMode(h.c)),
        ("fmi2Terminate", "S", |h| fmi2Terminate(h.c)),
        ("fmi2Reset", "IMST", |h| fmi2Reset(h.c)),
        ("fmi2GetReal", "MST", |h| fmi2GetReal(h.c, &h.vr("position"), 1, &mut 0.0)),
        ("fmi2GetInteger", "MST", |h| fmi2GetInteger(h.c, &h.vr("count"), 1, &mut 0)),
        ("fmi2GetBoolean", "MST", |h| fmi2GetBoolean(h.c, &h.vr("healthy"), 1, &mut 0)),
        ("fmi2GetString", "MST", |h| fmi2GetString(h.c, null(), 0, null_mut())),
        ("fmi2SetReal", "IMS", |h| fmi2SetReal(h.c, &h.vr("drive"), 1, &1.0)),
        ("fmi2SetInteger", "IMS", |h| fmi2SetInteger(h.c, &h.vr("gear"), 1, &2)),
        ("fmi2SetBoolean", "IMS", |h| fmi2SetBoolean(h.c, &h.vr("brake"), 1, &1)),
        ("fmi2SetString", "IMS", |h| fmi2SetString(h.c, null(), 0, null())),
        ("fmi2GetFMUstate", "IMST", |h| fmi2GetFMUstate(h.c, &mut null_mut())),
        ("fmi2SetFMUstate", "IMST", |h| fmi2SetFMUstate(h.c, state_of(h))),
        ("fmi2FreeFMUstate", "IMST", |h| fmi2FreeFMUstate(h.c, &mut state_of(h))),
        ("fmi2SerializedFMUstateSize", "IMST", |h| fmi2SerializedFMUstateSize(h.c, state_of(h), &mut 0)),
        ("fmi2SerializeFMUstate", "IMST", |h| {
            let mut bytes = [0; 4096];
            fmi2SerializeFMUstate(h.c, state_of(h), bytes.as_mut_ptr(), bytes.len())
        }),
        ("fmi2SetRealInputDerivatives", "IMS", |h| fmi2SetRealInputDerivatives(h.c, &h.vr("drive"), 1, &1, &1.0)),
        ("fmi2GetRealOutputDerivatives", "ST", |h| {
            fmi2GetRealOutputDerivatives(h.c, &h.vr("position"), 1, &1, &mut 0.0)
        }),
        ("fmi2DoStep", "S", |h| fmi2DoStep(h.c, 0.0, 0.01, 1)),
        ("fmi2CancelStep", "", |h| fmi2CancelStep(h.c)),
        ("fmi2GetRealStatus", "ST", |h| fmi2GetRealStatus(h.c, 2, &mut 0.0)),
        ("fmi2GetBooleanStatus", "ST", |h| fmi2GetBooleanStatus(h.c, 3, &mut 0)),
        ("fmi2GetStatus", "-ST", |h| fmi2GetStatus(h.c, 0, &mut 0)),
        ("fmi2GetDirectionalDerivative", "!MST", |h| {
            fmi2GetDirectionalDerivative(h.c, null(), 0, null(), 0, null(), null_mut())
        }),
    ]
};

/// A host whose instance is in the phase.
fn in_phase(phase: char) -> Host {
    let host = Host::new();
    if phase == 'I' {
        return host;
    }
    host.setup(0.0, None);
    host.enter();
    if phase == 'M' {
        return host;
    }
    if phase == 'F' {
        host.set_integer("filter.fault", 3);
    }
    host.exit();
    match phase {
        'T' => assert_eq!(unsafe { fmi2Terminate(host.c) }, OK),
        'F' => assert_eq!(host.step(0.0, 0.01), FATAL),
        _ => {}
    }
    host
}

#[test]
fn every_function_is_allowed_in_its_phases_only() {
    for (name, phases, call) in TABLE {
        for phase in "IMSTF".chars() {
            let host = in_phase(phase);
            messages();
            let status = call(&host);
            let log = messages();
            let allowed = phases.contains(phase);
            let expected = match (allowed, phases.chars().next()) {
                (true, Some('-')) => DISCARD,
                (true, Some('!')) => ERROR,
                (true, _) => OK,
                (false, _) if phase == 'F' => FATAL,
                (false, _) => ERROR,
            };
            assert_eq!(status, expected, "{name} in {phase}: {log:?}");
            if expected == OK {
                assert!(log.is_empty(), "{name} in {phase} logs on success: {log:?}");
            } else if !name.contains("State") || phase != 'F' {
                let text = &log.last().unwrap().2;
                assert!(text.starts_with(name), "{name}: {text}");
                assert!(allowed || text.contains("is not allowed in the state"), "{text}");
            }
        }
    }
}

#[test]
fn deserialising_is_allowed_in_every_phase_but_fatal() {
    let host = in_phase('S');
    let bytes = host.serialize(state_of(&host));
    for (phase, expected) in [('I', OK), ('M', OK), ('S', OK), ('T', OK), ('F', FATAL)] {
        let host = in_phase(phase);
        let mut state = null_mut();
        assert_eq!(host.deserialize(&bytes, &mut state), expected, "{phase}: {}", last_message());
    }
}

#[test]
fn the_other_status_functions_have_no_answer() {
    let host = in_phase('S');
    unsafe {
        assert_eq!(fmi2GetIntegerStatus(host.c, 0, &mut 0), DISCARD);
        assert_eq!(fmi2GetStringStatus(host.c, 1, &mut null()), DISCARD);
        assert_eq!(fmi2GetRealStatus(host.c, 99, &mut 0.0), DISCARD);
        host.step(0.0, 0.25);
        let mut time = 0.0;
        assert_eq!(fmi2GetRealStatus(host.c, 2, &mut time), OK);
        assert_eq!(time, 0.25);
        let mut terminated = 7;
        assert_eq!(fmi2GetBooleanStatus(host.c, 3, &mut terminated), OK);
        assert_eq!(terminated, 0);
    }
}

#[test]
fn version_and_platform_are_those_of_fmi_2() {
    unsafe {
        assert_eq!(std::ffi::CStr::from_ptr(fmi2GetVersion()), c"2.0");
        assert_eq!(std::ffi::CStr::from_ptr(fmi2GetTypesPlatform()), c"default");
    }
}

/// All functions that take a component, with nothing else.
fn call_all(c: Component) -> Vec<Status> {
    unsafe {
        vec![
            fmi2SetDebugLogging(c, 1, 1, null()),
            fmi2SetupExperiment(c, 0, 0.0, f64::NAN, 0, 0.0),
            fmi2GetReal(c, null(), 1, null_mut()),
            fmi2GetInteger(c, null(), 1, null_mut()),
            fmi2GetBoolean(c, null(), 1, null_mut()),
            fmi2GetString(c, null(), 1, null_mut()),
            fmi2SetReal(c, null(), 1, null()),
            fmi2SetInteger(c, null(), 1, null()),
            fmi2SetBoolean(c, null(), 1, null()),
            fmi2SetString(c, null(), 1, null()),
            fmi2GetFMUstate(c, null_mut()),
            fmi2SetFMUstate(c, null_mut()),
            fmi2SetFMUstate(c, 12345 as State),
            fmi2SerializedFMUstateSize(c, null_mut(), null_mut()),
            fmi2SerializeFMUstate(c, null_mut(), null_mut(), 0),
            fmi2DeSerializeFMUstate(c, null(), 10, null_mut()),
            fmi2GetDirectionalDerivative(c, null(), 1, null(), 1, null(), null_mut()),
            fmi2SetRealInputDerivatives(c, null(), 1, null(), null()),
            fmi2GetRealOutputDerivatives(c, null(), 1, null(), null_mut()),
            fmi2DoStep(c, f64::NAN, -1.0, 9),
            fmi2CancelStep(c),
            fmi2GetRealStatus(c, 2, null_mut()),
            fmi2GetBooleanStatus(c, 3, null_mut()),
        ]
    }
}

#[test]
fn null_and_foreign_components_are_refused() {
    let mut zeros = [0_u64; 512];
    let foreign: *mut c_void = zeros.as_mut_ptr().cast();
    let freed = Host::new().c;
    let alive = Host::new();
    // none of these may be followed
    let never = [24, 0x7fff_0000_0000, usize::MAX, alive.c.addr() + 1, alive.c.addr() ^ (1 << 40)];
    let never = never.map(std::ptr::without_provenance_mut);
    for c in [null_mut(), foreign, foreign.wrapping_byte_add(1), freed].into_iter().chain(never) {
        assert!(call_all(c).iter().all(|status| *status == ERROR));
        unsafe {
            assert_eq!(fmi2Reset(c), ERROR);
            assert_eq!(fmi2Terminate(c), ERROR);
            assert_eq!(fmi2EnterInitializationMode(c), ERROR);
            assert_eq!(fmi2ExitInitializationMode(c), ERROR);
            assert_eq!(fmi2FreeFMUstate(c, null_mut()), ERROR);
            assert_eq!(fmi2GetStatus(c, 0, null_mut()), ERROR);
            assert_eq!(fmi2GetIntegerStatus(c, 0, null_mut()), ERROR);
            assert_eq!(fmi2GetStringStatus(c, 0, null_mut()), ERROR);
            fmi2FreeInstance(c);
        }
    }
    assert_eq!(alive.setup(0.0, None), OK);
}

#[test]
fn a_freed_component_stays_dead_however_many_come_after_it() {
    let freed: Vec<_> = (0..200).map(|_| Host::new().c).collect();
    let hosts: Vec<_> = (0..300).map(|_| Host::new()).collect();
    for c in freed {
        assert_eq!(unsafe { fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) }, ERROR);
        unsafe { fmi2FreeInstance(c) };
    }
    for host in &hosts {
        host.start(1.0);
        assert_eq!(host.step(1.0, 0.01), OK);
    }
}

#[test]
fn two_threads_with_one_component_are_detected_and_never_mixed() {
    let host = Host::started(0.0);
    let component = host.c.addr();
    let steps = |_| {
        let c = std::ptr::without_provenance_mut(component);
        (0..2000).filter(|_| unsafe { fmi2DoStep(c, 0.0, 1e-9, 1) } == OK).count()
    };
    let served: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|i| scope.spawn(move || steps(i))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(served.iter().sum::<usize>() > 0);
    assert_eq!(host.get_integer("count"), 1);
}

#[test]
fn null_and_garbage_arguments_are_refused_and_change_nothing() {
    for phase in "IMST".chars() {
        let host = in_phase(phase);
        let before = host.serialize(state_of(&host));
        for (i, status) in call_all(host.c).into_iter().enumerate() {
            assert_eq!(status, ERROR, "call {i} in {phase}: {}", last_message());
        }
        assert_eq!(host.serialize(state_of(&host)), before);
    }
    let host = in_phase('S');
    unsafe {
        let vr = host.vr("position");
        assert_eq!(fmi2GetReal(host.c, &vr, usize::MAX, &mut 0.0), ERROR);
        let misaligned = (&raw const vr).cast::<u8>().wrapping_add(1).cast();
        assert_eq!(fmi2GetReal(host.c, misaligned, 1, &mut 0.0), ERROR);
        assert_eq!(fmi2FreeFMUstate(host.c, null_mut()), OK);
        assert_eq!(fmi2FreeFMUstate(host.c, &mut null_mut()), OK);
    }
}

#[test]
fn empty_lists_may_be_null() {
    let host = in_phase('S');
    unsafe {
        assert_eq!(fmi2GetReal(host.c, null(), 0, null_mut()), OK);
        assert_eq!(fmi2GetInteger(host.c, null(), 0, null_mut()), OK);
        assert_eq!(fmi2GetBoolean(host.c, null(), 0, null_mut()), OK);
        assert_eq!(fmi2SetReal(host.c, null(), 0, null()), OK);
        assert_eq!(fmi2SetInteger(host.c, null(), 0, null()), OK);
        assert_eq!(fmi2SetBoolean(host.c, null(), 0, null()), OK);
        assert_eq!(fmi2SetRealInputDerivatives(host.c, null(), 0, null(), null()), OK);
        assert_eq!(fmi2GetRealOutputDerivatives(host.c, null(), 0, null(), null_mut()), OK);
    }
}

#[test]
fn instantiate_refuses_with_the_reason_even_if_logging_is_off() {
    let right = CString::new(guid::of(&model())).unwrap();
    let wrong = CString::new(right.to_str().unwrap().replace(&right.to_str().unwrap()[10..14], "0000")).unwrap();
    let cases: [(*const c_char, u32, *const c_char, &str); 7] = [
        (c"one".as_ptr(), 0, right.as_ptr(), "fmuType = 0"),
        (c"one".as_ptr(), 1, c"{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}".as_ptr(), "no model of this library"),
        (c"one".as_ptr(), 1, wrong.as_ptr(), "another version of TestLag"),
        (c"one".as_ptr(), 1, c"".as_ptr(), "not one of this library"),
        (c"one".as_ptr(), 1, null(), "NULL was passed for the GUID"),
        (c"".as_ptr(), 1, right.as_ptr(), "needs a name"),
        (null(), 1, right.as_ptr(), "needs a name"),
    ];
    for (name, kind, guid, word) in cases {
        messages();
        assert!(instantiate(name, kind, guid, false).is_null(), "{word}");
        let log = messages();
        assert_eq!(log.len(), 1);
        assert_eq!((log[0].0, log[0].1.as_str()), (ERROR, "logStatusError"));
        assert!(log[0].2.contains(word), "{}", log[0].2);
    }
    // and does without any callbacks
    unsafe {
        let c = instantiate_from(catalogue, c"one".as_ptr(), 1, right.as_ptr(), null(), null(), 0, 1);
        assert!(!c.is_null());
        assert_eq!(fmi2DoStep(c, 0.0, 1.0, 0), ERROR);
        fmi2FreeInstance(c);
        let mut none = callbacks();
        none.logger = None;
        let c = instantiate_from(catalogue, c"one".as_ptr(), 1, right.as_ptr(), null(), &none, 0, 1);
        assert_eq!(fmi2DoStep(c, 0.0, 1.0, 0), ERROR);
        fmi2FreeInstance(c);
    }
}

#[test]
fn a_panic_is_fatal_for_the_instance_and_harmless_for_the_host() {
    // 2 = build, 3 = step, 4 = outputs
    for (fault, word) in [(2, "injected while building"), (3, "injected while stepping"), (4, "injected while reading")]
    {
        let other = Host::started(0.0);
        let host = Host::new();
        host.set_integer("filter.fault", fault);
        host.setup(0.0, None);
        host.enter();
        let status = match host.exit() {
            OK => host.step(0.0, 0.01),
            status => status,
        };
        assert_eq!(status, FATAL);
        let (_, category, text) = messages().pop().unwrap();
        assert_eq!(category, "logStatusFatal");
        assert!(text.contains(word), "{text}");
        // the host formats the text: every percent sign is doubled
        assert!(fault != 3 || text.contains("100 %%s done"), "{text}");
        assert_eq!(host.step(0.0, 0.01), FATAL);
        assert_eq!(unsafe { fmi2Reset(host.c) }, FATAL);
        drop(host);
        assert_eq!(other.step(0.0, 0.01), OK);
    }
}

#[test]
fn log_categories_are_honoured() {
    let host = Host::with_logging(true);
    let refuse = || {
        messages();
        host.step(5.0, 1.0);
        messages().len()
    };
    let choose =
        |on: c_int, names: &[*const c_char]| unsafe { fmi2SetDebugLogging(host.c, on, names.len(), names.as_ptr()) };
    host.start(0.0);
    assert_eq!(messages().last().unwrap().1, "logEvents");
    assert_eq!(refuse(), 1);
    assert_eq!(choose(1, &[c"logEvents".as_ptr()]), OK);
    assert_eq!(refuse(), 0);
    assert_eq!(choose(1, &[c"logEvents".as_ptr(), c"logStatusError".as_ptr()]), OK);
    assert_eq!(refuse(), 1);
    assert_eq!(choose(1, &[c"logEverything".as_ptr()]), ERROR);
    assert!(last_message().contains("logEverything") && last_message().contains("logStatusFatal"));
    assert_eq!(choose(1, &[null()]), ERROR);
    assert_eq!(choose(0, &[]), OK);
    messages();
    unsafe { fmi2Reset(host.c) };
    assert!(messages().is_empty());
}

#[test]
fn setting_is_all_or_nothing() {
    let host = in_phase('S');
    let references = [host.vr("filter.gain"), host.vr("drive"), host.vr("position")];
    assert_eq!(unsafe { fmi2SetReal(host.c, references.as_ptr(), 3, [5.0, 6.0, 7.0].as_ptr()) }, ERROR);
    assert!(last_message().contains("position has causality output"));
    assert_eq!((host.get("filter.gain"), host.get("drive")), (1.0, 0.0));
    // valid on their own, not with sample_period
    assert_eq!(host.set("filter.time_constant", 0.005), ERROR);
    assert!(last_message().contains("shorter than sample_period"), "{}", last_message());
    assert_eq!(host.get("filter.time_constant"), 0.2);
    assert_eq!(host.step(0.0, 0.01), OK);
}

#[test]
fn values_are_checked_against_their_declaration() {
    let host = Host::new();
    messages();
    let refusals = [
        (
            host.set("filter.time_constant", f64::NAN),
            "filter.time_constant = NaN s is not a number; allowed: 0.001..=1000 s",
        ),
        (host.set("sample_period", -1.0), "sample_period = -1 s is outside the allowed range; allowed: 1e-6..=10 s"),
        (host.set("filter.gain", f64::INFINITY), "filter.gain = INF m/(N.m) is outside the allowed range"),
        (host.set("drive", f64::NAN), "drive = NaN is not finite"),
        (host.set("drive", f64::INFINITY), "drive = inf is not finite"),
        (host.set("gear", 1.0), "gear is of type Integer, not Real"),
        (host.set_integer("gear", 9), "gear = 9 is outside the allowed range; allowed: 1..=4"),
        (
            host.set_integer("filter.fault", 5),
            "filter.fault = 5 is not one of 1 = none, 2 = build, 3 = step, 4 = outputs",
        ),
        (host.set_integer("regime", 0), "regime = 0 is not one of"),
        (host.set_integer("brake", 1), "brake is of type Boolean, not Integer"),
    ];
    let log = messages();
    assert_eq!(log.len(), refusals.len());
    for ((status, word), (_, _, text)) in refusals.into_iter().zip(log) {
        assert_eq!(status, ERROR, "{word}");
        assert!(text.contains(word), "{text} instead of {word}");
    }
}

#[test]
fn all_types_travel_through_the_same_values() {
    let host = Host::new();
    assert_eq!(host.set_integer("filter.updates", 3), OK);
    assert_eq!(host.set_boolean("filter.use_signal", 0), OK);
    host.start(0.0);
    assert_eq!((host.get_integer("filter.updates"), host.get_boolean("filter.use_signal")), (3, 0));
    assert_eq!(host.get_integer("regime_seen"), 1);
    host.set_integer("regime", 4);
    host.set_integer("gear", 3);
    host.set("drive", 2.0);
    host.set("signal", f64::NEG_INFINITY);
    host.step(0.0, 0.02);
    assert_eq!((host.get_integer("regime_seen"), host.get("drive_sum")), (4, 12.0));
    host.set_boolean("brake", 77);
    host.step(0.02, 0.01);
    assert_eq!((host.get("drive_sum"), host.get_boolean("brake"), host.get_boolean("healthy")), (12.0, 1, 1));
}

#[test]
fn reset_is_a_fresh_instance() {
    let host = Host::new();
    let fresh = host.serialize(state_of(&host));
    host.set("filter.gain", 3.0);
    host.set("drive", 3.0);
    host.start(2.0);
    host.step(2.0, 0.5);
    assert_eq!(unsafe { fmi2Reset(host.c) }, OK);
    assert_eq!(host.serialize(state_of(&host)), fresh);
}

#[test]
fn parameters_are_read_as_they_will_start() {
    let host = Host::new();
    host.setup(0.0, None);
    host.enter();
    host.set("initial_angle", 1.5);
    assert_eq!(host.get("position"), 1.5);
    host.set("initial_angle", 2.5);
    assert_eq!(host.get("position"), 2.5);
    // refused together, then mended
    host.set("filter.time_constant", 0.002);
    assert_eq!(host.exit(), ERROR);
    assert!(last_message().contains("shorter than sample_period"));
    host.set("filter.time_constant", 0.2);
    assert_eq!(host.exit(), OK);
    assert_eq!(host.get("position"), 2.5);
}

#[test]
fn a_caught_panic_prints_nothing_to_the_hosts_stderr() {
    let test = "abi::a_panic_is_fatal_for_the_instance_and_harmless_for_the_host";
    let own = std::env::current_exe().unwrap();
    let run = std::process::Command::new(own).args([test, "--exact", "--nocapture"]).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success() && out.contains("1 passed"), "{out}");
    assert!(!err.contains("injected"), "{err}");
}
