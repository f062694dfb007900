//! The human body from end to end: simulated logs, estimates over them, passive joints fitted.

use wheelstate_identify::estimate;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicles::human_dynamics;

fn request(scenario: &str, seed: u64, settings: &[(&str, f64)]) -> Request {
    let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    Request { scenario: scenario.to_owned(), seed, settings }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1));
    (sum / f64::from(count)).sqrt()
}

/// Every `stride`-th sample of a log.
fn thin(log: &Log, stride: usize) -> Log {
    let pick = |values: &[f64]| values.iter().copied().step_by(stride).collect::<Vec<_>>();
    let mut thin = Log { source: log.source.clone(), time: pick(&log.time).into(), ..Log::default() };
    log.channels.iter().for_each(|c| thin.push(&c.name, pick(&c.values)));
    thin
}

struct Written {
    _folder: tempfile::TempDir,
    urdf: std::path::PathBuf,
    toml: String,
}

fn written(request: &Request) -> Written {
    let folder = tempfile::tempdir().unwrap();
    let files = human_dynamics::VEHICLE.companions(request).unwrap();
    let urdf = folder.path().join("body.urdf");
    std::fs::write(&urdf, &files.iter().find(|(ending, _)| *ending == "urdf").unwrap().1).unwrap();
    let toml = files.iter().find(|(ending, _)| *ending == "sensors.toml").unwrap().1.clone();
    Written { _folder: folder, urdf, toml }
}

/// Takes the body as exact, as the source does.
const EXACT_BODY: &str = "
[scatter]
mass_std = 0.0
segment_mass_std = 0.0
segment_com_std = 0.0
segment_inertia_std = 0.0
inclination_std = 0.0
";

/// Estimates with those sensors whose table `keeps`, and equation variances replaced, for an exact body.
fn estimated(written: &Written, log: &Log, variance: &str, keeps: impl Fn(&str) -> bool) -> Log {
    let mut parts = written.toml.split("\n[[");
    let head = parts.next().unwrap().replace("1e-4", variance);
    let tables: Vec<String> = parts.filter(|part| keeps(part)).map(|part| format!("\n[[{part}")).collect();
    let path = written.urdf.with_extension("toml");
    std::fs::write(&path, head + EXACT_BODY + &tables.concat()).unwrap();
    let mut setup = estimate::setup(&written.urdf, &path).unwrap();
    estimate::run(&mut setup, log, &Progress::none()).unwrap()
}

const WATCHED: [&str; 6] =
    ["jRightAnkle_roty", "jLeftAnkle_roty", "jRightHip_roty", "jLeftHip_roty", "jRightShoulder_roty", "jL5S1_roty"];

fn plates(table: &str) -> bool {
    !table.contains("accelerometer") && !table.contains("hand")
}
fn imus(table: &str) -> bool {
    !table.contains("hand")
}

/// Bowing: more sensors never raise a variance; the ankles hardly gain, the hips do; the truth lies
/// within two standard deviations.
#[test]
fn more_sensors_narrow_the_torques_of_a_bow_that_stay_within_their_variances() {
    let request = request("bowing", 1, &[]);
    let full = human_dynamics::VEHICLE.simulate(&request).unwrap();
    let log = thin(&full, 120);
    let files = written(&request);
    let cases = [
        ("qdd + plates", estimated(&files, &log, "1e-4", plates)),
        ("+ IMUs", estimated(&files, &log, "1e-4", imus)),
        ("+ hands", estimated(&files, &log, "1e-4", |_| true)),
    ];
    let variance = |case: usize, joint: &str| {
        let std = cases[case].1.channel(&format!("tau_{joint}_std")).unwrap();
        std.iter().map(|s| s * s).sum::<f64>() / std.len() as f64
    };
    for (k, (what, result)) in cases.iter().enumerate() {
        let mut line = format!("{what:14}");
        let (mut inside, mut count) = (0, 0);
        for joint in WATCHED {
            let (tau, std) = (
                result.channel(&format!("tau_{joint}")).unwrap(),
                result.channel(&format!("tau_{joint}_std")).unwrap(),
            );
            let truth = log.channel(&format!("true_tau_{joint}")).unwrap();
            let error = rms(tau.iter().zip(truth).map(|(a, b)| a - b));
            inside += (0..tau.len()).filter(|&i| (tau[i] - truth[i]).abs() <= 2.0 * std[i]).count();
            count += tau.len();
            line += &format!("  {joint} {:.4} ({error:.2} of {:.1})", variance(k, joint), rms(truth.iter().copied()));
        }
        let share = inside as f64 / count as f64;
        println!("{line}  covered {share:.2}");
        assert!((0.85..=1.0).contains(&share), "{what}: {share}");
        assert!(result.channel("status").unwrap().iter().all(|s| *s == 0.0), "{what}");
    }
    for name in full.channels.iter().filter_map(|c| c.name.strip_prefix("true_tau_")) {
        assert!(
            variance(1, name) <= variance(0, name) * (1.0 + 1e-8)
                && variance(2, name) <= variance(1, name) * (1.0 + 1e-8)
        );
    }
    for side in ["Right", "Left"] {
        let ratio = |joint: &str| variance(2, joint) / variance(0, joint);
        assert!(ratio(&format!("j{side}Hip_roty")) <= 0.6, "hip {}", ratio(&format!("j{side}Hip_roty")));
        assert!(ratio(&format!("j{side}Ankle_roty")) >= 0.8, "ankle {}", ratio(&format!("j{side}Ankle_roty")));
    }
}

