//! What `identify check` finds: nothing in good logs, simulated or recorded, and every fault that a log shows.

use assert_cmd::Command;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use wheelstate_identify::finding::{Finding, Severity};
use wheelstate_identify::log::{ColumnMap, Input, Log, Series};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles;

fn vehicle(name: &str) -> &'static Vehicle {
    vehicles::ALL.into_iter().find(|vehicle| vehicle.name == name).unwrap()
}

fn simulated(vehicle: &Vehicle, scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Log {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    vehicle.simulate(&Request { scenario: scenario.to_owned(), seed, settings }).unwrap()
}

fn serious(vehicle: &Vehicle, log: &Log, settings: &[(String, f64)]) -> Vec<Finding> {
    let mut findings = vehicle.check(log, settings).unwrap();
    findings.retain(|finding| finding.severity >= Severity::Warning);
    findings
}

#[test]
fn simulated_logs_of_every_machine_and_scenario_raise_no_alarm() {
    for vehicle in vehicles::ALL {
        for scenario in vehicle.simulation.scenarios {
            for seed in 11..16 {
                let log = simulated(vehicle, scenario.name, seed, &[]);
                let found = serious(vehicle, &log, &[]);
                assert!(found.is_empty(), "{vehicle} {} {seed}: {found:#?}", scenario.name);
            }
        }
    }
}

/// What a simulation is told.
type Settings = &'static [(&'static str, f64)];

/// Several times the usual noise, a steep ground, other rates and sensors with their own errors: no fault either.
/// A hip that swings with less than the noise of its sensors: at half a period's delay noise made the opposite sign look
/// a little better than the right one without.
#[test]
fn an_oscillation_in_noise_is_no_wrong_sign() {
    let vehicle = vehicle("human-dynamics");
    for seed in 40..43 {
        let found = serious(vehicle, &simulated(vehicle, "seated-braking", seed, &[]), &[]);
        assert!(found.is_empty(), "{seed}: {found:?}");
    }
}

#[test]
fn rough_but_right_logs_raise_no_alarm() {
    let cases: [(&str, &str, Settings); 11] = [
        ("wheel-loader", "accelerate-brake", &[("noise.speed", 0.08), ("noise.wheel_speed", 0.08)]),
        ("wheel-loader", "accelerate-brake", &[("plant.grade", 0.1)]),
        ("wheel-loader", "bumpy-d", &[("noise.speed", 0.06), ("plant.roughness", 2.0)]),
        ("wheel-loader", "accelerate-brake", &[("sample_period", 0.02)]),
        ("wheeled-robot", "sine", &[("noise.accel", 0.5), ("noise.gyro", 0.05), ("noise.speed", 0.06)]),
        ("wheeled-robot", "lane-change", &[("noise.gyro_bias", 0.02), ("noise.accel_bias", 0.2)]),
        ("wheeled-robot", "accelerate-brake", &[("noise.wheel_speed", 0.2), ("noise.torque_bias", 1.0)]),
        ("wheelchair", "identification", &[("noise.accel", 0.3), ("noise.outliers", 0.05)]),
        ("wheelchair", "climb", &[("plant.slope", 0.15), ("noise.encoder", 0.01)]),
        ("wheelchair", "identification", &[("plant.accel_x_bias", 0.2), ("sample_period", 0.02)]),
        ("wheelchair", "oblique", &[("plant.gyro_bias", 0.05), ("chair.mass", 140.0)]),
    ];
    for (name, scenario, settings) in cases {
        for seed in 1..4 {
            let log = simulated(vehicle(name), scenario, seed, settings);
            let found = serious(vehicle(name), &log, &[]);
            assert!(found.is_empty(), "{name} {scenario} {settings:?} {seed}: {found:#?}");
        }
    }
}

fn data() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = std::env::var_os("WHEELSTATE_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no recordings in {}; set WHEELSTATE_DATA", folder.display());
    None
}

