//! Damaged binary logs are refused; they never bring the program down.

use std::fs::File;
use tempfile::TempDir;
use wheelstate_log::Log;
use wheelstate_log::progress::Progress;

#[test]
fn damaged_parquet_and_mf4_files_never_panic() {
    let folder = TempDir::new().unwrap();
    let mut log = Log { time: (0..200).map(f64::from).collect(), ..Log::default() };
    log.push("speed", (0..200).map(|k| f64::from(k).sin()).collect::<Vec<_>>());
    // The reading libraries may panic inside, which is caught; keep the test's output clean.
    wheelstate_log::guard::quiet();
    for ending in ["parquet", "mf4"] {
        let path = folder.path().join(format!("log.{ending}"));
        log.write(&path, File::create(&path).unwrap()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let stride = (whole.len() / 400).max(1);
        for place in (0..whole.len()).step_by(stride) {
            let mut flipped = whole.clone();
            flipped[place] ^= 0xa5;
            std::fs::write(&path, &flipped).unwrap();
            let _ = Log::read(&path, None, &Progress::none());
            std::fs::write(&path, &whole[..place]).unwrap();
            assert!(Log::read(&path, None, &Progress::none()).is_err(), "{ending} cut at {place}");
        }
    }
}