/// 6 kg at T8 that the model does not know: looser equations and plates keep the error smaller.
#[test]
fn an_unknown_weight_shows_in_loose_equations_least() {
    let settings = [("plant.extra_mass", 6.0), ("plant.hand_force", 0.0)];
    let request = request("bowing", 2, &settings);
    let log = thin(&human_dynamics::VEHICLE.simulate(&request).unwrap(), 120);
    let files = written(&request);
    let plain = thin(&human_dynamics::VEHICLE.simulate(&self::request("bowing", 2, &settings[1..])).unwrap(), 120);
    // with the hands measured nothing else can explain the weight away
    let loose = estimated(&files, &log, "1e-1", |_| true);
    let tight = estimated(&files, &log, "1e-4", |_| true);
    let mut errors = vec![];
    for joint in ["jRightAnkle_roty", "jRightHip_roty", "jL5S1_roty"] {
        let truth = log.channel(&format!("true_tau_{joint}")).unwrap();
        let error =
            |result: &Log| rms(result.channel(&format!("tau_{joint}")).unwrap().iter().zip(truth).map(|(a, b)| a - b));
        // inverse dynamics from the hands down would miss exactly what the weight adds
        let weight = rms(plain.channel(&format!("true_tau_{joint}")).unwrap().iter().zip(truth).map(|(a, b)| a - b));
        println!(
            "{joint}: 1e-1 {:.2}, 1e-4 {:.2}, the weight's own torque {weight:.2} N.m",
            error(&loose),
            error(&tight)
        );
        errors.push((error(&loose), error(&tight), weight));
    }
    for (loose, tight, weight) in errors {
        assert!(loose < 0.5 * tight && tight < weight, "{loose} {tight} {weight}");
    }
    let nis = |log: &Log| log.channel("nis").unwrap().iter().sum::<f64>() / log.len() as f64;
    let (with, without) = (nis(&tight), nis(&estimated(&files, &plain, "1e-4", |_| true)));
    println!("normalised innovation squared {without:.1} without and {with:.1} with the weight");
    assert!(with > 2.0 * without);
}

/// The seated person's passive joints come out of the estimated torques.
#[test]
fn the_passive_joints_of_a_seated_person_are_fitted_and_covered() {
    let log = human_dynamics::VEHICLE.simulate(&request("seated-braking", 3, &[("plant.duration", 12.0)])).unwrap();
    let report = human_dynamics::VEHICLE.fit(&[log], &FitRequest::default(), &Progress::none()).unwrap();
    let truth = [
        ("lumbar_x", 180.0, 14.0),
        ("lumbar_y", 220.0, 18.0),
        ("thorax_y", 160.0, 12.0),
        ("thorax_z", 60.0, 4.0),
        ("neck_x", 25.0, 1.5),
        ("neck_y", 30.0, 1.8),
        ("right_shoulder_y", 24.0, 1.8),
        ("left_elbow_y", 12.0, 0.8),
        ("right_hip_y", 90.0, 8.0),
        ("left_knee_y", 45.0, 4.0),
    ];
    let (mut covered, mut count) = (0, 0);
    for (joint, stiffness, damping) in truth {
        for (name, expected) in [(format!("stiffness.{joint}"), stiffness), (format!("damping.{joint}"), damping)] {
            let p = &report.parameters[&name];
            println!("{name}: {:.3} +- {:.3} (truth {expected}) identified {}", p.value, p.std_error, p.identified);
            if p.identified {
                count += 1;
                covered += usize::from(p.ci95[0] <= expected && expected <= p.ci95[1]);
                assert!((p.value - expected).abs() < 0.15 * expected, "{name}: {}", p.value);
            }
        }
    }
    assert!(count >= 14, "{count} identified");
    assert!(covered * 10 >= count * 7, "{covered} of {count} intervals hold the truth");
}

