//! MDF4 files as loggers write them. Each test is named after what it caught.

use crate::measurement::{ANGLE, Channel, File, Group, MASTER, TEXT, UNSIGNED, double, record, time};
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Input, Log};

const INPUTS: [Input; 2] = [Input { name: "speed", unit: "m/s" }, Input { name: "torque_left", unit: "N.m" }];

fn read(file: &File, map: Option<&str>) -> Result<Log, String> {
    let folder = TempDir::new().unwrap();
    let path = file.save(folder.path());
    let map = map.map(|map| ColumnMap::parse("map.toml", map).unwrap());
    let log = Log::read_inputs(&path, map.as_ref(), &INPUTS, &|_| true, &Progress::none());
    log.map_err(|e| e.to_string().replace(&path.display().to_string(), "log.mf4"))
}

fn values<'a>(log: &'a Log, name: &str) -> &'a [f64] {
    log.channel(name).unwrap_or_else(|| panic!("no {name} in {:?}", log.channels))
}

/// Ten samples at 100 Hz: a time, a torque of 5 N.m and a speed of 36, 37, ... in the unit.
fn drive(unit: &'static str) -> Group {
    let records = (0..10).map(|k| record(&[0.01 * f64::from(k), 5.0, 36.0 + f64::from(k)])).collect();
    Group::new("drive", vec![time(), double("torque_left", "Nm"), double("speed", unit)], records)
}

fn speeds() -> Vec<f64> {
    (0..10).map(|k| 36.0 + f64::from(k)).collect()
}

#[test]
fn a_record_across_two_data_blocks_shifts_and_loses_nothing() {
    for cut in [24 * 5 + 8, 24 * 9 + 8, 24 * 3 + 1, 0, 240] {
        let log = read(&File::new().group(&drive("m/s"), &[cut]), None).unwrap();
        assert_eq!(values(&log, "speed"), speeds(), "cut at {cut}");
        assert_eq!(values(&log, "torque_left"), [5.0; 10]);
    }
    let cuts: Vec<usize> = (1..240).step_by(7).collect();
    assert_eq!(values(&read(&File::new().group(&drive("m/s"), &cuts), None).unwrap(), "speed"), speeds());
}

#[test]
fn an_unknown_unit_is_refused_with_the_nearest_ones_unless_the_map_gives_one() {
    let file = File::new().group(&drive("KM/H"), &[]);
    let error = read(&file, None).unwrap_err();
    assert!(error.contains("'speed'") && error.contains("'KM/H'") && error.contains("km/h"), "{error}");
    let log = read(&file, Some("speed = { column = \"speed\", unit = \"km/h\" }")).unwrap();
    assert!((values(&log, "speed")[0] - 10.0).abs() < 1e-12);
    // Nobody needs this column.
    let log = read(&file, Some("x = \"torque_left\"\nspeed = { value = 1 }")).unwrap();
    assert_eq!(values(&log, "speed")[0], 1.0);
}

#[test]
fn a_unit_of_another_quantity_is_refused() {
    let file = File::new().group(&drive("rpm"), &[]);
    let error = read(&file, None).unwrap_err();
    assert!(error.contains("rad/s") && error.contains("m/s") && error.contains("'speed'"), "{error}");
    let log = read(&file, Some("speed = { column = \"speed\", radius = 0.5 }")).unwrap();
    assert!((values(&log, "speed")[0] - 0.5 * 36.0 * std::f64::consts::PI / 30.0).abs() < 1e-12);
    assert!(read(&file, Some("speed = \"speed\"")).unwrap_err().starts_with("map.toml: speed: "));
}

#[test]
fn a_scale_without_a_unit_is_refused_where_the_file_states_anything_but_si() {
    let file = File::new().group(&drive("km/h"), &[]);
    let error = read(&file, Some("speed = { column = \"speed\", scale = 2 }")).unwrap_err();
    assert!(error.contains("unit = \"km/h\"") && error.contains("unit = \"m/s\""), "{error}");
    let error = read(&file, Some("speed = \"speed * 2\"")).unwrap_err();
    assert!(error.contains("km/h") && error.contains("unit"), "{error}");
    let log = read(&file, Some("speed = { expression = \"speed * 2\", unit = \"km/h\" }")).unwrap();
    assert!((values(&log, "speed")[0] - 20.0).abs() < 1e-12);
    assert!((values(&read(&file, Some("speed = \"speed\"")).unwrap(), "speed")[0] - 10.0).abs() < 1e-12);
}

