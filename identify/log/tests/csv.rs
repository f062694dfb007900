//! CSV files as spreadsheets and loggers write them: each dialect is read, and said in one line.

use flate2::{Compression, write::GzEncoder};
use std::io::Write;
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Input, Log};

const INPUTS: [Input; 2] = [Input { name: "speed", unit: "m/s" }, Input { name: "torque_left", unit: "N.m" }];

/// Reads the bytes of a file of this name for a machine with the inputs above.
fn read_as(name: &str, bytes: &[u8], map: Option<&str>) -> Result<Log, String> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let map = map.map(|map| ColumnMap::parse("map.toml", map).unwrap());
    let log = Log::read_inputs(&path, map.as_ref(), &INPUTS, &|_| true, &Progress::none());
    log.map_err(|e| e.to_string().replace(&path.display().to_string(), name))
}

fn read(bytes: impl AsRef<[u8]>, map: Option<&str>) -> Result<Log, String> {
    read_as("log.csv", bytes.as_ref(), map)
}

/// Time 0, 1 and speeds 1, 2, and a note that has this text.
fn assert_read(bytes: impl AsRef<[u8]>, note: &str) {
    let text = String::from_utf8_lossy(bytes.as_ref()).into_owned();
    let log = read(bytes, None).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert_eq!(log.time, [0.0, 1.0], "{text}");
    assert_eq!(log.channel("speed"), Some(&[1.0, 2.0][..]), "{text}");
    assert!(log.notes.join("\n").contains(note), "{:?} instead of {note:?}", log.notes);
}

#[test]
fn separators_and_decimal_commas_are_seen_and_said() {
    assert_read("time;speed\n0;1\n1;2\n", "';' between columns");
    assert_read("time;speed\n0,0;1,0\n1,0;2,0\n", "a decimal comma");
    assert_read("time;speed (a,b);speed\n0,0;5;1,0\n1,0;5;2,0\n", "a decimal comma");
    assert_read("time\tspeed\n0\t1\n1\t2\n", "a tab between columns");
    assert_read("time|speed\n0|1\n1|2\n", "'|' between columns");
    assert_read("sep=;\ntime;speed\n0;1\n1;2\n", "");
    assert_read("\"time\",\"speed\"\n\"0,0\",\"1,0\"\n\"1,0\",\"2,0\"\n", "a decimal comma");
    assert_read("time,speed\n0,1\n1,2\n", "");
    // With thousands between points nobody knows what is meant.
    let error = read("time;speed\n0;1.000,5\n1;2\n", None).unwrap_err();
    assert!(error.starts_with("log.csv:2: column 'speed'"), "{error}");
}