/// A late force on a hand biases the arms' springs and shows in nothing but the torques of the arms.
#[test]
fn forces_on_the_hands_that_arrive_late_are_named() {
    let log = human_dynamics::VEHICLE.simulate(&request("seated-braking", 11, &[])).unwrap();
    let told = |log: Log| -> Vec<String> {
        let report = human_dynamics::VEHICLE.fit(&[log], &FitRequest::default(), &Progress::none()).unwrap();
        report.warnings.into_iter().filter(|line| line.contains("later than the motion")).collect()
    };
    let mut late = log.clone();
    let samples = (0.05 / log.period()).round() as usize;
    for channel in late.channels.iter_mut().filter(|channel| channel.name.contains("_hand_")) {
        let old = channel.values.clone();
        channel.values = (0..old.len()).map(|k| old[k.saturating_sub(samples)]).collect();
    }
    let found = told(late);
    let words = "the forces on the hands arrive about ";
    let line = found.iter().find(|line| line.starts_with(words)).unwrap_or_else(|| panic!("{found:?}"));
    let ms: f64 = line[words.len()..].split_whitespace().next().unwrap().parse().unwrap();
    assert!((ms - 50.0).abs() < 20.0, "{line}");
    assert_eq!(told(log), Vec::<String>::new());
}

/// Without hand and foot sensors the arms' and legs' torques are not known, and the fit says so.
#[test]
fn unobservable_joints_are_not_fitted() {
    let mut log = human_dynamics::VEHICLE.simulate(&request("seated-braking", 4, &[])).unwrap();
    log.channels.retain(|c| !c.name.contains("_hand_") && !c.name.contains("_foot_"));
    let report =
        human_dynamics::VEHICLE.fit(std::slice::from_ref(&log), &FitRequest::default(), &Progress::none()).unwrap();
    for joint in ["right_knee_y", "left_elbow_y", "right_shoulder_x"] {
        assert!(!report.parameters[&format!("stiffness.{joint}")].identified, "{joint}");
    }
    assert!(
        !report.has_warnings() && report.notes.iter().any(|note| note.starts_with("stiffness.right_knee_y is not"))
    );
    let asked = FitRequest { only: vec!["stiffness.right_knee_y".to_owned()], ..FitRequest::default() };
    assert!(human_dynamics::VEHICLE.fit(&[log], &asked, &Progress::none()).unwrap().has_warnings());
}

/// Estimates of the seated scenario with the seat's own force sensor and without.
#[test]
fn every_further_sensor_narrows_the_seated_torques() {
    use wheelstate::estimator::human_dynamics::variables::JOINTS;
    use wheelstate::estimator::human_dynamics::{HumanDynamics as Seated, Inputs, Outputs, Parameters};
    use wheelstate::model::multibody::scatter::ScatterParameters;
    use wheelstate::{Estimator, Variables};
    let log = human_dynamics::VEHICLE.simulate(&request("seated-braking", 5, &[])).unwrap();
    let levels: [&[&str]; 4] = [
        &[],
        &["use.imu"],
        &["use.imu", "use.seat_wrench"],
        &["use.imu", "use.seat_wrench", "use.hand_wrench", "use.foot_wrench"],
    ];
    let channels: Vec<&[f64]> = Inputs::declare().iter().map(|v| log.channel(&v.name).unwrap()).collect();
    let mut before: Option<Vec<f64>> = None;
    for (level, used) in levels.iter().enumerate() {
        // the plant's person is the table's, and its sensors are sampled together
        let mut parameters = Parameters { scatter: ScatterParameters::NONE, delay_std: 0.0, ..Parameters::default() };
        used.iter().for_each(|name| parameters.set(name, 1.0).unwrap());
        let mut estimator = Seated::new(&parameters).unwrap();
        let (mut inputs, mut outputs) = (Inputs::default(), Outputs::default());
        let (mut inside, mut count) = (0, 0);
        let mut std = vec![0.0; 25];
        for row in 0..log.len() {
            inputs.read(&channels.iter().map(|c| c[row]).collect::<Vec<_>>());
            estimator.step(&inputs, 0.01);
            estimator.outputs(&inputs, 0.0, &mut outputs);
            for (joint, (name, ..)) in JOINTS.iter().enumerate() {
                let truth = log.channel(&format!("true_tau_{name}")).unwrap()[row];
                inside += usize::from((outputs.tau[joint].value - truth).abs() <= 2.0 * outputs.tau[joint].std);
                count += 1;
            }
            let all = outputs.tau.iter().chain(&outputs.seat_wrench).map(|estimate| estimate.std);
            std.iter_mut().zip(all).for_each(|(sum, s)| *sum += s / log.len() as f64);
        }
        let covered = inside as f64 / f64::from(count);
        println!(
            "L{}: seat Fx {:.1}, Fz {:.1} N | lumbar y {:.2} | shoulder y {:.2} N.m | covered {covered:.3}",
            level + 1,
            std[19],
            std[21],
            std[1],
            std[8]
        );
        assert!(covered > 0.9, "level {level}: {covered}");
        if let Some(before) = before {
            assert!(std.iter().zip(&before).all(|(now, before)| *now <= before * (1.0 + 1e-6)));
        }
        before = Some(std);
    }
    let last = before.unwrap();
    assert!(last[19] < 2.0 && last[21] < 2.0 && last[1] < 1.0 && last[8] < 0.6, "{last:?}");
}

