//! Logs: what is read is what was written, and what cannot be a log is refused with one line.

use proptest::prelude::*;
use std::fs::File;
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{Channel, ColumnMap, LONG, Log};

fn csv(text: &str) -> Result<Log, String> {
    Log::from_csv("log.csv", text.as_bytes(), None).map_err(|e| e.to_string())
}

fn mapped(text: &str, map: &str) -> Result<Log, String> {
    let map = ColumnMap::parse("map.toml", map).map_err(|e| e.to_string())?;
    Log::from_csv("log.csv", text.as_bytes(), Some(&map)).map_err(|e| e.to_string())
}

/// Equality in which NaN equals NaN, bit for bit otherwise.
fn assert_same(a: &Log, b: &Log) {
    assert_eq!(a.time, b.time);
    assert_eq!(a.channels.len(), b.channels.len());
    for (a, b) in a.channels.iter().zip(&b.channels) {
        assert_eq!(a.name, b.name);
        let same = a.values.iter().zip(&b.values).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan());
        assert!(same && a.values.len() == b.values.len(), "{}: {:?} and {:?}", a.name, a.values, b.values);
    }
}

fn awkward_log() -> Log {
    let mut log = Log { time: vec![1000.05, 1000.0500000000001, 1000.1, 2e9].into(), ..Log::default() };
    log.push("speed", vec![0.1, f64::NAN, -0.0, 1.0 / 3.0]);
    log.push("torque_left", vec![1e-300, 1e300, 5e-324, f64::MAX]);
    log.push("true_mass", vec![f64::NAN; 4]);
    log
}

fn round_trip(ending: &str, log: &Log) -> Log {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(format!("log.{ending}"));
    log.write(&path, File::create(&path).unwrap()).unwrap();
    Log::read(&path, None, &Progress::none()).unwrap()
}

#[test]
fn every_format_returns_the_same_bits() {
    for ending in ["csv", "parquet", "mf4"] {
        let log = awkward_log();
        let read = round_trip(ending, &log);
        assert_same(&log, &read);
        assert!(read.source.ends_with(ending));
        assert_eq!(read.sha256.len(), 64);
    }
}

#[test]
fn the_hash_is_that_of_the_file() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, "time,speed\n0,1\n1,2\n").unwrap();
    let log = Log::read(&path, None, &Progress::none()).unwrap();
    // printf 'time,speed\n0,1\n1,2\n' | sha256sum
    assert_eq!(log.sha256, "bba1342ed703487261dbe7cf203448e182f90cffce5d38997487ce9adbba092e");
}

#[test]
fn cells_may_be_empty_nan_quoted_spaced_or_truth_values() {
    let log =
        csv("\u{feff}\"time\", \"speed\" ,healthy,,x\r\n0,,True,1,inf\r\n\r\n0.5, 2.5e0 ,False,nan,-inf\r\n").unwrap();
    assert_eq!(log.time, [0.0, 0.5]);
    assert!(log.channel("speed").unwrap()[0].is_nan());
    assert_eq!(log.channel("speed").unwrap()[1], 2.5);
    assert_eq!(log.channel("healthy"), Some(&[1.0, 0.0][..]));
    assert_eq!(log.channel("column_4").unwrap()[0], 1.0);
    assert!(log.channel("x").unwrap().iter().all(|value| value.is_nan()));
}

#[test]
fn what_fmpy_writes_is_read_unchanged() {
    // Header and number format of fmpy's write_csv: names in quotes, str() of numpy scalars.
    let text = "\"time\",\"load_mass\",\"mass_valid\",\"status\"\n\
                0.0,0.0,False,1\n0.01,72.53000000000002,True,0\n0.02,nan,True,-3\n";
    let log = csv(text).unwrap();
    assert_eq!(log.channel("load_mass").unwrap()[1], 72.53000000000002);
    assert_eq!(log.channel("mass_valid"), Some(&[0.0, 1.0, 1.0][..]));
    assert_eq!(log.channel("status"), Some(&[1.0, 0.0, -3.0][..]));
}

