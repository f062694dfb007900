//! Mass and rolling resistance of a car from real trips. The logs are not part of the repository: the
//! test runs where WHEELSTATE_DATA (or ../shared/data) has them and says so where it does not.

use std::path::{Path, PathBuf};
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

/// All trips with the column map of the car.
fn trips(folder: &Path) -> Vec<Log> {
    let map = ColumnMap::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/maps/bmw_i3.toml")).unwrap();
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
    files.sort();
    files.iter().map(|path| Log::read(path, Some(&map), &Progress::none()).unwrap()).collect()
}

/// The load does not change within a trip: its thirds differ by what their standard errors by noise say.
#[test]
fn thirds_of_a_trip_agree_within_their_standard_errors() {
    let Some(folder) = data() else { return };
    let request = FitRequest { exact: true, ..request() };
    let mut reduced = Vec::new();
    for log in trips(&folder) {
        let third = |k: usize| log.slice(log.len() * k / 3..log.len() * (k + 1) / 3, |_| true);
        let fit = |log: Log| nursing_robot::VEHICLE.fit(&[log], &request, &Progress::none()).unwrap();
        let masses: Vec<(f64, f64)> = (0..3)
            .map(|k| fit(third(k)).parameters["robot.mass"].clone())
            .map(|mass| (mass.value, mass.std_error))
            .collect();
        let weight: f64 = masses.iter().map(|(_, std)| std.powi(-2)).sum();
        let mean = masses.iter().map(|(mass, std)| mass / (std * std)).sum::<f64>() / weight;
        reduced.push(masses.iter().map(|(mass, std)| ((mass - mean) / std).powi(2)).sum::<f64>() / 2.0);
    }
    println!("chi2/dof of thirds: mean {:.2}, {reduced:.2?}", mean(&reduced));
    assert!(mean(&reduced) <= 1.5);
}

/// All ordinary trips in one fit: a mass for each, one drag area, and a rolling coefficient that falls with the temperature
/// and may scatter with roads, wind and tyres.
#[test]
fn trips_are_one_fit_with_a_law_of_the_rolling_coefficient() {
    let Some(folder) = data() else { return };
    let logs: Vec<Log> = trips(&folder).into_iter().filter(|log| !log.source.contains("B33")).collect();
    let mut request = request();
    request.settings.retain(|(name, _)| name != "aero.drag_area");
    request.only.push("aero.drag_area".to_owned());
    request.per_log = vec!["robot.mass".to_owned()];
    request.varies =
        vec![("rolling.coefficient".to_owned(), Some("ambient_C".to_owned())), ("aero.drag_area".to_owned(), None)];
    let report = nursing_robot::VEHICLE.fit(&logs, &request, &Progress::none()).unwrap();
    println!("{}", wheelstate_identify::report::table(&report));
    let (law, rolling) = (&report.laws[0], &report.parameters["rolling.coefficient"]);
    println!("{law:?}");
    assert!(rolling.identified && (0.006..0.016).contains(&rolling.value), "{rolling:?}");
    // Cold tyres roll worse: about 1 to 4 % per kelvin.
    assert!((-4e-4..-1e-4).contains(&law.slope) && law.slope < -law.slope_std_error, "{law:?}");
    let drag = &report.parameters["aero.drag_area"];
    assert!((0.4..0.8).contains(&drag.value) && drag.std_error < 0.15, "{drag:?}");
    let masses = &report.parameters["robot.mass"].per_log;
    assert_eq!(masses.len(), logs.len());
    assert!(masses.values().all(|mass| (1300.0..1600.0).contains(&mass.value)), "{masses:?}");
    // The logs about the law: what is left is what the errors and the scatter say.
    let own: Vec<f64> = rolling.per_log.values().map(|own| own.value).collect();
    assert!(law.scatter < 0.003 && own.len() == logs.len(), "{law:?}");
}

#[test]
fn mass_and_rolling_resistance_of_real_trips_are_found() {
    let Some(folder) = data() else { return };
    let (mut masses, mut rolling, mut ambient, mut heavy) = (Vec::new(), Vec::new(), Vec::new(), None);
    let mut disagreement = Vec::new();
    for log in trips(&folder) {
        let report = trip(&log);
        let (mass, f) = (&report.parameters["robot.mass"], &report.parameters["rolling.coefficient"]);
        let warmth: Vec<f64> = log.channel("ambient_C").unwrap().iter().copied().filter(|t| t.is_finite()).collect();
        let name = Path::new(&log.source).file_stem().unwrap().to_string_lossy().into_owned();
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
    // The standard errors hold if the halves of a trip differ by about as much as they say.
    let z = mean(&disagreement).sqrt();
    println!("halves of a trip: rms difference {z:.2} standard errors");
    assert!(z < 2.0);
}
