//! Whether intervals hold the truth: every machine times every way in which real logs are worse than simulated ones.
//!
//! The plants are not the fit's equations. A cell counts the parameters that are called identified: the share of their
//! 95 % intervals that hold the truth, and the largest error in standard errors among the logs that end without
//! any warning. The gate is what a user relies on: intervals hold, or the parameter is not identified, or a warning
//! says why; and nothing is beyond four standard errors without one.
//!
//! The whole table, 20 logs per cell: `cargo test --release -p wheelstate-identify --test main coverage -- --ignored --nocapture`

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::collections::BTreeMap;
use wheelstate_identify::finding::Severity;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::problem::noise::noise_of;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles;

struct Machine {
    name: &'static str,
    scenario: &'static str,
    /// Truth by the parameter's name: a constant channel, or a value.
    truth: fn(&Log) -> BTreeMap<String, f64>,
    /// Known values that go with a log, by name and channel of the truth.
    known: &'static [(&'static str, &'static str)],
    /// Channels that are late together.
    devices: &'static [&'static [&'static str]],
    /// Channels with a gain, channels with a bias and how large it is, a known mass.
    gain: &'static [&'static str],
    bias: (&'static str, f64),
    mass: &'static str,
}

fn of_channels(log: &Log, names: &[(&str, &str)]) -> BTreeMap<String, f64> {
    let value = |channel: &str| log.channel(channel).and_then(|values| values.first().copied());
    names.iter().filter_map(|(name, channel)| Some(((*name).to_owned(), value(channel)?))).collect()
}

/// Every constant channel `true_<parameter>`.
fn constants(log: &Log) -> BTreeMap<String, f64> {
    let named = |name: &str| name.strip_prefix("true_").filter(|rest| rest.contains('.')).map(str::to_owned);
    log.channels.iter().filter_map(|channel| Some((named(&channel.name)?, channel.values[0]))).collect()
}

fn loader(log: &Log) -> BTreeMap<String, f64> {
    let names = [
        ("initial.slip_stiffness", "true_slip_stiffness"),
        ("initial.cg_ratio", "true_cg_ratio"),
        ("initial.cg_height", "true_cg_height"),
        ("rolling.coefficient", "true_rolling_coefficient"),
        ("loader.wheel_radius_front", "true_wheel_radius_front"),
        ("loader.wheel_radius_rear", "true_wheel_radius_rear"),
    ];
    of_channels(log, &names)
}

const MACHINES: [Machine; 3] = [
    Machine {
        name: "nursing-robot",
        scenario: "identification",
        truth: constants,
        known: &[
            ("human.nominal_mass", "true_load_mass"),
            ("human.com_height", "true_human.com_height"),
            ("human.gyration_radius", "true_human.gyration_radius"),
        ],
        devices: &[&["tilt", "tilt_rate"], &["roll", "roll_rate"], &["speed"], &["torque_left", "torque_right"]],
        gain: &["torque_left", "torque_right"],
        bias: ("tilt", 0.01),
        mass: "human.nominal_mass",
    },
    Machine {
        name: "wheelchair",
        scenario: "identification",
        truth: constants,
        known: &[],
        devices: &[&["drive_force", "drive_moment"], &["accel_x", "accel_y", "accel_z", "gyro_z"]],
        gain: &["drive_force"],
        bias: ("accel_x", 0.05),
        mass: "chair.wheel_radius",
    },
    Machine {
        name: "wheel-loader",
        scenario: "accelerate-brake",
        truth: loader,
        known: &[],
        devices: &[&["speed"], &["torque_front", "torque_rear"], &["wheel_speed_front", "wheel_speed_rear"]],
        gain: &["torque_front", "torque_rear"],
        bias: ("slope", 0.01),
        mass: "loader.mass",
    },
];

/// What is done to a log.
#[derive(Clone, Copy, Debug)]
enum Damage {
    White,
    Coloured(f64),
    Late(usize),
    Gain,
    Bias,
    Known,
    Jitter,
    Quantised,
    Dropped,
    Spikes,
    First(f64),
    /// A second log whose rest angles are others.
    OtherRest,
}

impl Damage {
    fn all(machine: &Machine) -> Vec<Self> {
        let mut all = vec![Self::White, Self::Coloured(0.5), Self::Coloured(0.95)];
        all.extend((0..machine.devices.len()).map(Self::Late));
        all.extend([Self::Gain, Self::Bias, Self::Known, Self::Jitter, Self::Quantised, Self::Dropped, Self::Spikes]);
        all.extend([3.0, 5.0, 10.0].map(Self::First));
        if machine.name == "nursing-robot" {
            all.push(Self::OtherRest);
        }
        all
    }