#[test]
fn a_group_over_an_angle_is_never_the_time_base() {
    let angle = Channel { kind: MASTER, sync: ANGLE, ..double("angle", "rad") };
    let rows = (0..90).map(|k| record(&[0.001 * f64::from(k), 1.0])).collect();
    let engine = Group::new("engine", vec![angle, double("pressure", "bar")], rows);
    let file = File::new().group(&drive("m/s"), &[]).group(&engine, &[]);
    let log = read(&file, None).unwrap();
    assert_eq!(log.len(), 10);
    assert!(log.channel("pressure").is_none());
    assert!(log.notes.iter().any(|note| note.contains("pressure") && note.contains("angle")), "{:?}", log.notes);
    let error = read(&file, Some("x = \"pressure\"")).unwrap_err();
    assert!(error.contains("group 1") && error.contains("pressure") && error.contains("angle"), "{error}");
}

#[test]
fn floats_of_16_bits_are_numbers() {
    let speed = Channel { bits: 16, ..double("speed", "m/s") };
    // IEEE 754 binary16 of 36, 37 and 0.5.
    let halves = [0x5080_u16, 0x50a0, 0x3800];
    let rows = halves.iter().enumerate().map(|(k, half)| [record(&[k as f64]), half.to_le_bytes().to_vec()].concat());
    let file = File::new().group(&Group::new("", vec![time(), speed], rows.collect()), &[]);
    assert_eq!(values(&read(&file, None).unwrap(), "speed"), [36.0, 37.0, 0.5]);
}

#[test]
fn a_channel_with_texts_for_values_is_a_number_in_conditions_and_columns() {
    let gear = Channel { data: UNSIGNED, bits: 8, texts: vec![(0.0, "P"), (1.0, "D")], ..double("gear", "") };
    let rows = (0..4_u8).map(|k| [record(&[f64::from(k), 7.0]), vec![k % 2]].concat()).collect();
    let file = File::new().group(&Group::new("", vec![time(), double("speed", "m/s"), gear], rows), &[]);
    let log = read(&file, Some("speed = { column = \"speed\", missing_if = \"gear == 0\" }")).unwrap();
    let speed = values(&log, "speed");
    assert!(speed[0].is_nan() && speed[1] == 7.0 && speed[2].is_nan() && speed[3] == 7.0, "{speed:?}");
    assert_eq!(values(&log, "gear"), [0.0, 1.0, 0.0, 1.0]);
}

#[test]
fn text_channels_are_left_out_and_named() {
    let note = Channel { data: TEXT, bits: 32, ..double("note", "") };
    let rows = (0..4).map(|k| [record(&[f64::from(k), 7.0]), b"text".to_vec()].concat()).collect();
    let file = File::new().group(&Group::new("", vec![time(), double("speed", "m/s"), note], rows), &[]);
    let log = read(&file, None).unwrap();
    assert!(log.notes.iter().any(|line| line.contains("note (text)")), "{:?}", log.notes);
    assert!(read(&file, Some("x = \"note\"")).unwrap_err().contains("'note' holds text"));
}

#[test]
fn groups_without_time_or_with_events_at_one_time_refuse_nothing_that_is_used() {
    let constants = Group::new("constants", vec![double("vehicle_mass", "kg")], vec![record(&[1500.0])]);
    let events =
        Group::new("events", vec![time(), double("event", "")], vec![record(&[0.05, 1.0]), record(&[0.05, 2.0])]);
    let file = File::new().group(&drive("m/s"), &[]).group(&constants, &[]).group(&events, &[]);
    let log = read(&file, None).unwrap();
    assert_eq!(values(&log, "speed"), speeds());
    for (column, what) in [("vehicle_mass", "no time channel"), ("event", "does not increase at sample 2")] {
        let error = read(&file, Some(&format!("x = \"{column}\""))).unwrap_err();
        assert!(error.contains(what) && error.contains(column) && error.contains("group "), "{error}");
    }
}