/// `identify estimate` over the two links: exit code, what it printed, and the result if there is one.
fn run(toml: &str, log: &str) -> (i32, String, Option<String>) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let urdf = include_str!("../../../tests/human_dynamics/two_link.urdf");
    std::fs::write(path("body.urdf"), urdf).unwrap();
    std::fs::write(path("sensors.toml"), toml).unwrap();
    std::fs::write(path("log.csv"), log).unwrap();
    let output = assert_cmd::Command::cargo_bin("identify")
        .unwrap()
        .args(["estimate", "human-dynamics"])
        .arg(path("log.csv"))
        .arg("--model")
        .arg(path("body.urdf"))
        .arg("--sensors")
        .arg(path("sensors.toml"))
        .arg("--out")
        .arg(path("out.csv"))
        .output()
        .unwrap();
    let printed = [output.stdout, output.stderr].concat();
    let result = std::fs::read_to_string(path("out.csv")).ok();
    (output.status.code().unwrap(), String::from_utf8(printed).unwrap(), result)
}

/// What a refused estimation says.
fn refusal(toml: &str, log: &str) -> String {
    let (code, printed, result) = run(toml, log);
    assert_eq!((code, result), (2, None), "{printed}");
    printed
}

const HEAD: &str = "base = \"foot\"\nvariant = \"fixed\"\ngravity = [0, 0, -9.81]\n";
const LOG: &str = "time,q_ankle,qd_ankle,qdd_ankle\n0,0.1,0,0\n0.01,0.1,0,0\n0.02,nan,0,0\n";

fn with(sensor: &str) -> String {
    format!("{HEAD}\n[[sensor]]\n{sensor}\n")
}

#[test]
fn the_command_estimates_the_torque_of_a_lean() {
    let sensor = "type = \"joint_acceleration\"\njoint = \"ankle\"\nvariance = 1e-6\ncolumns = [\"qdd_ankle\"]\n\
                  \n[[sensor]]\ntype = \"net_ext_wrench\"\nlink = \"head\"\nvariance = 1e-6\nvalue = 0.0";
    let (code, _, result) = run(&with(sensor), LOG);
    let result = result.unwrap();
    assert_eq!(code, 0);
    let mut lines = result.lines();
    assert!(lines.next().unwrap().starts_with("time,tau_ankle,tau_ankle_std"));
    let row: Vec<f64> = lines.next().unwrap().split(',').map(|c| c.parse().unwrap()).collect();
    // leg 10 kg at 0.4 m and head 5 kg at 0.9 m, leaning 0.1 rad: the ankle holds them back
    let expected = -9.81 * 0.1_f64.sin() * (10.0 * 0.4 + 5.0 * 0.9);
    assert!((row[1] - expected).abs() < 0.05, "{} {expected}", row[1]);
    assert_eq!(result.lines().count(), 4);
    assert!(result.lines().nth(3).unwrap().contains("nan"), "a posture that is missing has no estimate");
}