    fn word(self, machine: &Machine) -> String {
        match self {
            Self::Coloured(rho) => format!("AR(1) {rho}"),
            Self::Late(device) => format!("{} 20 ms late", machine.devices[device][0]),
            Self::Gain => format!("{} gain +2 %", machine.gain[0]),
            Self::Bias => format!("{} +{}", machine.bias.0, machine.bias.1),
            Self::Known => format!("{} +5 %", machine.mass),
            Self::First(seconds) => format!("first {seconds} s"),
            other => format!("{other:?}").to_lowercase(),
        }
    }

    fn apply(self, machine: &Machine, log: &mut Log, rng: &mut ChaCha8Rng) {
        let period = log.period();
        let measured = |name: &str| !name.starts_with("true_");
        let sensors = |log: &Log| -> Vec<usize> {
            (0..log.channels.len()).filter(|&i| measured(&log.channels[i].name)).collect()
        };
        let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
        match self {
            Self::White | Self::Known | Self::OtherRest => {}
            Self::Coloured(rho) => {
                for i in sensors(log) {
                    let values = &mut log.channels[i].values;
                    let std = noise_of(values);
                    let mut state = std * normal(rng);
                    for value in values.iter_mut() {
                        *value += state;
                        state = rho * state + std * (1.0 - rho * rho).sqrt() * normal(rng);
                    }
                }
            }
            Self::Late(device) => {
                let samples = (0.02 / period).round() as usize;
                for channel in log.channels.iter_mut().filter(|c| machine.devices[device].contains(&c.name.as_str())) {
                    let old = channel.values.clone();
                    channel.values = (0..old.len()).map(|k| old[k.saturating_sub(samples)]).collect();
                }
            }
            Self::Gain => {
                let channels = log.channels.iter_mut().filter(|c| machine.gain.contains(&c.name.as_str()));
                channels.for_each(|channel| channel.values.iter_mut().for_each(|value| *value *= 1.02));
            }
            Self::Bias => {
                let channels = log.channels.iter_mut().filter(|c| c.name == machine.bias.0);
                channels.for_each(|channel| channel.values.iter_mut().for_each(|value| *value += machine.bias.1));
            }
            Self::Jitter => {
                log.time.iter_mut().for_each(|time| *time += 0.002 * (rng.random::<f64>() - 0.5) * 2.0);
            }
            Self::Quantised => {
                for i in sensors(log) {
                    let values = &mut log.channels[i].values;
                    let size = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
                    let step = 2.0 * size / 4096.0;
                    if step > 0.0 {
                        values.iter_mut().for_each(|value| *value = (*value / step).round() * step);
                    }
                }
            }
            Self::Dropped => {
                let keep: Vec<bool> = (0..log.len()).map(|_| rng.random::<f64>() > 0.05).collect();
                let part = |values: &[f64]| values.iter().zip(&keep).filter(|(_, k)| **k).map(|(v, _)| *v).collect();
                log.time = part(&log.time);
                log.channels.iter_mut().for_each(|channel| channel.values = part(&channel.values));
            }
            Self::Spikes => {
                for i in sensors(log) {
                    let values = &mut log.channels[i].values;
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
                    values.iter_mut().filter(|_| rng.random::<f64>() < 0.01).for_each(|value| *value += 3.0 * spread);
                }
            }
            Self::First(seconds) => *log = log.slice(0..(seconds / period) as usize, |_| true),
        }
    }
}

/// One log of a cell: per identified parameter its error in standard errors, and whether the fit warns.
struct Outcome {
    errors: Vec<(String, f64)>,
    warns: bool,
}

fn outcome(machine: &Machine, damage: Damage, seed: u64) -> Outcome {
    let vehicle: &Vehicle = vehicles::ALL.into_iter().find(|vehicle| vehicle.name == machine.name).unwrap();
    let simulate = |settings: Vec<(String, f64)>| {
        vehicle.simulate(&Request { scenario: machine.scenario.to_owned(), seed, settings }).unwrap()
    };
    let mut log = simulate(Vec::new());
    let truth = (machine.truth)(&log);
    let mut known: Vec<(String, f64)> = of_channels(&log, machine.known).into_iter().collect();
    if matches!(damage, Damage::Known) {
        match known.iter_mut().find(|(name, _)| name == machine.mass) {
            Some((_, value)) => *value *= 1.05,
            None => {
                let start = vehicle.parameters().iter().find(|v| v.name == machine.mass).unwrap().start;
                known.push((machine.mass.to_owned(), 1.05 * start));
            }
        }
    }
    let mut logs = Vec::new();
    if matches!(damage, Damage::OtherRest) {
        let mut other = log.clone();
        for channel in other.channels.iter_mut().filter(|c| c.name == "tilt" || c.name == "roll") {
            channel.values.iter_mut().for_each(|value| *value += 0.02);
        }
        other.source = "other.csv".to_owned();
        logs.push(other);
    }
    damage.apply(machine, &mut log, &mut ChaCha8Rng::seed_from_u64(1000 + seed));
    logs.insert(0, log);
    // As the command does it: a look at the logs comes first, and what it finds counts as a warning.
    let looks = logs.iter().any(|log| {
        vehicle.check(log, &known).is_ok_and(|found| found.iter().any(|finding| finding.severity >= Severity::Warning))
    });
    let request = FitRequest { settings: known, ..FitRequest::default() };
    let Ok(report) = vehicle.fit(&logs, &request, &Progress::none()) else {
        return Outcome { errors: Vec::new(), warns: true };
    };
    let shifts = |name: &str| name.contains("rest_") && matches!(damage, Damage::OtherRest | Damage::Bias);
    let errors = report.identified().filter(|(name, _)| !shifts(name)).filter_map(|(name, parameter)| {
        Some((name.to_owned(), (parameter.value - truth.get(name)?) / parameter.std_error))
    });
    Outcome { errors: errors.collect(), warns: looks || report.has_warnings() }
}

/// Runs a cell and prints its line; the reasons why it fails the gate.
fn cell(machine: &Machine, damage: Damage, logs: u64) -> Vec<String> {
    let outcomes: Vec<Outcome> = (0..logs).into_par_iter().map(|seed| outcome(machine, damage, seed)).collect();
    let (mut inside, mut count, mut quiet_inside, mut quiet) = (0, 0, 0, 0);
    let mut worst: (f64, String) = (0.0, String::new());
    for outcome in &outcomes {
        for (name, z) in &outcome.errors {
            let holds = z.abs() <= 1.96;
            count += 1;
            inside += usize::from(holds);
            if !outcome.warns {
                quiet += 1;
                quiet_inside += usize::from(holds);
                if z.abs() > worst.0 {
                    worst = (z.abs(), name.clone());
                }
            }
        }
    }
    let share = |part: usize, of: usize| if of > 0 { part as f64 / of as f64 } else { f64::NAN };
    let warned = outcomes.iter().filter(|outcome| outcome.warns).count();
    let what = damage.word(machine);
    println!(
        "{:14} {what:28} identified {count:4}  cov {:.2}  without warning {quiet:4} cov {:.2}  worst {:4.1} {:24} warned {warned}/{logs}",
        machine.name,
        share(inside, count),
        share(quiet_inside, quiet),
        worst.0,
        worst.1
    );
    let mut failures = Vec::new();
    if worst.0 > 4.0 {
        failures.push(format!(
            "{} {what}: {} is {:.1} standard errors off without a warning",
            machine.name, worst.1, worst.0
        ));
    }
    // Errors of one log hang together: a quarter of them counts as independent.
    let allowed = 0.93 - 2.0 * (0.05 * 0.95 * 4.0 / quiet.max(1) as f64).sqrt();
    if quiet > 0 && share(quiet_inside, quiet) < allowed {
        let covered = share(quiet_inside, quiet);
        failures
            .push(format!("{} {what}: {covered:.2} of the intervals hold the truth without a warning", machine.name));
    }
    failures
}

fn table(logs: u64) -> Vec<String> {
    let cells =
        MACHINES.iter().flat_map(|machine| Damage::all(machine).into_iter().map(move |damage| (machine, damage)));
    cells.flat_map(|(machine, damage)| cell(machine, damage, logs)).collect()
}

#[test]
fn a_damaged_log_gives_intervals_that_hold_or_a_warning() {
    let failures = table(2);
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
#[ignore = "the whole table takes minutes"]
fn intervals_hold_the_truth_in_every_cell_or_a_warning_says_why() {
    let failures = table(20);
    assert!(failures.is_empty(), "{failures:#?}");
}