#[test]
fn broken_files_are_refused_in_one_line_that_names_the_place() {
    for (text, expected) in [
        ("", "log.csv: the file is empty"),
        ("time,speed\n", "log.csv:1: there is a header but no sample"),
        ("time,speed\n0,1\n", "log.csv: only 1 sample; at least 2 are needed"),
        ("time,speed\n0,1\n0.1,abc\n", "log.csv:3: column 'speed': 'abc' is not a number"),
        ("time,speed\n0,1\n\n0.1,3;4\n", "log.csv:4: column 'speed': '3;4' is not a number"),
        ("time,speed\r\n0,1\r\n\r\n1,x", "log.csv:4: column 'speed': 'x' is not a number"),
        ("\n\ntime,speed\n0,1\n0.2,1\n0.1,1\n", "log.csv:6: the time runs backwards: 0.1 s after 0.2 s"),
        ("time,speed\n0,1\n0.2,1\n0.1,1\n", "log.csv:4: the time runs backwards: 0.1 s after 0.2 s"),
        ("time,speed\n0,1\n0,1\n", "log.csv:3: the time stands still: 0 s after 0 s"),
        ("time,speed\n0,1\nnan,1\n", "log.csv:3: the time is missing or not finite"),
        ("time,speed\n0,1\n,1\n", "log.csv:3: the time is missing or not finite"),
        ("time,speed\n0,1\ninf,1\n", "log.csv:3: the time is missing or not finite"),
        ("time,speed\n0,1\n1,2,3\n", "log.csv:3: 3 cells, but the header has 2 columns"),
        ("time,speed\n0,1\n1\n", "log.csv:3: 1 cells, but the header has 2 columns"),
        (
            "time,speed,speed\n0,1,2\n1,2,3\n",
            "log.csv:1: two columns are named 'speed'; a column map can choose by place: column = 2",
        ),
        ("t,speed\n0,1\n1,2\n", "no column 'time' (columns: t, speed)"),
        ("speed,tilt,t_stamp\n0,1,2\n1,2,3\n", "time = \"t_stamp\""),
        ("speed,tilt,torque\n0,1,2\n1,2,3\n", "time = \"...\""),
        ("\u{1f}\u{0}x", "is not a CSV file but binary"),
    ] {
        let error = csv(text).unwrap_err();
        assert!(error.contains(expected), "{error:?} instead of {expected:?}");
        assert!(error.starts_with("log.csv") && error.lines().count() == 1, "{error}");
    }
}

#[test]
fn control_characters_and_long_texts_do_not_reach_the_message() {
    let error = csv(&format!("time,speed\n0,\u{1b}[31m{}\n", "x".repeat(1000))).unwrap_err();
    assert!(error.len() < 120 && !error.contains('\u{1b}'), "{error}");
    let error = Log::from_csv("log.csv", &b"time,speed\n0,\xff\n"[..], None).unwrap_err().to_string();
    assert!(error.starts_with("log.csv:2: column 'speed'"), "{error}");
}

