//! Mass and rolling resistance of a car from real trips. The logs are not part of the repository: the
//! test runs where WHEELSTATE_DATA (or ../shared/data) has them and says so where it does not.

use std::path::PathBuf;
use wheelstate_identify::log::{ColumnMap, Log};
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::result::FitReport;
use wheelstate_identify::vehicles::nursing_robot;

fn data() -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = std::env::var_os("WHEELSTATE_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let trips = folder.join("bmw_i3");
    if !trips.is_dir() {
        eprintln!("SKIPPED: no trips in {}; set WHEELSTATE_DATA", trips.display());
        return None;
    }
    Some(trips)
}

/// Published constants of the car.
fn request() -> FitRequest {
    let settings = [
        ("robot.wheel_radius", 0.3498),
        ("robot.wheel_inertia", 0.0),
        ("robot.rotating_mass", 102.0),
        ("robot.drive_efficiency", 0.96),
        ("aero.drag_area", 0.6902),
        ("human.nominal_mass", 0.0),
    ];
    FitRequest {
        settings: settings.map(|(name, value)| (name.to_owned(), value)).to_vec(),
        only: vec!["robot.mass".to_owned(), "rolling.coefficient".to_owned()],
        ..FitRequest::default()
    }
}

fn trip(log: &Log) -> FitReport {
    nursing_robot::VEHICLE.fit(std::slice::from_ref(log), &request(), &Progress::none()).unwrap()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Spearman's rank correlation.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |values: &[f64]| -> Vec<f64> {
        values.iter().map(|v| values.iter().filter(|other| *other < v).count() as f64).collect()
    };
    let (a, b) = (ranks(a), ranks(b));
    let (ma, mb) = (mean(&a), mean(&b));
    let product: f64 = a.iter().zip(&b).map(|(a, b)| (a - ma) * (b - mb)).sum();
    let square = |x: &[f64], m: f64| x.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    product / (square(&a, ma) * square(&b, mb)).sqrt()
}

#[test]
fn mass_and_rolling_resistance_of_real_trips() {
    let Some(folder) = data() else { return };
    let map = ColumnMap::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/maps/bmw_i3.toml")).unwrap();
    let mut files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
    files.sort();
    let (mut masses, mut rolling, mut ambient, mut heavy) = (Vec::new(), Vec::new(), Vec::new(), None);
    let mut disagreement = Vec::new();
    for path in &files {
        let log = Log::read(path, Some(&map), &Progress::none()).unwrap();
        let report = trip(&log);
        let (mass, f) = (&report.parameters["robot.mass"], &report.parameters["rolling.coefficient"]);
        let warmth: Vec<f64> = log.channel("ambient_C").unwrap().iter().copied().filter(|t| t.is_finite()).collect();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        println!(
            "{name}: mass {:.0} +- {:.1} kg, f {:.4} +- {:.4}, {:.1} C, windows {}, held-out {:.1} % (training {:.1} %) {:?}",
            mass.value,
            mass.std_error,
            f.value,
            f.std_error,
            mean(&warmth),
            report.windows_used,
            report.validation.signals[0].fit_percent,
            report.validation.signals[0].fit_percent_training,
            report.warnings,
        );
        assert!(mass.identified && f.identified, "{name}: {:?}", report.warnings);
        let halves = <[Log; 2]>::from(log.split(0.5)).map(|half| trip(&half).parameters["robot.mass"].clone());
        let spread = halves[0].std_error.hypot(halves[1].std_error);
        disagreement.push(((halves[0].value - halves[1].value) / spread).powi(2));
        rolling.push(f.value);
        ambient.push(mean(&warmth));
        if name == "TripB33" {
            heavy = Some(mass.value);
        } else {
            assert!((1350.0..=1560.0).contains(&mass.value), "{name}: {} kg", mass.value);
            masses.push(mass.value);
        }
    }
    masses.sort_by(f64::total_cmp);
    let median = masses[masses.len() / 2];
    if let Some(heavy) = heavy {
        assert!(heavy > median + 120.0, "{heavy} kg against a median of {median} kg");
    }
    let correlation = rank_correlation(&ambient, &rolling);
    println!("median {median:.0} kg; rank correlation of f with temperature {correlation:.2}");
    assert!(correlation < -0.7);
    // The standard errors are honest if the halves of a trip differ by about as much as they say.
    let z = mean(&disagreement).sqrt();
    println!("halves of a trip: rms difference {z:.2} standard errors");
    assert!(z < 2.0);
}
