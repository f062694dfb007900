//! The `identify` program as a user meets it: exit codes, one-line refusals, nothing half-written.

use assert_cmd::Command;
use std::path::Path;
use tempfile::TempDir;

fn identify(folder: &Path, arguments: &str) -> std::process::Output {
    let mut command = Command::cargo_bin("identify").unwrap();
    command.current_dir(folder).args(arguments.split_whitespace()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn files(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(name).collect();
    names.sort();
    names
}

/// Exit code 2, one line on stderr with these words, nothing on stdout, no file that was not there.
#[track_caller]
fn assert_refused(folder: &Path, arguments: &str, words: &str) {
    let before = files(folder);
    let output = identify(folder, arguments);
    let line = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments}: {line}");
    assert!(line.starts_with("identify: ") && line.contains(words), "{arguments}: {line:?} lacks {words:?}");
    assert_eq!(line.lines().count(), 1, "{arguments}: {line}");
    assert_eq!(text(&output.stdout), "", "{arguments}");
    assert_eq!(files(folder), before, "{arguments} left files behind");
}

#[test]
fn corrupt_logs_are_refused_and_leave_no_file() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("no_time.csv", b"t,speed\n0,1\n1,2\n");
    write("text.csv", b"time,speed,torque_left\n0,1,1\n0.1,fast,1\n");
    write("backwards.csv", b"time,speed\n0,1\n0.2,1\n0.1,1\n");
    write("repeated.csv", b"time,speed\n0,1\n0,1\n");
    write("empty.csv", b"");
    write("header.csv", b"time,speed\n");
    write("one.csv", b"time,speed\n0,1\n");
    write("ragged.csv", b"time,speed\n0,1\n1\n");
    write("twice.csv", b"time,speed,speed\n0,1,1\n1,1,1\n");
    write("nan_time.csv", b"time,speed\n0,1\nnan,1\n");
    write("binary.csv", &[0xff, 0xfe, 0x00, 0x01, b'\n', 0x80]);
    write("log.txt", b"time,speed\n0,1\n1,2\n");
    write("cut.parquet", b"PAR1");
    write("cut.mf4", b"MDF     4.10    ");
    for (log, words) in [
        ("no_time.csv", "no_time.csv: no column 'time'"),
        ("text.csv", "text.csv:3: column 'speed': 'fast' is not a number"),
        ("backwards.csv", "backwards.csv:4: the time runs backwards"),
        ("repeated.csv", "repeated.csv:3: the time stands still"),
        ("empty.csv", "empty.csv: the file is empty"),
        ("header.csv", "header.csv:1: "),
        ("one.csv", "one.csv: only 1 sample"),
        ("ragged.csv", "ragged.csv:3: 1 cells"),
        ("twice.csv", "twice.csv:1: columns 1 and 2 (counted from 0) are both named 'speed'"),
        ("nan_time.csv", "nan_time.csv:3: the time is missing"),
        ("binary.csv", "binary.csv:1: there is a header but no sample"),
        ("log.txt", "log.txt: unknown ending"),
        ("cut.parquet", "cut.parquet: "),
        ("cut.mf4", "cut.mf4: "),
        ("none.csv", "none.csv: "),
        (".", ".: unknown ending"),
    ] {
        // what is wrong with a column that a machine does not read is no reason to refuse
        let of_speed = ["text.csv", "twice.csv"].contains(&log);
        for vehicle in ["nursing-robot", "wheeled-robot", "wheel-loader", "wheelchair"] {
            if of_speed && vehicle == "wheelchair" {
                continue;
            }
            assert_refused(
                folder.path(),
                &format!("fit {vehicle} {log} --out fit.json --ssv fit.ssv --report fit.html"),
                words,
            );
        }
        assert_refused(folder.path(), &format!("tune wheeled-robot {log} --out tune.json"), words);
        assert_refused(folder.path(), &format!("convert wheel-loader {log} --out x.csv"), words);
    }
}