#[test]
fn files_that_are_no_logs_are_refused() {
    let folder = TempDir::new().unwrap();
    for (name, bytes, expected) in [
        ("log.csv.gz", &b"\x1f\x8b\x08"[..], "log.csv.gz: the packed file is damaged"),
        ("gzip.csv", b"\x1f\x8b\x08\0\0\0\n\n", "gzip.csv: the packed file is damaged"),
        ("sheet.csv", b"PK\x03\x04\x14\0\n\n", "sheet.csv: is not a CSV file but a zip archive"),
        ("log.csv.xz", b"\xfd7zXZ\0", "log.csv.xz: is compressed; unpack it first"),
        ("old.dat", b"MDF     3.30    ", "MDF 3 or another older format"),
        (
            "old.mf4",
            b"MDF     3.30    TGT 1.0                                         ",
            "it is MDF 3.30, of an older generation",
        ),
        ("trip.bag", b"#ROSBAG V2.0\n", "a bag of ROS 1"),
        ("log.txt", &b"time,x\n0,1\n1,2\n"[..], "unknown ending"),
        ("log.parquet", b"PAR1 this is not a parquet file PAR1", "log.parquet: "),
        ("empty.parquet", b"", "empty.parquet: "),
        ("log.mf4", b"MDF     4.10    this is not a measurement file", "not a readable MDF4 file"),
        ("empty.mf4", b"", "not a readable MDF4 file"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = Log::read(&path, None, &Progress::none()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.lines().count() == 1, "{error}");
    }
    for path in [folder.path().to_owned(), folder.path().join("none.csv"), folder.path().join("none.mf4")] {
        let error = Log::read(&path, None, &Progress::none()).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
    }
}

const DRIVE: &str = "t_ms,v_kmh,torque,note,amb\n0,36,10,go,20\n100,18,2,,20\n200,nan,10,stop,21\n";

#[test]
fn a_map_scales_converts_blanks_and_keeps_the_rest_aside() {
    let log = mapped(
        DRIVE,
        r#"
        time = { column = "t_ms", unit = "ms" }
        speed = { column = "v_kmh", unit = "km/h" }
        torque_left = { column = "torque", scale = 4.8325, missing_if = "v_kmh < 10.8 || torque <= 5" }
        torque_right = { column = "torque", scale = -1, offset = 0.5 }
        slope = { value = 0.02 }
        double = { expression = "2 * torque + {amb}" }
        "#,
    )
    .unwrap();
    assert_eq!(log.time, [0.0, 0.1, 0.2]);
    assert_eq!(log.channel("speed").unwrap()[..2], [10.0, 5.0]);
    let left = log.channel("torque_left").unwrap();
    // 2 N.m is too little; without a speed nobody knows, so that sample is missing as well.
    assert!((left[0] - 48.325).abs() < 1e-12 && left[1].is_nan() && left[2].is_nan(), "{left:?}");
    assert_eq!(log.channel("torque_right"), Some(&[-9.5, -1.5, -9.5][..]));
    assert_eq!(log.channel("slope"), Some(&[0.02; 3][..]));
    assert_eq!(log.channel("double"), Some(&[40.0, 24.0, 41.0][..]));
    assert_eq!(log.channel("amb"), Some(&[20.0, 20.0, 21.0][..]));
    assert!(log.channel("note").is_none(), "a column of text is left out");
    assert!(log.channel("v_kmh").is_none() && log.channel("torque").is_none());
}

#[test]
fn one_condition_can_hold_for_all_channels() {
    let map =
        "time = { column = \"t_ms\", unit = \"ms\" }\nmissing_if = \"amb > 20\"\nspeed = \"v_kmh\"\nx = \"torque\"\n";
    let log = mapped(DRIVE, map).unwrap();
    assert!(log.channel("x").unwrap()[2].is_nan() && log.channel("x").unwrap()[1] == 2.0);
}

#[test]
fn wrong_maps_are_refused_in_one_line_that_names_map_and_key() {
    for (map, expected) in [
        ("time = \"t_s\"", "map.toml: time: log.csv has no column 't_s'; did you mean 't_ms'?"),
        (
            "time = \"t_ms\"\nspeed = \"v_kmph\"",
            "map.toml: speed: log.csv has no column 'v_kmph'; did you mean 'v_kmh'?",
        ),
        (
            "time = \"t_ms\"\nspeed = { column = \"v_kmh\", unit = \"kmph\" }",
            "map.toml: speed: unknown unit 'kmph'; the nearest known ones are km/h",
        ),
        ("time = \"t_ms\"\nspeed = { colum = \"v_kmh\" }", "map.toml: speed: unknown key 'colum'"),
        ("time = \"t_ms\"\nspeed = { scale = 2 }", "map.toml: speed: exactly one of column, expression and value"),
        (
            "time = \"t_ms\"\nspeed = { column = \"v_kmh\", scale = \"2\" }",
            "map.toml: speed: scale = \"2\" is not a finite number",
        ),
        ("time = \"t_ms\"\nspeed = { column = \"v_kmh\", scale = 0 }", "map.toml: speed: scale = 0 would wipe"),
        ("time = \"t_ms\"\nspeed = 3", "map.toml: speed: a column name or a table"),
        (
            "time = \"t_ms\"\nspeed = { column = \"v_kmh\", missing_if = \"v_kmh <\" }",
            "map.toml: speed: missing_if: 'v_kmh <'",
        ),
        (
            "time = \"t_ms\"\nspeed = { column = \"v_kmh\", missing_if = \"brake > 0\" }",
            "map.toml: speed: log.csv has no column 'brake'",
        ),
        ("time = \"t_ms\"\nmissing_if = \"brake > 0\"", "map.toml: missing_if: log.csv has no column 'brake'"),
        ("time = \"t_ms\"\nspeed = \"note\"", "log.csv:2: column 'note': 'go' is not a number"),
        ("time = { value = 3 }", "map.toml: time: needs a column"),
        ("time = \"t_ms\"\nspeed = { column = ", "map.toml:2: "),
        ("speed = \"v_kmh\"", "map.toml: time: log.csv has no column 'time'"),
    ] {
        let error = mapped(DRIVE, map).expect_err(map);
        assert!(error.contains(expected) && error.lines().count() == 1, "{error:?} instead of {expected:?}");
    }
}

fn cell() -> impl Strategy<Value = f64> {
    prop_oneof![4 => any::<f64>().prop_filter("finite", |v| v.is_finite()), 1 => Just(f64::NAN)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        if let Err(error) = Log::from_csv("log.csv", &bytes[..], None) {
            let line = error.to_string();
            prop_assert!(line.starts_with("log.csv") && line.lines().count() == 1, "{}", line);
        }
    }

    #[test]
    fn almost_logs_never_panic(text in "time,[a-z]{1,3}(,[a-z ]{0,3}){0,3}\n([-0-9.eEnaif\" ,\r\n;]{0,200})") {
        let map = ColumnMap::parse("map.toml", "x = { column = \"a\", unit = \"deg\", missing_if = \"a < 1\" }").unwrap();
        for map in [None, Some(&map)] {
            match Log::from_csv("log.csv", text.as_bytes(), map) {
                Ok(log) => {
                    prop_assert!(log.len() >= 2);
                    prop_assert!(log.time.windows(2).all(|pair| pair[1] > pair[0]));
                    prop_assert!(log.channels.iter().all(|channel| channel.values.len() == log.len()));
                    prop_assert!(log.channels.iter().flat_map(|c| &c.values).all(|value| !value.is_infinite()));
                }
                Err(error) => prop_assert_eq!(error.to_string().lines().count(), 1),
            }
        }
    }

    #[test]
    fn any_log_survives_any_format(
        steps in prop::collection::vec(1e-6..1e3_f64, 2..40),
        seed in prop::collection::vec(cell(), 80),
    ) {
        let time: Vec<f64> = steps.iter().scan(-5.0, |t, step| { *t += step; Some(*t) }).collect();
        let column = |k: usize| (0..time.len()).map(|i| seed[(i * 7 + k * 13) % seed.len()]).collect();
        let channels = vec![
            Channel { name: "speed".to_owned(), values: column(0) },
            Channel { name: "a,b \"c\"".to_owned(), values: column(1) },
        ];
        let log = Log { time: time.clone().into(), channels, ..Log::default() };
        for ending in ["csv", "parquet", "mf4"] {
            assert_same(&log, &round_trip(ending, &log));
        }
    }

    #[test]
    fn arbitrary_maps_never_panic(text in "[a-z]{1,6} = [-{}a-z0-9=,\"<>|&!()*/+^. ]{0,60}\n?") {
        if let Err(error) = ColumnMap::parse("map.toml", &text) {
            prop_assert_eq!(error.to_string().lines().count(), 1);
        }
    }
}

/// Long logs stand in a file from a million samples on.
#[test]
fn a_long_log_is_read_as_it_was_written_and_a_fault_in_it_is_named() {
    let samples = LONG + 123_457;
    let value = |k: usize| if k % 1000 == 7 { f64::NAN } else { (k as f64 * 0.37).sin() };
    let mut log = Log { time: (0..samples).map(|k| k as f64 * 0.01).collect(), ..Log::default() };
    log.push("speed", (0..samples).map(value).collect::<Vec<_>>());
    log.push("slow [km/h]", (0..samples).map(|k| 3.6 * (k % 100) as f64).collect::<Vec<_>>());
    let folder = TempDir::new().unwrap();
    let read = |name: &str| Log::read(&folder.path().join(name), None, &Progress::none());
    let mut text = Vec::new();
    log.write_csv(&mut text).unwrap();
    text.extend_from_slice(b",,\n,,\n");
    std::fs::write(folder.path().join("long.csv"), &text).unwrap();
    let path = folder.path().join("long.parquet");
    log.write(&path, File::create(&path).unwrap()).unwrap();
    for name in ["long.csv", "long.parquet"] {
        let read = read(name).unwrap();
        assert_eq!(read.time, log.time);
        let speed = read.series("speed").unwrap();
        assert_eq!(speed.len(), samples);
        assert!(
            (0..samples).all(|k| speed[k].to_bits() == value(k).to_bits() || speed[k].is_nan() && value(k).is_nan())
        );
        let part = read.slice(LONG - 5..LONG + 5, |_| true);
        assert_eq!(part.time, log.time[LONG - 5..LONG + 5]);
        assert_eq!(read.duration(), log.duration());
    }
    let slow = read("long.csv").unwrap().series("slow").unwrap();
    assert!((0..samples).all(|k| (slow[k] - (k % 100) as f64).abs() < 1e-12));
    // The second row from the end once more: the time runs backwards in line 2 + samples.
    text.truncate(text.len() - 6);
    let row = text[..text.len() - 1].rsplit(|byte| *byte == b'\n').nth(1).unwrap().to_vec();
    text.extend_from_slice(&row);
    std::fs::write(folder.path().join("long.csv"), &text).unwrap();
    let error = read("long.csv").unwrap_err().to_string();
    assert!(error.contains(&format!("long.csv:{}: the time runs backwards", samples + 2)), "{error}");
}