#[test]
fn units_under_and_in_the_header_are_applied() {
    let kmh = |log: Log| log.channel("speed").unwrap().iter().map(|v| v * 3.6).collect::<Vec<_>>();
    for text in [
        "time,speed\ns,km/h\n0,36\n1,72\n",
        "time [s],speed [km/h]\n0,36\n1,72\n",
        "time (s);speed (km/h)\n0;36\n1;72\n",
    ] {
        let speed = kmh(read(text, None).unwrap());
        assert!((speed[0] - 36.0).abs() < 1e-12 && (speed[1] - 72.0).abs() < 1e-12, "{text}");
        let speed = kmh(read(text, Some("speed = \"speed\"")).unwrap());
        assert!((speed[0] - 36.0).abs() < 1e-12, "{text}");
    }
    assert_read("time,speed\ns,m/s\n0,1\n1,2\n", "units in the line under the header");
    assert_eq!(read("time [ms],speed\n0,1\n10,2\n", None).unwrap().time, [0.0, 0.01]);
    for (text, expected) in [
        ("time,speed [furlong]\n0,1\n1,2\n", "unknown unit 'furlong'"),
        ("time,speed [rpm]\n0,1\n1,2\n", "is recorded in rpm (rad/s), but speed is taken in m/s; radius"),
        ("time [m],speed\n0,1\n1,2\n", "time 'time': is recorded in m"),
    ] {
        let error = read(text, None).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    // The whole text of the header names the column, too.
    let log =
        read("time,speed [km/h]\n0,36\n1,72\n", Some("speed = { column = \"speed [km/h]\", unit = \"m/s\" }")).unwrap();
    assert_eq!(log.channel("speed"), Some(&[36.0, 72.0][..]));
}

#[test]
fn iso_times_become_seconds() {
    let log = read("time,speed\n2024-05-06T12:00:00.000Z,1\n2024-05-06T12:00:00.010Z,2\n", None).unwrap();
    assert_eq!(log.time, [1_714_996_800.0, 1_714_996_800.01]);
    assert!(log.notes[0].contains("1970"), "{:?}", log.notes);
    let error = read(
        "t,speed\n2024-05-06 12:00:00,1\n2024-05-06 12:00:01,2\n",
        Some("time = { column = \"t\", unit = \"ms\" }"),
    );
    assert!(error.unwrap_err().contains("times by its type"));
    let error = read("time,speed\n0,2024-05-06 12:00:00\n1,2024-05-06 12:00:01\n", None).unwrap_err();
    assert!(error.contains("recorded in s"), "{error}");
}

#[test]
fn markers_of_missing_samples_and_truth_values_are_read() {
    let log = read("time,speed,ok\n0,NA,TRUE\n1,#N/A,FALSE\n2,null,true\n3,4,False\n", None).unwrap();
    let speed = log.channel("speed").unwrap();
    assert!(speed[..3].iter().all(|value| value.is_nan()) && speed[3] == 4.0);
    assert_eq!(log.channel("ok"), Some(&[1.0, 0.0, 1.0, 0.0][..]));
    let log = read("time,speed\n0,-999\n1,2\n", Some("[csv]\nmissing = [\"-999\"]")).unwrap();
    assert!(log.channel("speed").unwrap()[0].is_nan());
}

#[test]
fn encodings_line_ends_and_comments_are_seen_and_said() {
    assert_read(b"Time [s];Temp [\xb0C];speed\n0;1;1\n1;1;2\n", "Latin-1 text");
    let wide = |text: &str, bytes: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(bytes).collect::<Vec<u8>>();
    let text = "time,speed,Größe\r\n0,1,5\r\n1,2,5\r\n";
    for mark in ["", "\u{feff}"] {
        assert_read(wide(&format!("{mark}{text}"), u16::to_le_bytes), "UTF-16 text");
        assert_read(wide(&format!("{mark}{text}"), u16::to_be_bytes), "UTF-16 text");
    }
    assert_eq!(read(wide(text, u16::to_le_bytes), None).unwrap().channel("Größe"), Some(&[5.0, 5.0][..]));
    assert_read("time,speed\r0,1\r1,2\r", "carriage return");
    assert_read("# logger 1.2\ntime,speed\n0,1\n# pause\n1,2\n", "'#' as comments");
    assert_read("% matlab\ntime,speed\n0,1\n1,2", "'%' as comments");
    assert_read("// logger\ntime,speed\n0,1\n1,2", "");
    // numpy.savetxt puts the header behind a comment sign.
    assert_read("# time,speed\n0.0,1.0\n1.0,2.0\n", "header in a comment");
    assert_read("\u{feff}time,speed\n0,1\n1,2\n", "");
}

#[test]
fn empty_rows_at_the_end_are_left_out_and_in_the_middle_named() {
    assert_read("time,speed\n0,1\n1,2\n,\n,\n", "2 empty rows at the end");
    assert_read("time,speed\n0,1,\n1,2,\n", "");
    let error = read("time,speed\n0,1\n,\n1,2\n", None).unwrap_err();
    assert_eq!(error, "log.csv:3: the time is missing or not finite");
}

#[test]
fn lines_are_counted_past_comments_and_lines_before_the_header() {
    let error = read("# a\n# b\ntime,speed\n0,1\n# c\n1,x\n", None).unwrap_err();
    assert!(error.starts_with("log.csv:6: "), "{error}");
    let text = "made by a logger\nserial 5\ntime,speed\n0,1\n1,x\n";
    let error = read(text, Some("[csv]\nskip = 2")).unwrap_err();
    assert!(error.starts_with("log.csv:5: "), "{error}");
    assert_eq!(read(text.replace('x', "2"), Some("[csv]\nskip = 2")).unwrap().channel("speed"), Some(&[1.0, 2.0][..]));
}

#[test]
fn columns_that_nobody_needs_refuse_nothing() {
    assert_read("time,speed,state\n0,1,idle\n1,2,run\n", "left out: state (text)");
    assert_read("time,speed,x,x\n0,1,0,0\n1,2,0,0\n", "");
    assert_read("time,speed,state\n0,1,5\n1,2,run\n", "left out: state (text)");
    let error = read("time,speed,speed\n0,1,2\n1,2,3\n", None).unwrap_err();
    assert!(error.starts_with("log.csv:1: columns 1 and 2") && error.contains("column = 2"), "{error}");
    let log = read("time,speed,speed\n0,1,2\n1,2,3\n", Some("speed = { column = 2 }")).unwrap();
    assert_eq!(log.channel("speed"), Some(&[2.0, 3.0][..]));
    let error = read("time,speed\n0,1\n1,run\n", None).unwrap_err();
    assert_eq!(error, "log.csv:3: column 'speed': 'run' is not a number");
}

#[test]
fn values_where_the_header_should_be_are_named() {
    let error = read("0,1\n1,2\n", None).unwrap_err();
    assert!(error.contains("log.csv:1: ") && error.contains("header"), "{error}");
}

fn packed(text: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn packed_files_are_unpacked_and_bombs_are_not() {
    let text = b"time,speed\n0,1\n1,2\n";
    for name in ["log.csv.gz", "log.csv"] {
        assert_eq!(read_as(name, &packed(text), None).unwrap().channel("speed"), Some(&[1.0, 2.0][..]));
    }
    let zst = zstd::encode_all(&text[..], 3).unwrap();
    let log = read_as("log.csv.zst", &zst, None).unwrap();
    assert_eq!(log.channel("speed"), Some(&[1.0, 2.0][..]));
    let mut cut = packed(&text.repeat(100));
    cut.truncate(cut.len() / 2);
    assert!(read_as("log.csv.gz", &cut, None).unwrap_err().contains("log.csv.gz: "));
}

#[test]
#[ignore = "unpacks a gigabyte; run with --ignored"]
fn a_file_that_unpacks_to_more_than_any_log_is_refused() {
    let mut encoder = zstd::Encoder::new(Vec::new(), 1).unwrap();
    encoder.write_all(b"time,speed\n0,1\n1,").unwrap();
    let noughts = vec![b'0'; 1 << 20];
    (0..1100).for_each(|_| encoder.write_all(&noughts).unwrap());
    let error = read_as("log.csv.zst", &encoder.finish().unwrap(), None).unwrap_err();
    assert!(error.contains("unpacks to more than"), "{error}");
}

#[test]
fn two_hundred_thousand_columns_take_time_in_proportion() {
    let text = |columns: usize| {
        format!("time{}\n0{}\n1{}\n", ",c".repeat(columns), ",1".repeat(columns), ",2".repeat(columns))
    };
    let took = |columns: usize| {
        let text = text(columns);
        let start = std::time::Instant::now();
        read(&text, None).unwrap();
        start.elapsed().as_secs_f64()
    };
    took(1_000);
    let (few, many) = (took(20_000), took(200_000));
    // Ten times the columns: in proportion ten times the time, and a hundred times if each looked at all others.
    assert!(many < 40.0 * few.max(0.01), "{few} s and {many} s");
}