/// No machine takes the log of another one: neither to fit nor to tune, nor to judge a tuning.
#[test]
fn logs_of_other_machines_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    let machines = [
        ("nursing-robot", "coughs"),
        ("wheeled-robot", "sine"),
        ("wheel-loader", "bumpy-c"),
        ("human-dynamics", "seated-braking"),
        ("wheelchair", "climb"),
    ];
    for (machine, scenario) in machines {
        let made = identify(path, &format!("simulate {machine} --scenario {scenario} --out {machine}.csv"));
        assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
    }
    for (machine, _) in machines {
        for (other, _) in machines.into_iter().filter(|(other, _)| *other != machine) {
            for command in ["fit", "tune"] {
                let words = format!("identify: {other}.csv: no channel ");
                assert_refused(path, &format!("{command} {machine} {other}.csv"), &words);
            }
        }
    }
    let words = "wheelchair.csv: no channel with samples among steering_angle, drive_torque_*, brake_torque_*";
    assert_refused(path, "tune wheeled-robot wheelchair.csv --out x.json", words);
    let words = "wheelchair.csv: no channel with samples among torque_left, torque_right; nursing-robot needs one";
    assert_refused(path, "tune nursing-robot nursing-robot.csv --held-out wheelchair.csv --out x.json", words);
    let words = "wheel-loader.csv: no channel 'torque_left'; did you mean 'torque_rear'?";
    assert_refused(path, "fit nursing-robot wheel-loader.csv", words);
    // a refused fit says in its file what was read and what is wrong, and no program may use that
    let output = identify(path, "fit nursing-robot wheel-loader.csv --out x.json");
    assert_eq!(output.status.code(), Some(2));
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(path.join("x.json")).unwrap()).unwrap();
    assert!(json["refused"].as_str().unwrap().contains("torque_left") && json["logs"][0]["samples"].as_u64() > Some(0));
    assert!(json["parameters"].as_object().unwrap().is_empty());
    std::fs::remove_file(path.join("x.json")).unwrap();
    // columns without samples are no columns, and what does not suffice is told what else there could be
    std::fs::write(path.join("empty.csv"), "time,gyro_z,accel_x\n0,,1\n0.01,nan,1\n0.02,,1\n").unwrap();
    assert_refused(path, "tune wheeled-robot empty.csv --out x.json", "empty.csv: no channel with samples among");
    std::fs::write(path.join("joint.csv"), "time,q_lumbar_x\n0,0\n0.01,0\n0.02,0\n").unwrap();
    let words = "has an effect on joint.csv; there is no sample of q_lumbar_y, q_thorax_y";
    assert_refused(path, "tune human-dynamics joint.csv --out x.json", words);
}

/// Nothing but a setting at its floor has no interval to report.
#[test]
fn a_lone_setting_at_its_floor_is_reported() {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    assert_eq!(identify(path, "simulate wheeled-robot --scenario sine --seed 1 --out log.csv").status.code(), Some(0));
    let tune = "tune wheeled-robot log.csv --only filter.measurement_std.speed --pop 5 --iters 3 --out tune.json";
    let output = identify(path, tune);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("at bound") && table.contains("filter.measurement_std.speed sits at its"), "{table}");
}

#[test]
fn bad_requests_are_refused_before_any_work() {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("log.csv"), "time,speed\n0,1\n1,2\n").unwrap();
    std::fs::write(folder.path().join("map.toml"), "speed = { column = \"speed\", unit = \"Nm\" }\n").unwrap();
    std::fs::write(folder.path().join("start.json"), "{\"rolling.coefficient\": \"x\"}").unwrap();
    std::fs::write(
        folder.path().join("other.json"),
        "{\"format_version\": 1, \"vehicle\": \"wheelchair\", \"parameters\": {}}",
    )
    .unwrap();
    std::fs::write(folder.path().join("newer.json"), "{\"format_version\": 99, \"parameters\": {}}").unwrap();
    for (arguments, words) in [
        ("fit nursing-robot log.csv --out log.csv", "log.csv: is an input"),
        (
            "fit nursing-robot log.csv --out nowhere/fit.json",
            "nowhere/fit.json: cannot be written: there is no directory 'nowhere'",
        ),
        ("fit nursing-robot log.csv --only ,", "--only: names no parameter"),
        ("fit nursing-robot log.csv --out .", "cannot be written: is a directory"),
        ("fit nursing-robot log.csv --columns none.toml", "none.toml: "),
        ("fit nursing-robot log.csv --params none.json", "none.json: "),
        ("fit nursing-robot log.csv --params start.json", "start.json: rolling.coefficient: "),
        ("fit nursing-robot log.csv --params other.json", "other.json: holds parameters of wheelchair"),
        ("fit nursing-robot log.csv --params newer.json", "newer.json: format_version 99"),
        ("fit nursing-robot log.csv --set rolling.coefficient=low", "rolling.coefficient: 'low' is not a number"),
        ("simulate nursing-robot --scenario none --out x.csv", "none"),
        (
            "simulate nursing-robot --scenario coughs --out x.dat",
            "x.dat: cannot be written: unknown ending; .csv, .parquet or .mf4 is expected",
        ),
        ("simulate nursing-robot --scenario coughs --set robot.mass=-5 --out x.csv", "robot.mass"),
        (
            "estimate nursing-robot log.csv --model a.urdf --sensors s.toml --out r.csv",
            "estimate is not available for nursing-robot",
        ),
        ("bench nursing-robot --model a.urdf --sensors s.toml --steps 3", "bench is not available for nursing-robot"),
    ] {
        assert_refused(folder.path(), arguments, words);
    }
}

