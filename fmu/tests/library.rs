//! The shared library itself: what it exports and what it needs.

use std::path::PathBuf;
use std::process::Command;

const FUNCTIONS: [&str; 34] = [
    "fmi2CancelStep",
    "fmi2DeSerializeFMUstate",
    "fmi2DoStep",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2FreeFMUstate",
    "fmi2FreeInstance",
    "fmi2GetBoolean",
    "fmi2GetBooleanStatus",
    "fmi2GetDirectionalDerivative",
    "fmi2GetFMUstate",
    "fmi2GetInteger",
    "fmi2GetIntegerStatus",
    "fmi2GetReal",
    "fmi2GetRealOutputDerivatives",
    "fmi2GetRealStatus",
    "fmi2GetStatus",
    "fmi2GetString",
    "fmi2GetStringStatus",
    "fmi2GetTypesPlatform",
    "fmi2GetVersion",
    "fmi2Instantiate",
    "fmi2Reset",
    "fmi2SerializeFMUstate",
    "fmi2SerializedFMUstateSize",
    "fmi2SetBoolean",
    "fmi2SetDebugLogging",
    "fmi2SetFMUstate",
    "fmi2SetInteger",
    "fmi2SetReal",
    "fmi2SetRealInputDerivatives",
    "fmi2SetString",
    "fmi2SetupExperiment",
    "fmi2Terminate",
];

/// The library that cargo built along with this test.
fn library() -> PathBuf {
    let deps = std::env::current_exe().unwrap().parent().unwrap().to_owned();
    let path = deps.join("libwheelstate_fmu.so");
    assert!(path.is_file(), "{}", path.display());
    path
}

/// The output of a tool, or nothing, with a loud word, if it is not there.
fn run(tool: &str, arguments: &[&str]) -> Option<String> {
    match Command::new(tool).args(arguments).arg(library()).output() {
        Ok(output) => Some(String::from_utf8(output.stdout).unwrap()),
        Err(error) => {
            eprintln!("SKIPPED: {tool}: {error}");
            None
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn exactly_the_functions_of_the_standard_are_exported() {
    let Some(text) = run("nm", &["-D", "--defined-only"]) else { return };
    let mut names: Vec<_> = text.lines().filter_map(|line| line.split_whitespace().last()).collect();
    names.sort_by_key(|name| name.to_owned());
    let mut expected = FUNCTIONS.to_vec();
    expected.sort_unstable();
    assert_eq!(names, expected);
}

#[test]
#[cfg(target_os = "linux")]
fn nothing_but_the_systems_own_libraries_is_needed() {
    let Some(text) = run("ldd", &[]) else { return };
    let system = ["linux-vdso", "libgcc_s", "libm.", "libc.", "libpthread", "libdl", "ld-linux", "librt"];
    for line in text.lines() {
        assert!(system.iter().any(|name| line.contains(name)), "{line}");
    }
}

/// What the library is made of, as `cargo tree` lists it; the packer's own crates are not in it.
#[test]
fn the_licence_file_names_every_crate_in_the_library() {
    let licences = include_str!("../assets/license.txt").replace([',', '.'], " ");
    for package in ["wheelstate", "postcard", "serde_json", "sha2", "serde"] {
        let arguments = ["tree", "--offline", "-p", package, "-e", "normal,no-proc-macro", "--prefix", "none"];
        let output =
            Command::new(env!("CARGO")).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        for name in text.lines().filter_map(|line| line.split_whitespace().next()) {
            let named = licences.split_whitespace().any(|word| word.trim_end_matches(':') == name);
            assert!(named, "{name} (below {package}) is not in assets/license.txt");
        }
    }
}
