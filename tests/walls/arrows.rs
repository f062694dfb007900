//! The one list of who may import whom: crates, and the modules inside them.
//!
//! A module stands with the modules of its own crate and the other crates (`wheelstate`, or one module of it,
//! `wheelstate::variable`) that it may name. What stands inside a module, down to the next one that is listed, belongs
//! to it. Crates from outside the workspace are free, except those in [`CONFINED`].

/// A crate of the workspace and its walls.
pub struct Crate {
    /// Its name in paths.
    pub name: &'static str,
    /// Its folder of sources, or its only source file.
    pub source: &'static str,
    /// Parts of that folder that are crates of their own.
    pub except: &'static [&'static str],
    /// Each module with what it may use; `folder::*` is every folder in that folder.
    pub modules: &'static [(&'static str, &'static [&'static str])],
}

/// All crates.
pub const CRATES: &[Crate] = &[
    Crate {
        name: "wheelstate",
        source: "src",
        except: &[],
        modules: &[
            ("variable", &[]),
            ("clock", &[]),
            ("unit", &[]),
            ("parameter_set", &["unit"]),
            ("status", &["variable"]),
            // The three that never see one another: how to estimate, what is estimated, what is true. An error of a
            // model cannot hide behind the same error in the plant or in the filter.
            ("filter", &[]),
            ("model", &["variable"]),
            ("plant", &[]),
            ("estimator", &["filter", "model", "status", "variable"]),
        ],
    },
    Crate {
        name: "wheelstate_log",
        source: "identify/log/src",
        except: &[],
        modules: &[
            ("guard", &[]),
            ("hash", &[]),
            ("progress", &[]),
            ("output", &[]),
            ("between", &[]),
            ("store", &[]),
            ("series", &["store"]),
            ("selection", &[]),
            ("columns", &["between", "series"]),
            ("error", &["columns", "progress"]),
            // What a file holds, whatever its format, and the readers of each.
            ("recording", &["columns", "error", "series", "store"]),
            ("csv", READER),
            ("parquet", READER),
            ("mf4", READER),
            ("mcap", READER),
            ("can", READER),
            // From recordings to a log on one time base.
            ("assemble", &["", "between", "columns", "error", "recording", "series"]),
            ("sampling", &["", "selection", "series"]),
            ("compact", &["", "error", "series"]),
            ("table", &["", "columns", "csv", "error", "hash", "progress", "recording", "wanted"]),
            ("wanted", &["", "columns"]),
        ],
    },
    Crate {
        name: "wheelstate_identify",
        source: "identify/src",
        except: &["main.rs"],
        modules: &[
            // The numerics know no log, no vehicle, no report and no command line.
            ("solve", &["wheelstate_log::progress"]),
            ("finding", &[]),
            ("result", &["finding", "wheelstate_log"]),
            ("assess", &["result"]),
            (
                "report",
                &[
                    "result",
                    "run",
                    // the levels at which a profile ends an interval
                    "solve",
                    "wheelstate::parameter_set",
                    "wheelstate::status",
                    "wheelstate::variable",
                    "wheelstate_log",
                ],
            ),
            // What is common to all machines names none of them.
            ("problem", &["assess", "result", "solve", "wheelstate::variable", "wheelstate_log"]),
            ("check", &["finding", "problem", "wheelstate::variable", "wheelstate_log"]),
            ("simulate", &["wheelstate::variable", "wheelstate_log"]),
            ("replay", &["wheelstate::clock", "wheelstate::estimator", "wheelstate::variable", "wheelstate_log"]),
            (
                "run",
                &[
                    "replay",
                    "result",
                    "wheelstate::estimator",
                    "wheelstate::status",
                    "wheelstate::unit",
                    "wheelstate::variable",
                    "wheelstate_log",
                ],
            ),
            (
                "tune",
                &[
                    "replay",
                    "result",
                    "wheelstate::estimator",
                    "wheelstate::unit",
                    "wheelstate::variable",
                    "wheelstate_log",
                ],
            ),
            ("estimate", &["wheelstate", "wheelstate_log"]),
            (
                "vehicle",
                &[
                    "check",
                    "finding",
                    "problem",
                    "result",
                    "run",
                    "simulate",
                    "tune",
                    "wheelstate::estimator",
                    "wheelstate::variable",
                    "wheelstate_log",
                ],
            ),
            // A machine never sees another one.
            ("vehicles::*", MACHINE),
            ("vehicles", &["vehicle"]),
            // What the command line and the Python package share.
            ("checked", &["finding", "problem", "result", "vehicle", "wheelstate", "wheelstate_log"]),
            ("fleet", &["check", "problem", "result", "vehicle", "wheelstate_log"]),
            ("design", &["check", "checked", "finding", "problem", "result", "simulate", "vehicle", "wheelstate_log"]),
            ("values", &["result", "vehicle", "wheelstate::variable"]),
            (
                "cli",
                &[
                    "checked",
                    "design",
                    "estimate",
                    "finding",
                    "problem",
                    "replay",
                    "report",
                    "result",
                    "run",
                    "simulate",
                    "solve",
                    "tune",
                    "values",
                    "vehicle",
                    "vehicles",
                    "wheelstate_log",
                ],
            ),
        ],
    },
    Crate {
        name: "program identify",
        source: "identify/src/main.rs",
        except: &[],
        modules: &[("", &["wheelstate_identify::cli"])],
    },
    Crate {
        name: "wheelstate_fmu",
        source: "fmu/src",
        except: &["bin"],
        modules: &[
            ("clock", &["wheelstate::clock"]),
            ("handle", &[]),
            ("phase", &[]),
            ("refusal", &[]),
            ("machine", &["wheelstate"]),
            ("model", &["machine", "wheelstate"]),
            ("describe", &["clock", "model", "wheelstate"]),
            ("snapshot", &["clock", "handle", "machine", "model", "phase", "refusal"]),
            ("screen", &["model"]),
            (
                "instance",
                &["clock", "machine", "model", "phase", "refusal", "screen", "snapshot", "wheelstate::status"],
            ),
            ("abi::types", &[]),
            ("abi::import", &["abi::types", "model"]),
            ("abi::logger", &["abi::types", "describe", "refusal"]),
            ("abi::table", &["abi::logger", "abi::types", "handle", "instance"]),
            ("abi::boundary", &["abi::table", "abi::types", "handle", "phase", "refusal"]),
            (
                "abi",
                &[
                    "abi::boundary",
                    "abi::import",
                    "abi::logger",
                    "abi::table",
                    "abi::types",
                    "describe",
                    "handle",
                    "instance",
                    "model",
                    "phase",
                    "refusal",
                ],
            ),
            ("pack::command", &["model", "pack"]),
            ("pack", &["abi", "describe", "instance", "model", "refusal", "wheelstate"]),
        ],
    },
    Crate {
        name: "program pack",
        source: "fmu/src/bin/pack.rs",
        except: &[],
        modules: &[("", &["wheelstate_fmu::pack"])],
    },
    Crate {
        name: "wheelstate_python",
        source: "identify/python/src",
        except: &[],
        modules: &[
            ("error", &[]),
            ("work", &["wheelstate_log::progress"]),
            ("arrow", &["error", "wheelstate_log"]),
            ("names", &["error", "wheelstate_identify"]),
            ("log", &["arrow", "error", "names", "wheelstate_identify", "wheelstate_log", "work"]),
            ("machine", &["error", "log", "names", "wheelstate_fmu::pack", "wheelstate_identify", "work"]),
            ("fit", &["error", "log", "names", "wheelstate_identify", "wheelstate_log", "work"]),
            ("design", &["error", "fit", "log", "names", "wheelstate_identify", "work"]),
            ("fleet", &["error", "fit", "log", "names", "wheelstate_identify::fleet"]),
            ("run", &["error", "fit", "log", "names", "wheelstate_identify", "work"]),
            ("command", &["wheelstate_fmu::pack", "wheelstate_identify::cli"]),
        ],
    },
    Crate {
        name: "program replay",
        source: "fmu/src/bin/replay",
        except: &[],
        modules: &[
            ("messages", &[]),
            // It steps an FMU through logs: it reads them as `identify` does and writes the outputs as one.
            ("master", &["messages", "wheelstate", "wheelstate_fmu::model", "wheelstate_log"]),
        ],
    },
];