#[test]
fn wrong_usage_ends_with_2_and_help_with_0() {
    let folder = TempDir::new().unwrap();
    for arguments in [
        "fit",
        "fit nursing-robot",
        "fit boat log.csv",
        "fit wheelchair log.csv --loss l3",
        "simulate wheelchair",
        "fit wheelchair log.csv --set mass",
    ] {
        assert_refused(folder.path(), arguments, "--help shows the usage");
    }
    assert_refused(folder.path(), "fit boat log.csv", "'boat' for '<VEHICLE>' [possible values: nursing-robot");
    assert_refused(folder.path(), "bench human-dynamics --model a --sensors b --steps 0", "--steps");
    for command in ["fit", "tune", "simulate", "convert", "estimate", "bench"] {
        let output = identify(folder.path(), &format!("{command} --help"));
        let help = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(help.contains("Examples:") && help.contains(&format!("identify {command} ")), "{help}");
        assert!(help.lines().all(|line| line.chars().count() <= 110), "{help}");
    }
    let help = text(&identify(folder.path(), "--help").stdout);
    assert!(help.contains("Exit codes:") && help.contains("Examples:"), "{help}");
    for vehicle in ["nursing-robot", "wheeled-robot", "wheel-loader", "human-dynamics", "wheelchair"] {
        assert!(text(&identify(folder.path(), "fit --help").stdout).contains(vehicle));
    }
}

#[test]
fn a_simulated_log_is_the_same_in_every_format_and_for_every_run() {
    let folder = TempDir::new().unwrap();
    let run = |name: &str, seed: u32| {
        let arguments = format!("simulate nursing-robot --scenario smooth-start --seed {seed} --out {name}");
        let output = identify(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(text(&output.stdout).starts_with(name), "{}", text(&output.stdout));
    };
    for name in ["a.csv", "b.csv", "c.parquet", "d.mf4"] {
        run(name, 5);
    }
    run("other.csv", 6);
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.csv") == bytes("b.csv"), "the same seed makes the same log");
    assert!(bytes("a.csv") != bytes("other.csv"), "another seed makes another log");
    for name in ["c.parquet", "d.mf4"] {
        let output = identify(folder.path(), &format!("convert nursing-robot {name} --out back.csv"));
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(bytes("a.csv") == bytes("back.csv"), "{name}");
    }
    let header = text(&bytes("a.csv")).lines().next().unwrap().to_owned();
    assert!(header.starts_with("time,") && header.contains(",speed") && header.contains("true_"), "{header}");
}

#[test]
fn scenarios_are_listed() {
    let folder = TempDir::new().unwrap();
    let output = identify(folder.path(), "simulate nursing-robot --list");
    let list = text(&output.stdout);
    for scenario in
        ["smooth-start", "abrupt-start", "coughs", "new-patient", "load-drop", "release", "lean", "identification"]
    {
        assert!(list.lines().any(|line| line.starts_with(scenario)), "{list}");
    }
    assert_refused(folder.path(), "simulate nursing-robot --scenario sine --out x.csv", "smooth-start");
}

#[test]
fn a_misspelt_channel_in_a_map_is_pointed_out() {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("log.csv"), "time,a,b\n0,1,1\n1,2,1\n").unwrap();
    std::fs::write(folder.path().join("map.toml"), "torque_lef = \"a\"\nambient = \"b\"\n").unwrap();
    let output = identify(folder.path(), "convert nursing-robot log.csv --columns map.toml --out x.csv");
    assert_eq!(output.status.code(), Some(0));
    let note = text(&output.stderr);
    assert!(note.contains("torque_lef in the column map is not an input of nursing-robot; torque_left is"), "{note}");
    std::fs::write(folder.path().join("map.toml"), "speed = { column = \"a\", unit = \"Nm\" }\n").unwrap();
    assert_refused(
        folder.path(),
        "fit nursing-robot log.csv --columns map.toml --out fit.json",
        "map.toml: speed: the unit leads to N.m, but nursing-robot takes speed in m/s",
    );
}