#[test]
fn a_channel_that_stands_in_two_groups_is_chosen_by_group() {
    let slow = vec![record(&[0.0, 1.0]), record(&[0.05, 2.0])];
    let gps = Group::new("gps", vec![time(), double("speed", "m/s")], slow);
    let file = File::new().group(&drive("m/s"), &[]).group(&gps, &[]);
    let error = read(&file, None).unwrap_err();
    assert!(
        error.contains("group 0 ('drive')") && error.contains("group 1 ('gps')") && error.contains("0/speed"),
        "{error}"
    );
    for map in [
        "\"gps/speed\"",
        "\"1/speed\"",
        "{ column = \"speed\", group = 1 }",
        "{ column = \"speed\", group = \"gps\" }",
        "{ column = 1, group = 1 }",
    ] {
        let log = read(&file, Some(&format!("speed = {map}\ntorque_left = \"torque_left\""))).unwrap();
        let speed = values(&log, "speed");
        assert!(speed[0] == 1.0 && speed[5] == 2.0 && speed[1].is_nan(), "{map}: {speed:?}");
    }
    let log = read(&file, Some("time = \"gps/time\"\nspeed = \"drive/speed\"")).unwrap();
    assert_eq!((log.time.as_slice(), values(&log, "speed")), (&[0.0, 0.05][..], &[36.0, 41.0][..]));
    assert!(read(&file, Some("speed = \"gsp/speed\"")).unwrap_err().contains("no column 'gsp/speed'"));
    assert!(read(&file, Some("speed = { column = \"speed\", group = 7 }")).unwrap_err().contains("no group 7"));
}

#[test]
fn slower_groups_are_never_held_unless_the_map_says_so() {
    let rows = (0..4).map(|k| record(&[0.03 * f64::from(k), f64::from(k)])).collect();
    let gps = Group::new("gps", vec![time(), double("heading", "rad")], rows);
    let file = File::new().group(&drive("m/s"), &[]).group(&gps, &[]);
    let log = read(&file, Some("heading = \"heading\"")).unwrap();
    let present: Vec<bool> = values(&log, "heading").iter().map(|value| !value.is_nan()).collect();
    assert_eq!(present, [true, false, false, true, false, false, true, false, false, true]);
    assert!(log.notes.iter().any(|note| note.contains("heading") && note.contains("between")), "{:?}", log.notes);
    let with = |how: &str| {
        let log = read(&file, Some(&format!("heading = {{ column = \"heading\", between = \"{how}\" }}"))).unwrap();
        assert!(log.notes.is_empty(), "{:?}", log.notes);
        values(&log, "heading").to_vec()
    };
    assert_eq!(with("hold")[..5], [0.0, 0.0, 0.0, 1.0, 1.0]);
    assert_eq!(with("nearest")[..5], [0.0, 0.0, 1.0, 1.0, 1.0]);
    let linear = with("linear");
    assert!(linear.iter().enumerate().all(|(k, value)| (value - k as f64 / 3.0).abs() < 1e-9), "{linear:?}");
}

/// Two groups in one data block, records in turn.
fn interleaved() -> File {
    let slow: Vec<_> = (0..5).map(|k| record(&[0.02 * f64::from(k), f64::from(k)])).collect();
    let gps = Group::new("gps", vec![time(), double("heading", "rad")], slow);
    let order: Vec<usize> = (0..10).flat_map(|k| if k % 2 == 0 { vec![0, 1] } else { vec![0] }).collect();
    File::new().unsorted(&[drive("m/s"), gps], &order)
}