/// A gyroscope behind the fixed neck, turned by a right angle about z: its x axis is the ankle's.
#[test]
fn a_gyroscope_is_compared_with_the_rates_of_the_joints() {
    let sensor = with(
        "type = \"gyroscope\"\nlink = \"head\"\nrpy = [0, 0, 1.5707963267948966]\n\
                       variance = 1e-4\ncolumns = [\"w_x\", \"w_y\", \"w_z\"]",
    );
    let head = "time,q_ankle,qd_ankle,w_x,w_y,w_z\n";
    let (code, printed, result) =
        run(&sensor, &format!("{head}0,0.3,0.5,0.52,-0.01,nan\n0.01,0.3,-1,-1,0,0.005\n0.02,nan,0,0,0,0\n"));
    assert_eq!(code, 0, "{printed}");
    assert!(printed.contains("'gyroscope head': agrees with the rates"), "{printed}");
    let result = result.unwrap();
    let cell = |name: &str, row: usize| -> f64 {
        let column = result.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
        result.lines().nth(row + 1).unwrap().split(',').nth(column).unwrap().parse().unwrap()
    };
    let expected = [[0.02, -0.01, f64::NAN], [0.0, 0.0, 0.005], [f64::NAN; 3]];
    for (row, axes) in expected.iter().enumerate() {
        for (axis, value) in ["x", "y", "z"].iter().zip(axes) {
            let found = cell(&format!("innovation_w_{axis}"), row);
            assert!((found - value).abs() < 1e-12 || (found.is_nan() && value.is_nan()), "{axis} {row}: {found}");
        }
    }
    // mounted the wrong way round
    let (code, printed, result) = run(&sensor, &format!("{head}0,0.3,0.5,-0.5,0,0\n0.01,0.3,1,-1,0,0\n"));
    assert_eq!((code, result.is_some()), (1, true), "{printed}");
    assert!(printed.contains("warning: 'gyroscope head': contradicts the rates"), "{printed}");
}

#[test]
fn refusals_name_file_and_place() {
    let one = "variance = 1.0\nvalue = 0.0";
    let cases = [
        (with(&format!("type = \"accelerometer\"\nlink = \"nose\"\n{one}")), "nose"),
        (with(&format!("type = \"joint_torque\"\njoint = \"nose\"\n{one}")), "nose"),
        (with(&format!("type = \"accelerometer\"\nlink = \"foot\"\n{one}")), "foot"),
        (with("type = \"joint_torque\"\njoint = \"ankle\"\nvariance = 0.0\nvalue = 0.0"), "ankle"),
        (with("type = \"net_ext_wrench\"\nlink = \"leg\"\nvariance = [1, 1, -1, 1, 1, 1]\nvalue = 0.0"), "leg"),
        (with("type = \"net_ext_wrench\"\nlink = \"leg\"\nvariance = [1, 1]\nvalue = 0.0"), "leg"),
        (with("type = \"joint_torque\"\nlink = \"leg\"\nvariance = 1.0\nvalue = 0.0"), "leg"),
        (with("type = \"balance\"\nlink = \"leg\"\nvariance = 1.0\nvalue = 0.0"), "balance"),
        (with("type = \"joint_torque\"\njoint = \"ankle\"\nvariance = 1.0"), "ankle"),
        (HEAD.replace("foot", "nose"), "nose"),
        (format!("{HEAD}[variance]\ntorque = -1.0\n"), "torque"),
        (format!("{HEAD}[variance]\ntork = 1.0\n"), "tork"),
        (HEAD.replace("fixed", "flying"), "flying"),
    ];
    for (toml, word) in cases {
        let line = refusal(&toml, LOG);
        assert!(line.contains("sensors.toml") && line.contains(word), "{line}");
        assert_eq!(line.trim().lines().count(), 1);
    }
    let missing = with("type = \"joint_torque\"\njoint = \"ankle\"\nvariance = 1.0\ncolumns = [\"t_ankle\"]");
    let line = refusal(&missing, LOG);
    assert!(line.contains("log.csv") && line.contains("t_ankle"), "{line}");
    let line = refusal(HEAD, "time,q_ankle\n0,0\n1,0\n");
    assert!(line.contains("log.csv") && line.contains("qd_ankle"), "{line}");
}

#[test]
fn bench_prints_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = folder.path().join("body.urdf");
    std::fs::write(&urdf, include_str!("../../../tests/human_dynamics/two_link.urdf")).unwrap();
    let toml = folder.path().join("s.toml");
    std::fs::write(&toml, with("type = \"joint_acceleration\"\njoint = \"ankle\"\nvariance = 1e-6\ncolumns = [\"x\"]"))
        .unwrap();
    let command = assert_cmd::Command::cargo_bin("identify")
        .unwrap()
        .args(["bench", "human-dynamics", "--steps", "50", "--model"])
        .arg(&urdf)
        .arg("--sensors")
        .arg(&toml)
        .output()
        .unwrap();
    let text = String::from_utf8(command.stdout).unwrap();
    assert_eq!(text.trim().lines().count(), 1);
    let line: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (line["variables"].as_u64(), line["measurements"].as_u64(), line["steps"].as_u64()),
        (Some(26), Some(1), Some(50))
    );
    assert!(line["mean_only_us"].as_f64().unwrap() > 0.0 && line["with_variances_us"].as_f64().unwrap() > 0.0);
}
