//! Reading an hour at 100 Hz with ten columns (360 000 rows), file by file format.
#![allow(missing_docs)]

use divan::Bencher;
use std::fs::File;
use std::path::PathBuf;
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Log};

fn main() {
    divan::main();
}

fn hour(ending: &str) -> (TempDir, PathBuf) {
    let rows = 360_000;
    let mut log = Log { time: (0..rows).map(|k| f64::from(k) * 0.01).collect(), ..Log::default() };
    for column in 0..9 {
        let value = |k| (f64::from(k) * 0.0137 + f64::from(column)).sin();
        log.push(&format!("channel_{column}"), (0..rows).map(value).collect::<Vec<_>>());
    }
    let folder = TempDir::new().expect("a temporary folder");
    let path = folder.path().join(format!("hour.{ending}"));
    log.write(&path, File::create(&path).expect("a file")).expect("a log");
    (folder, path)
}

#[divan::bench(args = ["csv", "parquet", "mf4"], sample_count = 10)]
fn read(bencher: Bencher, ending: &str) {
    let (_folder, path) = hour(ending);
    bencher.bench_local(|| Log::read(&path, None, &Progress::none()).expect("a log"));
}

/// A condition over two columns for each of two channels.
#[divan::bench(sample_count = 10)]
fn read_csv_with_a_map(bencher: Bencher) {
    let (_folder, path) = hour("csv");
    let text = "a = { column = \"channel_0\", unit = \"km/h\", missing_if = \"channel_1 < 0.1 || channel_2 <= 0\" }\n\
                b = { column = \"channel_0\", scale = 2, missing_if = \"channel_1 < 0.1 || channel_2 <= 0\" }\n";
    let map = ColumnMap::parse("map.toml", text).expect("a map");
    bencher.bench_local(|| Log::read(&path, Some(&map), &Progress::none()).expect("a log"));
}