#[test]
fn recordings_of_real_machines_raise_no_alarm() {
    let Some(folder) = data() else { return };
    let maps = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/maps");
    let car = [
        ("robot.wheel_radius", 0.3498),
        ("robot.rotating_mass", 102.0),
        ("robot.drive_efficiency", 0.96),
        ("human.nominal_mass", 0.0),
    ];
    let mut looked = 0;
    for (name, part, map, settings) in [
        ("nursing-robot", "bmw_i3", "bmw_i3.toml", &car[..]),
        ("wheeled-robot", "niki_gti/Low_Speed.csv", "niki_gti.toml", &[]),
        ("wheeled-robot", "revs_250lm", "revs_250lm.toml", &[]),
    ] {
        let (vehicle, place) = (vehicle(name), folder.join(part));
        let map = ColumnMap::read(&maps.join(map)).unwrap();
        let inputs = vehicle.inputs();
        let inputs: Vec<_> = inputs.iter().map(|input| Input { name: &input.name, unit: input.unit }).collect();
        let settings: Vec<_> = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        let mut files = vec![place.clone()];
        if place.is_dir() {
            files = std::fs::read_dir(&place).unwrap().map(|entry| entry.unwrap().path()).collect();
            files.retain(|path| path.extension().is_some_and(|ending| ending == "csv"));
        }
        for file in files.iter().filter(|file| file.exists()) {
            let log = Log::read_inputs(file, Some(&map), &inputs, &|_| true, &Progress::none()).unwrap();
            let found = serious(vehicle, &log, &settings);
            assert!(found.is_empty(), "{found:#?}");
            looked += 1;
        }
    }
    println!("{looked} recordings");
}

/// Changes the channels whose names begin so.
fn each(log: &mut Log, stems: &[&str], change: impl Fn(&mut Series)) {
    let channels = log.channels.iter_mut().filter(|c| stems.iter().any(|stem| c.name.starts_with(stem)));
    let mut count = 0;
    for channel in channels {
        change(&mut channel.values);
        count += 1;
    }
    assert!(count > 0, "no channel {stems:?}");
}

fn scaled(stems: &'static [&'static str], factor: f64) -> Box<dyn Fn(&mut Log)> {
    Box::new(move |log| each(log, stems, |values| values.iter_mut().for_each(|value| *value *= factor)))
}

/// Samples of these channels arrive so many seconds late.
fn late(stems: &'static [&'static str], seconds: f64) -> Box<dyn Fn(&mut Log)> {
    Box::new(move |log| {
        let samples = (seconds / log.period()).round() as usize;
        each(log, stems, |values| *values = (0..values.len()).map(|k| values[k.saturating_sub(samples)]).collect());
    })
}

fn changed(stems: &'static [&'static str], change: fn(&mut [f64])) -> Box<dyn Fn(&mut Log)> {
    Box::new(move |log| each(log, stems, |values| change(values)))
}

fn timed(change: fn(&mut Log)) -> Box<dyn Fn(&mut Log)> {
    Box::new(change)
}

fn freeze(values: &mut [f64]) {
    let (from, to) = (values.len() / 2, values.len() * 3 / 4);
    let value = values[from];
    values[from..to].fill(value);
}

fn clip(values: &mut [f64]) {
    let limit = 0.5 * values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    values.iter_mut().for_each(|value| *value = value.clamp(-limit, limit));
}

fn stop(values: &mut [f64]) {
    let value = values[0];
    values.fill(value);
}

const DEGREES: f64 = 180.0 / std::f64::consts::PI;
const G: f64 = 1.0 / 9.80665;
const RPM: f64 = 30.0 / std::f64::consts::PI;

/// Machine, scenario, what is done to the log, the code that must come, a channel that must be named.
type Case = (&'static str, &'static str, Box<dyn Fn(&mut Log)>, &'static str, &'static str);

