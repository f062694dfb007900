//! A log of which only the needed columns are read is the same log without the others.

use proptest::prelude::*;
use std::path::Path;
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Input, Log};

const INPUTS: [Input; 2] = [Input { name: "speed", unit: "m/s" }, Input { name: "torque_left", unit: "N.m" }];

/// Ways to point at columns `a` to `f`, `speed`, and those of the file that is joined.
const RULES: [&str; 11] = [
    "x = 'a'",
    "x = { column = 3, group = 0 }",
    "x = { column = 'b', group = 0 }",
    "x = ['nowhere', 'c']",
    "x = 'a + 2 * c'",
    "x = { expression = '{d} - missing(e)' }",
    "x = { column = 'a', missing_if = 'f < 0' }",
    "x = 'other/g'",
    "speed = { column = 'd', scale = 2.0 }",
    "x = '0/e'",
    "x = { column = 'nowhere', optional = true }",
];

fn file(folder: &Path, name: &str, columns: &[&str], values: &[f64]) -> std::path::PathBuf {
    let mut log = Log { time: (0..20).map(|k| f64::from(k) * 0.01).collect(), ..Log::default() };
    for (place, column) in columns.iter().enumerate() {
        let value = |k: usize| values[(7 * place + k) % values.len()];
        log.push(column, (0..20).map(value).collect::<Vec<_>>());
    }
    let path = folder.join(name);
    log.write(&path, std::fs::File::create(&path).unwrap()).unwrap();
    path
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn what_is_not_needed_is_not_read_and_changes_nothing(
        rule in 0..RULES.len(),
        blank in any::<bool>(),
        format in prop::sample::select(vec!["csv", "parquet", "mf4"]),
        values in prop::collection::vec(prop_oneof![Just(f64::NAN), -1e3..1e3], 1..40),
    ) {
        let folder = TempDir::new().unwrap();
        let columns = ["a", "b", "c", "d", "e", "f", "speed", "unasked"];
        let path = file(folder.path(), &format!("log.{format}"), &columns, &values);
        file(folder.path(), "gps.csv", &["g", "h"], &values);
        let map = folder.path().join("map.toml");
        let blank = if blank { "missing_if = 'e > 500'" } else { "" };
        std::fs::write(&map, format!("join = [{{ file = 'gps.csv', as = 'other' }}]\n{blank}\n{}", RULES[rule])).unwrap();
        let map = ColumnMap::read(&map).unwrap();
        let read = |keep: &dyn Fn(&str) -> bool| Log::read_inputs(&path, Some(&map), &INPUTS, keep, &Progress::none()).unwrap();
        let (whole, needed) = (read(&|_| true), read(&|name| name == "b"));
        prop_assert!(needed.unread.iter().any(|name| name == "unasked") && whole.unread.is_empty());
        for channel in &whole.channels {
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            let expected = bits(&channel.values);
            match needed.channel(&channel.name) {
                Some(values) => prop_assert_eq!(bits(values), expected, "{}", channel.name),
                None => prop_assert!(needed.unread.contains(&channel.name), "{} is lost", channel.name),
            }
        }
        for name in ["x", "speed", "b"] {
            prop_assert_eq!(whole.channel(name).is_some(), needed.channel(name).is_some(), "{}", name);
        }
        prop_assert_eq!(&needed.time, &whole.time);
    }
}

#[test]
fn a_name_that_was_not_read_is_still_suggested() {
    let folder = TempDir::new().unwrap();
    let path = file(folder.path(), "log.csv", &["Speed_kmh", "gear"], &[1.0, 2.0]);
    let log = Log::read_inputs(&path, None, &INPUTS, &|_| false, &Progress::none()).unwrap();
    let error = log.require("speed").unwrap_err().to_string();
    assert!(log.channels.is_empty() && error.contains("did you mean 'Speed_kmh'?"), "{error}");
}
