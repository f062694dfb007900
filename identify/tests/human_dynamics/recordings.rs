//! A recorded bow (data/mapest_2dof, not part of the repository): a person on a force plate with an
//! accelerometer on the torso, estimated through the same files as `identify estimate` takes.

use std::path::{Path, PathBuf};
use wheelstate_identify::estimate;
use wheelstate_identify::log::Log;
use wheelstate_identify::progress::Progress;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn recording() -> Option<PathBuf> {
    let data = std::env::var_os("WHEELSTATE_DATA").map_or(repository().join("../shared/data"), PathBuf::from);
    let folder = data.join("mapest_2dof");
    if folder.join("bowing_t0_8s.csv").is_file() {
        return Some(folder);
    }
    eprintln!("SKIPPED: there is no recording {}; set WHEELSTATE_DATA", folder.display());
    None
}

/// The recording as a log, its joint accelerations made anew from its velocities: the stored ones
/// were smoothed to half their amplitude.
fn log(folder: &Path) -> Log {
    let text = std::fs::read_to_string(folder.join("bowing_t0_8s.csv")).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|c| c.trim().parse().unwrap()).collect()).collect();
    let column = |name: &str| {
        let k = header.iter().position(|h| h.trim() == name).unwrap();
        rows.iter().map(|row| row[k]).collect::<Vec<f64>>()
    };
    let mut log = Log { source: "bowing".into(), time: column("t_s").into(), ..Log::default() };
    for joint in ["ankle", "hip"] {
        let velocity = column(&format!("dq_{joint}"));
        log.push(&format!("q_{joint}"), column(&format!("q_{joint}_rad")));
        log.push(&format!("qdd_{joint}"), wheelstate::filter::savitzky_golay::smooth(&velocity, 57, 1, 0.01));
        log.push(&format!("qd_{joint}"), velocity);
    }
    for axis in ["x", "y", "z"] {
        log.push(&format!("torso_accel_{axis}"), column(&format!("acc_{axis}")));
    }
    for part in ["fx", "fy", "fz", "mx", "my", "mz"] {
        log.push(&format!("foot_{part}"), column(&format!("foot_{part}")));
    }
    log
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let product =
        |x: &[f64], mx: f64, y: &[f64], my: f64| x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>();
    product(a, ma, b, mb) / (product(a, ma, a, ma) * product(b, mb, b, mb)).sqrt()
}

#[test]
fn ankle_torque_follows_the_plate() {
    let Some(folder) = recording() else { return };
    let log = log(&folder);
    let with_plate = repository().join("tests/human_dynamics/mapest_2dof.toml");
    let urdf = folder.join("threeLinkHuman_subject1_sensorExt.urdf");
    let mut setup = estimate::setup(&urdf, &with_plate).unwrap();
    let result = estimate::run(&mut setup, &log, &Progress::none()).unwrap();

    // the same without the plate: the last sensor is left out
    let text = std::fs::read_to_string(&with_plate).unwrap();
    let cut = text.rfind("[[sensor]]").unwrap();
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), &text[..cut]).unwrap();
    let mut without = estimate::setup(&urdf, file.path()).unwrap();
    let alone = estimate::run(&mut without, &log, &Progress::none()).unwrap();

    let my = log.channel("foot_my").unwrap();
    for (what, result) in [("with plate", &result), ("without plate", &alone)] {
        let r = correlation(result.channel("tau_ankle").unwrap(), my);
        println!("{what}: ankle torque against the plate's moment: correlation {r:.4}");
        assert!(r.abs() > 0.97, "{what}: {r}");
    }
    // the plate's axes are inclined by 8 mrad and the body is another one than the table's
    let (tau, std) = (alone.channel("tau_ankle").unwrap(), alone.channel("tau_ankle_std").unwrap());
    let reference = result.channel("tau_ankle").unwrap();
    let beyond = (0..tau.len()).filter(|&i| (tau[i] - reference[i]).abs() > 3.0 * std[i]).count();
    println!("ankle without plate beyond 3 std of the one with it: {beyond} of {}", tau.len());
    assert!(beyond as f64 <= 0.01 * tau.len() as f64);
    for joint in ["ankle", "hip"] {
        let std = |log: &Log| log.channel(&format!("tau_{joint}_std")).unwrap().to_vec();
        let (with, without) = (std(&result), std(&alone));
        println!("{joint}: std {:.3} N.m with plate, {:.3} N.m without", with[0], without[0]);
        assert!(with.iter().zip(&without).all(|(a, b)| a < b), "the plate adds information");
    }
    assert!(result.channel("status").unwrap().iter().all(|s| *s == 0.0));

    // vertical force of the estimate against the plate's
    let plate = setup.body.equations().sensors().len() - 1;
    let rows = setup.body.equations().sensor_rows(plate);
    let mut shares = vec![];
    for row in 0..log.len() {
        let one = Log {
            time: vec![log.time[row]].into(),
            channels: log
                .channels
                .iter()
                .map(|c| wheelstate_identify::log::Channel { name: c.name.clone(), values: vec![c.values[row]].into() })
                .collect(),
            ..Log::default()
        };
        estimate::run(&mut setup, &one, &Progress::none()).unwrap();
        let measured = log.channel("foot_fz").unwrap()[row];
        let estimated = measured - setup.body.residual(rows.start + 2).0;
        shares.push(estimated / measured);
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let worst = shares.iter().fold(0.0_f64, |w, s| w.max((s - 1.0).abs()));
    println!("vertical force over the plate's: mean {mean:.4}, worst {worst:.4} off 1");
    assert!((mean - 1.0).abs() < 0.02);
}