#[rustfmt::skip]
fn cases() -> Vec<Case> {
    let nurse = ("nursing-robot", "identification");
    let chair = ("wheelchair", "identification");
    let loader = ("wheel-loader", "accelerate-brake");
    let robot = ("wheeled-robot", "accelerate-brake");
    let seated = ("human-dynamics", "seated-braking");
    let of = |(vehicle, scenario), fault, code, channel| (vehicle, scenario, fault, code, channel);
    let mut all = Vec::new();
    for machine in [nurse, chair, loader, robot, seated] {
        for factor in [1e3, 1e6, 1e9] {
            let fault: Box<dyn Fn(&mut Log)> = Box::new(move |log| log.time.iter_mut().for_each(|t| *t *= factor));
            all.push(of(machine, fault, "period-out-of-range", "time"));
        }
        all.push(of(machine, timed(|log| {
            let (at, first) = (0.4 * log.duration(), log.time[0]);
            log.time.iter_mut().filter(|t| **t - first > at).for_each(|t| *t += 2.0);
        }), "time-gap", "time"));
        all.push(of(machine, timed(|log| {
            let period = log.period();
            // A scatter of a quarter of a period that no two neighbours share.
            let scatter = |k: usize| period * (0.25 * (1.7 * (k * k) as f64).sin() + 0.1 * (12.9 * k as f64).sin());
            log.time.iter_mut().enumerate().for_each(|(k, t)| *t += scatter(k));
        }), "time-jitter", "time"));
    }
    all.extend([
        of(nurse, scaled(&["accel_x"], G), "unit-mismatch", "accel_x"),
        of(nurse, scaled(&["speed"], 3.6), "unit-mismatch", "speed"),
        of(nurse, scaled(&["tilt_rate"], DEGREES), "unit-mismatch", "tilt_rate"),
        of(nurse, scaled(&["tilt"], DEGREES), "out-of-range", "tilt"),
        of(nurse, scaled(&["roll_rate"], DEGREES), "unit-mismatch", "roll_rate"),
        of(nurse, scaled(&["yaw_rate"], DEGREES), "unit-mismatch", "yaw_rate"),
        of(nurse, scaled(&["torque_"], 1e-3), "unit-mismatch", "torque_left"),
        of(nurse, scaled(&["speed"], -1.0), "sign-mismatch", "speed"),
        of(nurse, scaled(&["torque_"], -1.0), "sign-mismatch", "torque_left"),
        of(nurse, scaled(&["tilt"], -1.0), "sign-mismatch", "tilt"),
        of(nurse, scaled(&["roll"], -1.0), "sign-mismatch", "roll"),
        of(nurse, scaled(&["yaw_rate"], -1.0), "sign-mismatch", "yaw_rate"),
        of(nurse, late(&["speed"], 0.05), "delayed-channel", "speed"),
        of(nurse, late(&["tilt", "roll"], 0.05), "delayed-channel", "tilt_rate"),
        of(nurse, late(&["accel_x"], 0.05), "delayed-channel", "accel_x"),
        of(nurse, late(&["torque_"], 0.05), "delayed-channel", "torque_left"),
        of(nurse, changed(&["tilt"], freeze), "stuck-channel", "tilt"),
        of(nurse, changed(&["accel_x"], clip), "saturated-channel", "accel_x"),
        of(nurse, changed(&["tilt"], |tilt| tilt.iter_mut().for_each(|v| *v = (*v / 0.02).round() * 0.02)), "coarse-channel", "tilt"),
        of(nurse, changed(&["speed"], stop), "constant-channel", "speed"),
        of(nurse, timed(|log| log.channels.retain(|c| c.name != "torque_left")), "missing-channel", "torque_left"),
        of(nurse, changed(&["speed"], |v| (0..v.len()).filter(|k| k % 5 > 0).for_each(|k| v[k] = f64::NAN)), "sparse-channel", "speed"),

        of(chair, scaled(&["accel_"], G), "unit-mismatch", "accel_z"),
        of(chair, scaled(&["accel_x"], G), "unit-mismatch", "accel_x"),
        of(chair, scaled(&["accel_z"], -1.0), "sign-mismatch", "accel_z"),
        of(chair, scaled(&["accel_x"], -1.0), "sign-mismatch", "accel_x"),
        of(chair, scaled(&["accel_y"], -1.0), "sign-mismatch", "accel_y"),
        of(chair, scaled(&["encoder_"], DEGREES), "unit-mismatch", "encoder_left"),
        of(chair, scaled(&["encoder_left"], -1.0), "sign-mismatch", "encoder_left"),
        of(chair, scaled(&["drive_force"], -1.0), "sign-mismatch", "drive_force"),
        of(chair, scaled(&["drive_moment"], -1.0), "sign-mismatch", "drive_moment"),
        of(chair, late(&["drive_force"], 0.05), "delayed-channel", "drive_force"),
        of(chair, late(&["drive_moment"], 0.05), "delayed-channel", "drive_moment"),
        of(chair, late(&["encoder_"], 0.05), "delayed-channel", "encoder_left"),
        of(chair, late(&["accel_"], 0.05), "delayed-channel", "accel_x"),
        of(chair, changed(&["encoder_"], |v| v.iter_mut().for_each(|a| *a = a.rem_euclid(std::f64::consts::TAU))), "wrapped-channel", "encoder_right"),
        of(chair, changed(&["encoder_"], |v| v.iter_mut().for_each(|a| *a = (*a / 0.2).round() * 0.2)), "coarse-channel", "encoder_left"),
        of(chair, changed(&["accel_x"], freeze), "stuck-channel", "accel_x"),
        of(chair, changed(&["accel_x"], clip), "saturated-channel", "accel_x"),
        of(chair, changed(&["accel_y"], stop), "constant-channel", "accel_y"),
        of(("wheelchair", "oblique"), scaled(&["gyro_pitch"], DEGREES), "unit-mismatch", "gyro_pitch"),

        of(loader, scaled(&["speed"], 3.6), "unit-mismatch", "speed"),
        of(loader, scaled(&["wheel_speed_"], RPM), "unit-mismatch", "wheel_speed_front"),
        of(loader, scaled(&["torque_"], 1e-3), "unit-mismatch", "torque_front"),
        of(loader, scaled(&["torque_"], -1.0), "sign-mismatch", "torque_front"),
        of(loader, scaled(&["wheel_speed_front"], -1.0), "sign-mismatch", "wheel_speed_front"),
        of(loader, late(&["speed"], 0.05), "delayed-channel", "speed"),
        of(("wheel-loader", "bumpy-c"), late(&["speed"], 0.05), "delayed-channel", "speed"),
        of(loader, late(&["torque_"], 0.05), "delayed-channel", "torque_front"),
        of(loader, changed(&["wheel_speed_rear"], freeze), "stuck-channel", "wheel_speed_rear"),
        of(loader, changed(&["speed"], clip), "saturated-channel", "speed"),
        of(loader, changed(&["speed"], |v| (0..v.len()).for_each(|k| v[k] = v[k / 5 * 5])), "held-channel", "speed"),
        of(loader, changed(&["wheel_speed_"], |v| (0..v.len()).for_each(|k| v[k] = v[k * 10 / 47 * 47 / 10])), "held-channel", "wheel_speed_front"),
        of(loader, timed(|log| log.channels.retain(|c| c.name != "speed")), "missing-channel", "speed"),

        of(robot, scaled(&["accel_"], G), "unit-mismatch", "accel_x"),
        of(robot, scaled(&["gyro_z"], DEGREES), "unit-mismatch", "gyro_z"),
        of(robot, scaled(&["speed_x"], 3.6), "unit-mismatch", "speed_x"),
        of(robot, scaled(&["wheel_speed_"], RPM), "unit-mismatch", "wheel_speed_rl"),
        of(("wheeled-robot", "sine"), scaled(&["steering_angle"], DEGREES), "out-of-range", "steering_angle"),
        of(robot, scaled(&["accel_y"], -1.0), "sign-mismatch", "accel_y"),
        of(robot, scaled(&["accel_y", "gyro_z", "speed_y"], -1.0), "sign-mismatch", "gyro_z"),
        of(robot, scaled(&["steering_angle"], -1.0), "sign-mismatch", "steering_angle"),
        of(("wheeled-robot", "lane-change"), scaled(&["speed_y"], -1.0), "sign-mismatch", "speed_y"),
        of(robot, late(&["accel_", "gyro_z"], 0.05), "delayed-channel", "accel_x"),
        of(("wheeled-robot", "sine"), late(&["accel_", "gyro_z"], 0.05), "delayed-channel", "gyro_z"),
        of(robot, late(&["speed_"], 0.05), "delayed-channel", "speed_x"),
        of(robot, changed(&["gyro_z"], freeze), "stuck-channel", "gyro_z"),
        of(robot, changed(&["accel_y"], clip), "saturated-channel", "accel_y"),
        of(robot, timed(|log| log.channels.retain(|c| c.name != "speed_y")), "missing-channel", "speed_y"),
        of(robot, timed(|log| log.channels.retain(|c| c.name != "speed_x")), "missing-channel", "speed_x"),

        of(seated, scaled(&["q_"], DEGREES), "unit-mismatch", "q_lumbar_y"),
        of(seated, scaled(&["qd_"], DEGREES), "unit-mismatch", "qd_lumbar_y"),
        of(seated, scaled(&["qd_"], -1.0), "sign-mismatch", "qd_lumbar_y"),
        of(seated, scaled(&["base_accel"], G), "unit-mismatch", "base_accel_z"),
        of(seated, scaled(&["imu_head_accel"], G), "unit-mismatch", "imu_head_accel_z"),
        of(seated, late(&["qd_"], 0.05), "delayed-channel", "qd_lumbar_y"),
        of(seated, changed(&["q_lumbar_y"], freeze), "stuck-channel", "q_lumbar_y"),
    ]);
    all
}

