//! Recordings of real cars: lateral speed against the INS reference, with tyres from the other half.

use std::path::{Path, PathBuf};
use wheelstate::Estimator;
use wheelstate::estimator::wheeled_robot::{Channels, Outputs, Parameters, WheeledRobot};
use wheelstate_identify::log::{ColumnMap, Log};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::tune::replay::Track;

fn recording(name: &str, map: &str) -> Option<Log> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let data = std::env::var_os("WHEELSTATE_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let path = data.join(name);
    if !path.exists() {
        println!("SKIPPED: {} is not there; set WHEELSTATE_DATA", path.display());
        return None;
    }
    let map = ColumnMap::read(&root.join("tests/maps").join(map)).unwrap();
    Some(Log::read(&path, Some(&map), &Progress::none()).unwrap())
}

fn niki() -> Parameters {
    let mut p = car(1926.2, 2763.49, 1.264, 1.367, 1.55, 0.55, 0.318);
    p.sample_period = 0.005;
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (45e3, 67e3);
    p
}

fn revs() -> Parameters {
    let mut p = car(982.0, 982.0 / 12.0 * (1.7f64.powi(2) + 4.09f64.powi(2)), 1.33, 1.07, 1.35, 0.45, 0.32);
    (p.tire.front.stiffness, p.tire.rear.stiffness) = (30.5e3, 47.5e3);
    p
}

fn car(mass: f64, inertia: f64, front: f64, rear: f64, track: f64, height: f64, radius: f64) -> Parameters {
    let mut p = Parameters::default();
    let base = front + rear;
    let v = &mut p.vehicle;
    (v.mass, v.yaw_inertia, v.cg_to_front, v.cg_to_rear) = (mass, inertia, front, rear);
    (v.track_front, v.track_rear, v.cg_height) = (track, track, height);
    p.wheel.radius = radius;
    p.wheel.inertia = 1.2;
    for (tire, lever) in [(&mut p.tire.front, rear), (&mut p.tire.rear, front)] {
        tire.nominal_load = 0.5 * mass * 9.81 * lever / base;
        (tire.friction, tire.curvature, tire.shape) = (1.0, 0.0, 1.3);
    }
    p.filter.channels = Channels::Gyro;
    p.filter.use_speed = true;
    p.filter.minimum_speed = 1.0;
    let q = &mut p.filter.process_std;
    (q.speed_x, q.speed_y, q.yaw_rate) = (0.05, 0.03, 0.01);
    let r = &mut p.filter.measurement_std;
    (r.accel_x, r.accel_y, r.gyro_z, r.speed) = (0.5, 1.0, 0.01, 0.05);
    p
}

fn run(log: &Log, p: &Parameters) -> Vec<Outputs> {
    let mut all = Vec::with_capacity(log.len());
    Track::<WheeledRobot>::new(log).run(WheeledRobot::new(p).unwrap(), |_, outputs| all.push(outputs.clone()));
    all
}

fn rmse(log: &Log, out: &[Outputs]) -> f64 {
    let truth = log.channel("speed_y").unwrap();
    let errors: Vec<f64> =
        out.iter().zip(truth).map(|(o, t)| (o.speed_y - t).powi(2)).filter(|e| e.is_finite()).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn explore() {
    for (name, map, p) in [
        ("niki_gti/Low_Speed.csv", "niki_gti.toml", niki()),
        ("revs_250lm/250lm_t150_400.csv", "revs_250lm.toml", revs()),
    ] {
        let Some(log) = recording(name, map) else { continue };
        for (qy, qr) in [(0.03, 0.01), (0.01, 0.01), (0.003, 0.01), (0.001, 0.003)] {
            for ay in [0.3, 1.0, 3.0, 10.0] {
                let mut p = p.clone();
                p.filter.process_std.speed_y = qy;
                p.filter.process_std.yaw_rate = qr;
                p.filter.measurement_std.accel_y = ay;
                let out = run(&log, &p);
                let mean = out.iter().zip(log.channel("speed_y").unwrap()).map(|(o, t)| o.speed_y - t).sum::<f64>()
                    / out.len() as f64;
                println!(
                    "{name} q {qy} {qr} ay {ay}: {:.4} mean {mean:.4} nis {:.2}",
                    rmse(&log, &out),
                    out.iter().map(|o| o.nis).sum::<f64>() / out.len() as f64
                );
            }
        }
    }
}