/// What a reader of one format may use: it never sees another one. What it writes is a log.
const READER: &[&str] =
    &["", "columns", "error", "guard", "hash", "progress", "recording", "series", "store", "wanted"];

/// What one machine of `identify` may use.
const MACHINE: &[&str] = &[
    "assess",
    "check",
    "estimate",
    "problem",
    "result",
    "simulate",
    "solve",
    "vehicle",
    "wheelstate",
    "wheelstate_log",
];

/// Crates from outside that only these modules may name: the command line and the numerics know nothing of each other.
pub const CONFINED: &[(&str, &[&str])] = &[
    ("clap", &["wheelstate_identify::cli", "wheelstate_fmu::pack::command", "program replay"]),
    ("clarabel", &["wheelstate_identify::solve"]),
    ("plotters", &["wheelstate_identify::report"]),
    ("askama", &["wheelstate_identify::report"]),
    ("csv", &["wheelstate_log"]),
    ("parquet", &["wheelstate_log"]),
    ("mf4_rs", &["wheelstate_log"]),
    ("fmi", &["program replay"]),
    ("libloading", &["wheelstate_fmu::abi"]),
    ("arrow_array", &["wheelstate_python::arrow"]),
    ("pyo3", &["wheelstate_python"]),
];

/// The only places with `unsafe`: the C boundaries of the FMUs and of Arrow.
pub const UNSAFE: &[&str] = &["fmu/src/abi", "identify/python/src/arrow.rs"];