#[test]
fn every_fault_that_a_log_shows_is_found() {
    let mut failures = Vec::new();
    for (number, (name, scenario, fault, code, channel)) in cases().into_iter().enumerate() {
        let (vehicle, seed) = (vehicle(name), 21 + number as u64 % 2);
        let mut log = simulated(vehicle, scenario, seed, &[]);
        fault(&mut log);
        let found = serious(vehicle, &log, &[]);
        let named = |finding: &Finding| finding.channel.split(", ").any(|one| one.starts_with(channel));
        if !found.iter().any(|finding| finding.code == code && named(finding)) {
            let got: Vec<_> = found.iter().map(|f| format!("{} {}", f.code, f.channel)).collect();
            failures.push(format!("{number}: {name} {scenario} {seed}: {code} of {channel} instead of {got:?}"));
        }
        assert!(found.iter().all(|finding| !finding.message.is_empty() && !finding.suggestion.is_empty()));
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn the_delay_is_measured_with_an_interval_that_holds_it() {
    for (name, scenario, stems, channel) in [
        ("wheel-loader", "accelerate-brake", &["speed"][..], "speed"),
        ("wheelchair", "identification", &["drive_force"][..], "drive_force"),
        ("nursing-robot", "identification", &["accel_x"][..], "accel_x"),
    ] {
        for seconds in [0.04, 0.08, 0.2] {
            let mut log = simulated(vehicle(name), scenario, 31, &[]);
            let samples = (seconds / log.period()).round() as usize;
            each(&mut log, stems, |v| *v = (0..v.len()).map(|k| v[k.saturating_sub(samples)]).collect());
            let found = serious(vehicle(name), &log, &[]);
            let late = found.iter().find(|f| f.code == "delayed-channel" && f.channel == channel).expect(name);
            let numbers: Vec<f64> =
                late.message.split([' ', '(', ')']).filter_map(|word| word.parse().ok()).take(3).collect();
            let [_, low, high] = numbers[..] else { panic!("{}", late.message) };
            let ms = 1e3 * seconds;
            // Two standard errors, and half a period that a held command is away.
            assert!(low - 6.0 <= ms && ms <= high + 6.0, "{name} {ms} ms: {}", late.message);
        }
    }
}

fn identify(folder: &Path, arguments: &str) -> (Option<i32>, String, String) {
    let output = Command::cargo_bin("identify")
        .unwrap()
        .current_dir(folder)
        .args(arguments.split_whitespace())
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn check_and_fit_refuse_accelerations_in_g_and_times_in_milliseconds() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let g =
        ["x", "y", "z"].map(|axis| format!("accel_{axis} = {{ column = \"accel_{axis}\", scale = {G} }}\n")).concat();
    std::fs::write(folder.join("g.toml"), g).unwrap();
    std::fs::write(folder.join("ms.toml"), "time = { column = \"time\", scale = 1000 }\n").unwrap();
    for (vehicle, map, code) in
        [("wheelchair", "g.toml", "unit-mismatch"), ("nursing-robot", "ms.toml", "period-out-of-range")]
    {
        identify(folder, &format!("simulate {vehicle} --scenario identification --seed 4 --out log.csv"));
        assert_eq!(identify(folder, &format!("check {vehicle} log.csv")).0, Some(0));
        let (exit, json, _) = identify(folder, &format!("check {vehicle} log.csv --columns {map} --json"));
        assert_eq!(exit, Some(2), "{json}");
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let first = &json["findings"][0];
        assert_eq!((first["code"].as_str(), first["severity"].as_str()), (Some(code), Some("refusal")), "{json}");
        assert_eq!(first["file"], "log.csv");
        let (exit, _, error) = identify(folder, &format!("fit {vehicle} log.csv --columns {map} --out fit.json"));
        assert_eq!(exit, Some(2));
        assert!(error.lines().count() == 1 && error.contains(code) && error.contains("--allow"), "{error}");
        let fit = std::fs::read(folder.join("fit.json")).unwrap();
        let fit: serde_json::Value = serde_json::from_slice(&fit).unwrap();
        assert!(fit["refused"].as_str().unwrap().contains(code) && fit["parameters"].as_object().unwrap().is_empty());
        let (exit, ..) = identify(folder, &format!("check {vehicle} log.csv --columns {map} --allow {code}"));
        assert_eq!(exit, Some(0));
    }
}

#[test]
fn a_fit_to_a_speed_that_arrives_late_ends_with_a_warning_that_names_it() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let mut log = simulated(vehicle("wheel-loader"), "bumpy-c", 5, &[]);
    late(&["speed"], 0.05)(&mut log);
    log.write_csv(std::fs::File::create(folder.join("late.csv")).unwrap()).unwrap();
    let (exit, _, error) = identify(folder, "fit wheel-loader late.csv --out fit.json");
    assert_eq!(exit, Some(1), "{error}");
    assert!(error.contains("speed: arrives") && error.contains("[delayed-channel]"), "{error}");
    let fit: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("fit.json")).unwrap()).unwrap();
    assert_eq!(fit["findings"][0]["code"], "delayed-channel");
}

