//! The chairs, the noise and the limits of the reference vectors.

use crate::support::vector_text;
use wheelstate::estimator::wheelchair::ekf::{Limits, Noise};
use wheelstate::model::wheelchair::{
    Accelerometer, Chair, ChairParameters, Dynamics, Gyro, ImuParameters, RollingParameters,
};

/// A parameter set of `params.json` by its name.
pub fn reference_chair(variant: &str) -> Chair {
    let all: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/params.json")).unwrap();
    let p = &all["params"][variant];
    let number = |name: &str| p[name].as_f64().unwrap_or_else(|| panic!("no {name} in {variant}"));
    let body = ChairParameters {
        mass: number("M"),
        yaw_inertia: number("Ic"),
        com_ahead: number("l"),
        drag: number("D"),
        yaw_drag: number("B"),
        yaw_friction: number("tauc"),
        wheel_radius: number("R"),
        reference_to_right: number("r1"),
        reference_to_left: number("r2"),
        ..ChairParameters::default()
    };
    let rolling = RollingParameters {
        coefficient: number("crr"),
        smoothing_speed: number("vs"),
        smoothing_yaw_rate: number("ws"),
    };
    let imu = ImuParameters { x: number("dx"), y: number("dy"), z: number("dz") };
    Chair {
        rotating_mass: number("mrot"),
        rotating_inertia: number("irot"),
        gravity: number("g"),
        heading_reference: number("alpha_ref"),
        pitch_travel: number("renc"),
        dynamics: if p["dyn"] == "paper" { Dynamics::Paper } else { Dynamics::Full },
        gyro: match p["gyro"].as_str() {
            Some("paper") => Gyro::Paper,
            Some("euler") => Gyro::Euler,
            _ => Gyro::Body,
        },
        accelerometer: if p["acc"] == "paper" { Accelerometer::Paper } else { Accelerometer::Rigid },
        ..Chair::new(body, rolling, imu)
    }
}

fn config() -> serde_json::Value {
    let mut all: serde_json::Value = serde_json::from_str(&vector_text("wheelchair/params.json")).unwrap();
    all["config"].take()
}

/// The limits of `params.json`; impacts are what the source does not know.
pub fn reference_limits() -> Limits {
    let config = config();
    let limit = |name: &str| config[name].as_f64().unwrap();
    Limits { substep: limit("dt_sub"), longest_step: limit("dt_max"), outlier_threshold: 0.0 }
}

/// The noise of `params.json`, with the densities that a run sets instead.
pub fn reference_noise(run: &serde_json::Value) -> Noise {
    let config = &config();
    let density = |k: usize| run["q"].get(k).or(config["q"].get(k)).and_then(|q| q.as_f64()).unwrap();
    let std = |name: &str| config[name].as_f64().unwrap();
    Noise {
        speed: density(0),
        yaw_rate: density(1),
        slope_rate: density(2),
        gyro_bias: density(3),
        accel_bias: density(4),
        heading_offset: density(5),
        force_offset: 0.0,
        moment_offset: 0.0,
        encoder: std("sig_theta"),
        gyro: std("sig_gyro"),
        accel: std("sig_acc"),
        slope_acceleration: std("sig_xidd"),
        standstill_speed: config["still_sig"][0].as_f64().unwrap(),
        standstill_rate: config["still_sig"][1].as_f64().unwrap(),
    }
}
