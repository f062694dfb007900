//! Logs from tables in memory: the rules of files hold.

use wheelstate_log::{ColumnMap, Input, Log, Samples, TableColumn};

fn column(name: &str, samples: Samples) -> TableColumn {
    TableColumn { name: name.to_owned(), samples }
}

fn numbers(name: &str, values: &[f64]) -> TableColumn {
    column(name, Samples::Numbers(values.to_vec()))
}

#[test]
fn a_table_and_a_file_with_the_same_numbers_give_the_same_log() {
    let map = ColumnMap::parse("map.toml", "time = 't_ms'\nspeed = { column = 'v', unit = 'km/h' }").unwrap();
    let table = vec![numbers("t_ms [ms]", &[0.0, 10.0]), numbers("v", &[3.6, 7.2]), numbers("gear", &[1.0, 2.0])];
    let file = Log::from_csv("ride", "t_ms [ms],v,gear\n0,3.6,1\n10,7.2,2\n".as_bytes(), Some(&map)).unwrap();
    let log = Log::from_table("ride", table, Some(&map), None).unwrap();
    assert_eq!((&log.time, &log.channels, &log.source), (&file.time, &file.channels, &file.source));
}

#[test]
fn units_of_inputs_are_checked_and_times_by_type_are_seconds() {
    let speed = [Input { name: "speed", unit: "m/s" }];
    let times = column("time", Samples::Times(vec![1.7e9, 1.7e9 + 0.5]));
    let wrong = vec![times.clone(), numbers("speed [rpm]", &[1.0, 2.0])];
    let told = Log::from_table("ride", wrong, None, Some(&speed)).unwrap_err().to_string();
    assert!(told.starts_with("ride: 'speed'") && told.contains("is taken in m/s"), "{told}");
    let log = Log::from_table("ride", vec![times, numbers("speed [km/h]", &[3.6, 7.2])], None, Some(&speed)).unwrap();
    assert_eq!((log.time[1] - log.time[0], log.channel("speed").unwrap()), (0.5, &[1.0, 2.0][..]));
}

#[test]
fn the_hash_of_a_table_is_that_of_names_and_samples() {
    let hash = |name: &str, value: f64| {
        let table = vec![numbers("time", &[0.0, 1.0]), numbers(name, &[0.0, value])];
        Log::from_table("ride", table, None, None).unwrap().sha256
    };
    assert_eq!(hash("speed", 1.0), hash("speed", 1.0));
    assert!(hash("speed", 1.0) != hash("speed", 1.5) && hash("speed", 1.0) != hash("tilt", 1.0));
}

#[test]
fn tables_that_are_no_log_are_refused_with_their_name() {
    let times = || numbers("time", &[0.0, 1.0]);
    for (table, words) in [
        (vec![times(), numbers("speed", &[1.0])], "'time' has 2 samples and 'speed' has 1"),
        (vec![numbers("time", &[0.0, 0.0])], "time"),
        (vec![numbers("speed", &[0.0, 0.0])], "time"),
        (vec![], "time"),
    ] {
        let told = Log::from_table("ride", table, None, None).unwrap_err().to_string();
        assert!(told.starts_with("ride: ") && told.contains(words), "{told}");
    }
}