/// A person on a robot in a slalom, in other words than the built-in plant: a pendulum on a spring, a tenth of a millisecond at a
/// time, with all sensors' noise. Roll and its rate are late by so many samples of 10 ms, the yaw rate by others.
fn slalom(swing_hz: f64, damping_ratio: f64, roll_late: isize, yaw_late: isize, seed: u64) -> Log {
    let nurse = vehicle("nursing-robot");
    let given = |name: &str| nurse.parameters().iter().find(|p| p.name == name).unwrap().start;
    let (height, gyration) = (given("human.com_height"), given("human.gyration_radius"));
    // Per kilogram: inertia about the hip, spring less gravity, damper.
    let inertia = height * height + gyration * gyration;
    let omega = std::f64::consts::TAU * swing_hz;
    let (spring, damper) = (inertia * omega * omega, 2.0 * damping_ratio * inertia * omega);
    let (fine, every, samples) = (1e-4, 100, 4000);
    let speed = |t: f64| (1.1 + 0.2 * (0.9 * t).sin()) * (t / 2.0).min(1.0);
    let yaw_rate = |t: f64| 0.5 * (2.1 * t).sin() + 0.3 * (4.7 * t + 1.0).sin() + 0.15 * (7.3 * t).sin();
    let (mut roll, mut rate) = (0.02, 0.0);
    let mut truth: Vec<[f64; 4]> = Vec::new();
    for step in 0..samples * every {
        let t = step as f64 * fine;
        if step % every == 0 {
            truth.push([speed(t), yaw_rate(t), roll, rate]);
        }
        rate += fine * (height * speed(t) * yaw_rate(t) - damper * rate - spring * (roll - 0.02)) / inertia;
        roll += fine * rate;
    }
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut noise = |std: f64| {
        let mut uniform = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum::<f64>() * std
    };
    let at = |k: usize, late: isize| (k as isize - late).clamp(0, samples as isize - 1) as usize;
    let mut of = |channel: usize, late: isize, std: f64| -> Series {
        (0..samples).map(|k| truth[at(k, late)][channel] + noise(std)).collect()
    };
    let channels = [
        ("speed", of(0, 0, 0.005)),
        ("yaw_rate", of(1, yaw_late, 0.005)),
        ("roll", of(2, roll_late, 0.01)),
        ("roll_rate", of(3, roll_late, 0.01)),
    ];
    let mut log = simulated(nurse, "identification", 1, &[("plant.duration", 39.99)]);
    log.channels.retain(|channel| ["torque_left", "torque_right"].contains(&channel.name.as_str()));
    let length = log.len();
    assert_eq!(length, samples);
    log.channels
        .extend(channels.map(|(name, values)| wheelstate_identify::log::Channel { name: name.to_owned(), values }));
    log
}