#[test]
fn unsorted_records_are_sorted_out() {
    let log = read(&interleaved(), Some("heading = \"heading\"")).unwrap();
    assert_eq!(values(&log, "speed"), speeds());
    let heading: Vec<_> = values(&log, "heading").iter().step_by(2).copied().collect();
    assert_eq!(heading, [0.0, 1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn what_a_logger_without_power_left_is_finished_and_said() {
    let whole = interleaved().unfinished();
    for lost in [0, 3] {
        let mut file = File::new();
        file.bytes = whole.bytes[..whole.bytes.len() - lost].to_vec();
        let log = read(&file, None).unwrap();
        assert_eq!(values(&log, "speed"), &speeds()[..if lost == 0 { 10 } else { 9 }]);
        let note = log.notes.join("\n");
        assert!(
            note.contains("not finished") && note.contains("records counted") && note.contains("end of the file"),
            "{note}"
        );
        assert_eq!(note.contains("not written whole"), lost > 0, "{note}");
    }
    // The same file that claims to be whole is damaged.
    let mut cut = interleaved();
    cut.bytes.truncate(cut.bytes.len() - 3);
    assert!(read(&cut, None).is_err());
}

#[test]
fn invalidation_bits_make_samples_missing() {
    let speed = Channel { invalidation_bit: Some(9), ..double("speed", "m/s") };
    let rows = (0..6).map(|k| [record(&[f64::from(k), 3.0]), vec![0xff, if k % 2 == 0 { 2 } else { 0xfd }]].concat());
    let group = Group { invalidation_bytes: 2, ..Group::new("", vec![time(), speed], rows.collect()) };
    let log = read(&File::new().group(&group, &[]), None).unwrap();
    let missing: Vec<bool> = values(&log, "speed").iter().map(|value| value.is_nan()).collect();
    assert_eq!(missing, [true, false, true, false, true, false]);
}

#[test]
fn absurd_claims_are_refused_at_once() {
    // A group that claims 1e12 records, and one that claims them without storing anything.
    let mut file = File::new().group(&drive("m/s"), &[]);
    let group = (64..file.bytes.len()).step_by(8).find(|at| file.bytes[*at..].starts_with(b"##CG")).unwrap();
    file.bytes[group + 80..group + 88].copy_from_slice(&1_000_000_000_000_u64.to_le_bytes());
    assert!(read(&file, None).unwrap_err().contains("claims 1000000000000 records"));
    file.bytes[group + 96..group + 104].fill(0);
    assert!(read(&file, None).is_err());
}

#[test]
fn a_channel_name_broken_over_lines_leaves_a_refusal_on_one_line() {
    let group = Group::new("drive", vec![time(), double("wheel\ntorque", "Nm")], vec![record(&[0.0, 1.0]); 2]);
    let error = read(&File::new().group(&group, &[]), Some("speed = 'v'")).unwrap_err();
    assert!(error.lines().count() == 1 && error.contains("wheel\\ntorque"), "{error}");
}

/// A hundred thousand records of a sine and its time, more than is read at once.
fn long(name: &'static str) -> (Group, Vec<f64>) {
    let speed: Vec<f64> = (0..100_000).map(|k| f64::from(k).sin()).collect();
    let records = speed.iter().enumerate().map(|(k, speed)| record(&[k as f64, *speed])).collect();
    (Group::new("drive", vec![time(), double(name, "m/s")], records), speed)
}

#[test]
fn records_that_lie_across_pieces_of_a_long_block_are_whole() {
    // A record of 18 bytes divides no power of two.
    let (plain, speed) = long("speed");
    let flag = Channel { data: UNSIGNED, bits: 8, invalidation_bit: Some(3), ..double("flag", "") };
    let channels = [plain.channels, vec![flag]].concat();
    let tail = |k: usize| vec![(k % 251) as u8, if k.is_multiple_of(7) { 8 } else { 0 }];
    let records: Vec<_> = plain.records.into_iter().enumerate().map(|(k, bytes)| [bytes, tail(k)].concat()).collect();
    let group = Group { invalidation_bytes: 1, ..Group::new("drive", channels, records) };
    let log = read(&File::new().group(&group, &[1_000_003]), None).unwrap();
    assert_eq!(values(&log, "speed"), speed);
    let right = |(k, flag): (usize, &f64)| if k.is_multiple_of(7) { flag.is_nan() } else { *flag == (k % 251) as f64 };
    assert!(values(&log, "flag").iter().enumerate().all(right));
    assert_eq!(log.time[99_999], 99_999.0);
}

#[test]
fn long_unsorted_data_are_sorted_out_piece_by_piece() {
    let (fast, speed) = long("speed");
    let slow: Vec<_> = (0..10_000).map(|k| record(&[f64::from(10 * k), f64::from(k)])).collect();
    let gps = Group::new("gps", vec![time(), double("heading", "rad")], slow);
    let order: Vec<usize> =
        (0..100_000).flat_map(|k: usize| if k.is_multiple_of(10) { vec![0, 1] } else { vec![0] }).collect();
    let file = File::new().unsorted(&[fast, gps], &order);
    for file in [file.bytes.clone(), file.unfinished().bytes] {
        let mut whole = File::new();
        whole.bytes = file;
        let log = read(&whole, Some("heading = \"heading\"")).unwrap();
        assert_eq!(values(&log, "speed"), speed);
        assert!(values(&log, "heading").iter().step_by(10).enumerate().all(|(k, heading)| *heading == k as f64));
    }
}