#[test]
fn a_fit_writes_all_its_files_and_starts_from_an_earlier_one() {
    let folder = TempDir::new().unwrap();
    let log = "simulate nursing-robot --scenario identification --seed 4 --out log.csv";
    assert_eq!(identify(folder.path(), log).status.code(), Some(0));
    let output = identify(folder.path(), "fit nursing-robot log.csv --out fit.json --ssv fit.ssv --report fit.html");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "", "no progress bar without a terminal");
    assert_eq!(files(folder.path()), ["fit.html", "fit.json", "fit.ssv", "log.csv"]);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&read("fit.json")).unwrap();
    assert_eq!(json["vehicle"], "nursing-robot");
    assert_eq!(json["logs"][0]["file"], "log.csv");
    let table = text(&output.stdout);
    for (name, parameter) in json["parameters"].as_object().unwrap() {
        assert!(table.contains(name.as_str()) && read("fit.html").contains(name.as_str()), "{name}");
        let identified = parameter["identified"] == true;
        assert_eq!(read("fit.ssv").contains(&format!("name=\"{name}\"")), identified, "{name}");
    }
    let stiffness = json["parameters"]["human.stiffness_pitch"]["value"].as_f64().unwrap();
    let told = identify(
        folder.path(),
        &format!("fit nursing-robot log.csv --set human.stiffness_pitch={stiffness} --out told.json"),
    );
    assert_eq!(told.status.code(), Some(0), "{}", text(&told.stdout));
    let held: serde_json::Value = serde_json::from_str(&read("told.json")).unwrap();
    assert!(
        held["parameters"]["human.stiffness_pitch"].is_null() && held["settings"]["human.stiffness_pitch"] == stiffness
    );
    let told = identify(folder.path(), "fit nursing-robot log.csv --set human.stiffness_pitch=1000");
    assert_eq!(told.status.code(), Some(1));
    assert!(text(&told.stdout).contains("human.stiffness_pitch = 1000 was given, but the logs contradict it"));
    let again = "fit nursing-robot log.csv --params fit.json --only rolling.coefficient,robot.drive_efficiency --out again.json";
    assert!(matches!(identify(folder.path(), again).status.code(), Some(0 | 1)));
    let json: serde_json::Value = serde_json::from_str(&read("again.json")).unwrap();
    assert_eq!(json["parameters"].as_object().unwrap().len(), 2);
    for (arguments, words) in [
        ("--only no.such", "no.such"),
        ("--set robot.mas=3", "robot.mass"),
        ("--set robot.mass=-3", "robot.mass = -3"),
        ("--set mass.law=sometimes", "exponential"),
        ("--report new.json", "new.json: cannot be written: two outputs have this name"),
    ] {
        assert_refused(folder.path(), &format!("fit nursing-robot log.csv {arguments} --out new.json"), words);
    }
}

#[test]
fn a_log_without_excitation_ends_with_warnings() {
    let folder = TempDir::new().unwrap();
    let mut csv = "time,torque_left,torque_right,speed,yaw_rate,tilt,tilt_rate,roll,roll_rate\n".to_owned();
    for k in 0..4000 {
        csv += &format!("{},0,0,0,0,0,0,0,0\n", f64::from(k) / 100.0);
    }
    std::fs::write(folder.path().join("still.csv"), csv).unwrap();
    let output = identify(folder.path(), "fit nursing-robot still.csv --out fit.json --ssv fit.ssv --report fit.html");
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let json = std::fs::read_to_string(folder.path().join("fit.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let parameters = json["parameters"].as_object().unwrap();
    assert!(!parameters.is_empty() && parameters.values().all(|p| p["identified"] == false), "{json}");
    assert!(!json["warnings"].as_array().unwrap().is_empty());
    let ssv = std::fs::read_to_string(folder.path().join("fit.ssv")).unwrap();
    assert!(!ssv.contains("<ssv:Real"), "{ssv}");
}