/// A late roll looks like damping to the fit, so that nothing else tells of it: the truth is whatever the log was made with.
#[test]
fn a_roll_that_is_late_against_the_turning_is_named_with_an_interval_that_holds_its_delay() {
    let nurse = vehicle("nursing-robot");
    let found = |log: &Log| {
        let mut found = serious(nurse, log, &[]);
        // Its torques belong to another drive.
        found.retain(|finding| finding.channel.contains("roll") || finding.channel.contains("yaw_rate"));
        found
    };
    for (swing_hz, damping_ratio) in [(0.8, 0.4), (1.1, 0.25), (1.4, 0.2)] {
        for seed in [3, 4] {
            let of = |roll, yaw| found(&slalom(swing_hz, damping_ratio, roll, yaw, seed));
            assert!(of(0, 0).is_empty(), "{swing_hz} {seed}: {:?}", of(0, 0));
            for (roll, yaw, late, ms) in [(5, 0, "roll", 50.0), (0, 5, "yaw_rate", 50.0), (8, 1, "roll", 70.0)] {
                let all = of(roll, yaw);
                let [finding] = all.as_slice() else { panic!("{swing_hz} {seed} {roll} {yaw}: {all:?}") };
                assert_eq!(finding.code, "delayed-channel");
                assert!(finding.channel.contains(late), "{finding:?}");
                let interval = finding.message.split(['(', ')']).nth(1).unwrap();
                let ends: Vec<f64> = interval.split(" to ").map(|end| end.parse().unwrap()).collect();
                assert!(ends[0] - 3.0 <= ms && ms <= ends[1] + 3.0, "{ms}: {finding:?}");
            }
        }
    }
}

