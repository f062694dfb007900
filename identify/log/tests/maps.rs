//! What a column map can say, against values worked out by hand.

use std::fs;
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Log};

fn mapped(text: &str, map: &str) -> Result<Log, String> {
    let map = ColumnMap::parse("map.toml", map).map_err(|e| e.to_string())?;
    Log::from_csv("log.csv", text.as_bytes(), Some(&map)).map_err(|e| e.to_string())
}

const WHEELS: &str = "time,v_rl,v_rr,motor-torque,n\n0,1,3,5,60\n0.5,2,4,6,60\n1,4,8,7,120\n";

#[test]
fn a_bare_text_is_a_column_or_else_a_formula() {
    let log = mapped(WHEELS, "speed = \"(v_rl + v_rr) / 2\"\ntorque_left = \"motor-torque\"\n").unwrap();
    assert_eq!(log.channel("speed"), Some(&[2.0, 3.0, 6.0][..]));
    assert_eq!(log.channel("torque_left"), Some(&[5.0, 6.0, 7.0][..]));
    let error = mapped(WHEELS, "speed = \"(v_rl + v_fr) / 2\"").unwrap_err();
    assert!(error.contains("map.toml: speed: log.csv has no column 'v_fr'"), "{error}");
}

#[test]
fn the_first_column_that_exists_is_taken_and_optional_ones_may_lack() {
    let log =
        mapped(WHEELS, "speed = [\"v_gps\", \"v_rr\", \"v_rl\"]\nx = { column = [\"a\", \"b\"], optional = true }")
            .unwrap();
    assert_eq!(log.channel("speed"), Some(&[3.0, 4.0, 8.0][..]));
    assert!(log.channel("x").is_none() && log.notes[0].contains("'a', 'b'"), "{:?}", log.notes);
    let error = mapped(WHEELS, "speed = [\"v_gps\", \"v_ins\"]").unwrap_err();
    assert!(error.contains("none of the columns 'v_gps', 'v_ins'"), "{error}");
}

#[test]
fn a_radius_turns_rotation_into_motion() {
    let log = mapped(WHEELS, "speed = { column = \"n\", unit = \"rpm\", radius = 0.5 }").unwrap();
    let expected = [1.0, 1.0, 2.0].map(|turns| turns * std::f64::consts::TAU * 0.5);
    assert!(log.channel("speed").unwrap().iter().zip(expected).all(|(v, e)| (v - e).abs() < 1e-12));
    assert!(
        mapped(WHEELS, "speed = { column = \"n\", unit = \"N\", radius = 0.5 }")
            .unwrap_err()
            .contains("makes no sense of N")
    );
    assert!(mapped(WHEELS, "speed = { column = \"n\", unit = \"rpm\", radius = -1 }").unwrap_err().contains("radius"));
}

#[test]
fn a_speed_becomes_an_angle_and_an_angle_a_rate() {
    // The integral of 1, 2, 4 over half seconds by the trapezoidal rule: 0, 0.75, 2.25.
    let log = mapped(WHEELS, "encoder_left = { column = \"v_rl\", unit = \"rad/s\", integrate = true }").unwrap();
    assert_eq!(log.channel("encoder_left"), Some(&[0.0, 0.75, 2.25][..]));
    // A parabola's derivative is exact between its ends.
    let text = "time,x\n0,0\n0.5,0.25\n1.5,2.25\n2,4\n";
    let log = mapped(text, "speed = { column = \"x\", unit = \"m\", differentiate = true }").unwrap();
    let speed = log.channel("speed").unwrap();
    assert!((speed[1] - 1.0).abs() < 1e-12 && (speed[2] - 3.0).abs() < 1e-12, "{speed:?}");
    let units = ColumnMap::parse("m", "a = { column = \"x\", unit = \"deg\", differentiate = true }").unwrap();
    assert_eq!(units.units().collect::<Vec<_>>(), [("a", "rad/s")]);
    assert!(mapped(text, "a = { column = \"x\", unit = \"N\", integrate = true }").is_err());
}

#[test]
fn an_integral_bridges_short_gaps_and_refuses_long_ones() {
    let rows = |lost: std::ops::Range<i32>| {
        let row = |k: i32| {
            format!("{},{}\n", 0.01 * f64::from(k), if lost.contains(&k) { String::new() } else { "2".to_owned() })
        };
        "time,w\n".to_owned() + &(0..100).map(row).collect::<String>()
    };
    let map = "encoder_left = { column = \"w\", unit = \"rad/s\", integrate = true }";
    let log = mapped(&rows(40..45), map).unwrap();
    let angle = log.channel("encoder_left").unwrap();
    assert!(angle[42].is_nan() && (angle[99] - 1.98).abs() < 1e-12, "{angle:?}");
    let error = mapped(&rows(40..60), map).unwrap_err();
    assert!(error.contains("no sample from 0.39 s to 0.6 s"), "{error}");
}

#[test]
fn another_file_is_joined_on_its_own_clock() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("trip7.csv", "time,speed\n10,1\n10.1,2\n10.2,3\n10.3,4\n");
    write("trip7_gps.csv", "t [ms],speed\n350,0.5\n550,0.7\n");
    write(
        "map.toml",
        "join = [{ file = \"{stem}_gps.csv\", time = \"t\", offset = 9.65, as = \"gps\" }]\n\
                       heading = { column = \"gps/speed\", between = \"linear\" }\nspeed = \"0/speed\"\n",
    );
    let map = ColumnMap::read(&folder.path().join("map.toml")).unwrap();
    let log = Log::read(&folder.path().join("trip7.csv"), Some(&map), &Progress::none()).unwrap();
    assert_eq!(log.channel("speed"), Some(&[1.0, 2.0, 3.0, 4.0][..]));
    let heading = log.channel("heading").unwrap();
    assert!((heading[0] - 0.5).abs() < 1e-9 && (heading[1] - 0.6).abs() < 1e-6 && heading[3].is_nan(), "{heading:?}");
    let error = Log::read(&folder.path().join("trip8.csv"), Some(&map), &Progress::none()).unwrap_err().to_string();
    assert!(error.contains("trip8.csv"), "{error}");
}

#[test]
fn what_a_map_cannot_say_is_refused_with_its_key() {
    for (map, expected) in [
        ("speed = { column = \"v_rl\", between = \"cubic\" }", "map.toml: speed: between 'cubic' is not known"),
        ("between = \"no\"", "map.toml: between: between 'no'"),
        ("speed = { column = \"v_rl\", integrate = true, differentiate = true }", "exclude each other"),
        ("speed = { expression = \"v_rl\", group = 1 }", "group goes with a column"),
        ("speed = []", "the list of columns is empty"),
        ("speed = { column = -1 }", "not a place"),
        ("time = { column = \"time\", integrate = true }", "map.toml: time: needs a column"),
        ("join = \"gps.csv\"", "map.toml: join: "),
        ("join = [{ file = \"a.csv\", offest = 1 }]", "unknown key 'offest'"),
        ("[csv]\nseparator = \"ab\"", "single character"),
        ("[csv]\nencoding = \"ebcdic\"", "encoding 'ebcdic'"),
        ("[csv]\ndecimal = \";\"", "decimal must be"),
        ("speed = { column = 9 }", "no column number 9"),
    ] {
        let error = mapped(WHEELS, map).expect_err(map);
        assert!(error.contains(expected) && error.lines().count() == 1, "{error:?} instead of {expected:?}");
    }
}
