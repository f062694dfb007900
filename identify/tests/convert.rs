//! `identify convert` turns a foreign log into one that fmpy and the FMU read as it stands.

use assert_cmd::Command;
use std::fs;

fn convert(folder: &tempfile::TempDir, log: &str, out: &str) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("identify").unwrap();
    command.current_dir(folder).args(["convert", "nursing-robot", log, "--columns", "map.toml", "--out", out]).assert()
}

#[test]
fn names_units_and_missing_samples_are_translated() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("trip.csv"), "t,v,motor,note\n0,36,100,1\n0.1,3.6,100,2\n0.2,72,,3\n").unwrap();
    let map = "time = \"t\"\nspeed = { column = \"v\", unit = \"km/h\" }\n\
               torque_left = { column = \"motor\", scale = 2.5, missing_if = \"v < 10\" }\n";
    fs::write(folder.path().join("map.toml"), map).unwrap();
    convert(&folder, "trip.csv", "ride.csv").success();
    let ride = fs::read_to_string(folder.path().join("ride.csv")).unwrap();
    let mut reader = csv::Reader::from_reader(ride.as_bytes());
    let names: Vec<_> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let column = |name: &str| names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no {name} in {names:?}"));
    let rows: Vec<Vec<f64>> =
        reader.records().map(|r| r.unwrap().iter().map(|cell| cell.parse().unwrap()).collect()).collect();
    let torques: Vec<f64> = rows.iter().map(|row| row[column("torque_left")]).collect();
    assert_eq!(torques[0], 250.0);
    assert!(torques[1].is_nan() && torques[2].is_nan(), "{torques:?}");
    let speeds: Vec<f64> = rows.iter().map(|row| row[column("speed")]).collect();
    assert!((speeds[0] - 10.0).abs() < 1e-12 && (speeds[2] - 20.0).abs() < 1e-12, "{speeds:?}");
    assert_eq!(rows[2][column("note")], 3.0);
}

#[test]
fn the_log_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("map.toml"), "time = \"t\"\nspeed = \"v\"\n").unwrap();
    fs::write(folder.path().join("trip.csv"), "t,v\n0,1\n1,2\n").unwrap();
    let refused = convert(&folder, "trip.csv", "trip.csv").code(2);
    assert!(String::from_utf8_lossy(&refused.get_output().stderr).contains("would be overwritten"));
    assert_eq!(fs::read_to_string(folder.path().join("trip.csv")).unwrap(), "t,v\n0,1\n1,2\n");
}