/// The drive's first half is straight at a steady speed: what it tells about turning comes from the second half alone.
#[test]
fn the_most_informative_part_of_a_log_is_named() {
    let chair = vehicle("wheelchair");
    let mut log = simulated(chair, "identification", 6, &[]);
    let until = log.time.iter().position(|t| *t >= 20.0).unwrap();
    for (name, value) in [("drive_force", 0.0), ("drive_moment", 0.0), ("encoder_left", 0.0), ("encoder_right", 0.0)] {
        let channel = log.channels.iter_mut().find(|c| c.name == name).unwrap();
        let begin = channel.values[until];
        channel.values[..until].fill(if name.starts_with("encoder") { begin } else { value });
    }
    let told = chair.information(&log, &[], &Progress::none()).unwrap();
    let inertia = told.iter().find(|finding| finding.message.starts_with("chair.yaw_inertia")).unwrap();
    assert!(inertia.time.is_some_and(|time| time >= 19.9), "{inertia:?}");
    assert!(told.iter().all(|finding| finding.severity == Severity::Note && finding.code == "expected-accuracy"));
}

#[test]
fn runs_that_share_a_file_are_a_note_and_no_alarm() {
    let loader = vehicle("wheel-loader");
    let mut log = simulated(loader, "accelerate-brake", 7, &[]);
    log.time.iter_mut().filter(|t| **t > 15.0).for_each(|t| *t += 400.0);
    let found = loader.check(&log, &[]).unwrap();
    assert!(found.iter().all(|finding| finding.severity == Severity::Note), "{found:#?}");
    assert!(found.iter().any(|finding| finding.code == "time-gap" && finding.message.contains("2 runs")));
}

/// A logger that starts at 0 and gets the time of day later: even steps over that would fill any memory.
#[test]
fn a_clock_that_was_set_while_recording_is_refused() {
    for vehicle in vehicles::ALL {
        let mut log = simulated(vehicle, vehicle.simulation.scenarios[0].name, 8, &[]);
        let half = log.len() / 2;
        log.time[half..].iter_mut().for_each(|t| *t += 1.7e9);
        let found = serious(vehicle, &log, &[]);
        assert!(found.iter().any(|f| f.code == "time-gap" && f.severity == Severity::Refusal), "{vehicle}: {found:#?}");
    }
}

/// What only the fit of the wheeled robot reads is no misspelt input.
#[test]
fn a_column_map_may_name_what_only_the_fit_reads() {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("map.toml"), "speed_x = \"speed_x\"\nspeed_y = \"speed_y\"\n").unwrap();
    identify(folder.path(), "simulate wheeled-robot --scenario sine --seed 4 --out log.csv");
    let (exit, _, notes) = identify(folder.path(), "check wheeled-robot log.csv --columns map.toml");
    assert_eq!(exit, Some(0));
    assert!(!notes.contains("is no input"), "{notes}");
}

#[test]
fn a_log_that_cannot_be_read_is_a_finding_and_the_others_are_looked_at() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("back.csv"), "time,speed\n0,1\n0.2,1\n0.1,1\n").unwrap();
    identify(folder, "simulate wheel-loader --scenario bumpy-c --seed 4 --out good.csv");
    let (exit, json, _) = identify(folder, "check wheel-loader back.csv good.csv --json");
    assert_eq!(exit, Some(2));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["findings"][0]["code"], "unreadable-log");
    assert_eq!(json["findings"][0]["file"], "back.csv");
}
