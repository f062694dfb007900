//! Simulated drives of the nursing robot.
//!
//! The log has the estimator's inputs as a robot would measure them, and `true_*` channels: the truth
//! sample by sample, and constant channels `true_<parameter>` for the parameters that are drawn or that
//! identification can find. In the scenario `identification` the patient has been weighed and measured, so mass and
//! body dimensions are those declared or set; in the others they are drawn too.

mod settings;

use crate::log::{Log, Series};
use crate::simulate::{Knob, Manoeuvres, Request, Scenario, SimulateError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use settings::{Chosen, NoiseSettings, Settings, person};
use std::f64::consts::{PI, TAU};
use wheelstate::estimator::nursing_robot::{Inputs, NursingRobot, Parameters};
use wheelstate::plant::nursing_robot::{Command, NursingRobotPlant, STEP, SpeedLoop};
use wheelstate::{Estimator, Variables};

/// The scenarios.
pub const SCENARIOS: &[Scenario] = &[
    Scenario { name: "smooth-start", about: "0 to 5 km/h in 2 s, then steady" },
    Scenario {
        name: "abrupt-start",
        about: "step of the speed command; rolling and torque scale not quite as assumed",
    },
    Scenario { name: "restless-start", about: "abrupt start with a swaying body and two coughs" },
    Scenario { name: "coughs", about: "smooth start, three coughs while driving" },
    Scenario { name: "new-patient", about: "stop and go; another patient sits down at 16 s" },
    Scenario { name: "load-drop", about: "changing speed; 20 kg are taken off at 20 s while driving" },
    Scenario { name: "release", about: "standing free; the body is released from a lean; smooth start at 3 s" },
    Scenario { name: "lean", about: "driving; the patient takes another posture at 4 s and keeps it" },
    Scenario {
        name: "disturbed",
        about: "changing speed, turning, coughs; the estimator's parameters are all a little wrong",
    },
    Scenario { name: "identification", about: "40 s of excitation by force and slalom, for the fit" },
];

/// What can be driven on purpose: where the patient does nothing of his own.
pub const MANOEUVRES: Manoeuvres = Manoeuvres {
    scenarios: &["smooth-start", "abrupt-start", "identification"],
    knobs: &[
        Knob { name: "plant.duration", scenarios: &[] },
        Knob { name: "plant.effort", scenarios: &["identification"] },
    ],
    commands: &["torque_left", "torque_right", "speed", "yaw_rate"],
    settings: Settings::declare,
    // The patient is the one of the logs.
    plant: |values| {
        let patient = ("plant.draw_patient".to_owned(), 0.0);
        values.iter().cloned().chain([patient]).collect()
    },
    supposed: &[],
    // After a first log that does not turn: fits of drives had up to 3.6 times the standard error of simulated ones.
    unforeseen: &["human.stiffness_roll", "human.damping_roll"],
};

/// 5 km/h.
const CRUISE: f64 = 5.0 / 3.6;

/// A log and what is behind it.
#[derive(Clone, Debug)]
pub struct Run {
    /// What the sensors saw, and the truth.
    pub log: Log,
    /// The machine and patient as they are at the start.
    pub truth: Parameters,
    /// What an estimator would be given: the truth, except where the scenario has it wrong.
    pub assumed: Parameters,
}

/// What one scenario does.
struct Plan {
    duration: f64,
    command: fn(f64) -> Command,
    coughs: &'static [f64],
    /// The estimator's rolling coefficient and torque scale are a little wrong.
    road_errors: bool,
}

fn plan(scenario: &str) -> Option<Plan> {
    let plan = |duration, command| Plan { duration, command, coughs: &[], road_errors: false };
    Some(match scenario {
        "smooth-start" => plan(8.0, |t| straight(ramp(t - 0.5))),
        "abrupt-start" => Plan { road_errors: true, ..plan(8.0, |t| straight(if t < 0.5 { 0.0 } else { CRUISE })) },
        "restless-start" => Plan {
            road_errors: true,
            coughs: &[1.2, 1.9],
            ..plan(8.0, |t| straight(if t < 0.5 { 0.0 } else { CRUISE }))
        },
        "coughs" => Plan { coughs: &[4.0, 4.6, 8.0], ..plan(12.0, |t| straight(ramp(t - 0.5))) },
        "new-patient" => plan(32.0, |t| straight(stop_and_go(t))),
        "load-drop" => plan(40.0, |t| straight(0.9 - 0.4 * (TAU * t / 4.0).cos())),
        "release" => plan(10.0, |t| if t < 3.0 { Command::Torque([0.0; 2]) } else { straight(ramp(t - 3.0)) }),
        "lean" => plan(15.0, |t| straight(ramp(t - 0.5))),
        "disturbed" => Plan {
            road_errors: true,
            coughs: &[4.0, 4.6, 8.0],
            ..plan(16.0, |t| Command::Speed {
                speed: 0.8 - 0.4 * (TAU * t / 6.0).cos(),
                yaw_rate: 0.3 * (0.8 * t).sin(),
                force: 0.0,
            })
        },
        "identification" => plan(40.0, excitation),
        _ => return None,
    })
}

fn straight(speed: f64) -> Command {
    Command::Speed { speed, yaw_rate: 0.0, force: 0.0 }
}

/// From rest to 5 km/h along half a cosine in 2 s.
fn ramp(t: f64) -> f64 {
    0.5 * CRUISE * (1.0 - (PI * (t / 2.0).clamp(0.0, 1.0)).cos())
}

/// 2 s up, 2 s steady, 2 s down, 2 s standing.
fn stop_and_go(t: f64) -> f64 {
    let phase = t % 8.0;
    if phase < 4.0 { ramp(phase) } else { ramp(6.0 - phase) }
}

/// Speed loop of the identification drive: soft below the sway, so that the tones of force reach the
/// wheels at their full size instead of being taken back by the loop.
const SOFT_LOOP: SpeedLoop = SpeedLoop { force_gain: 300.0, moment_gain: 150.0, integral_time: 1.5 };

/// Six tones of force (45 N rms) around a changing speed, and a slalom.
fn excitation(t: f64) -> Command {
    let tones = [0.35, 0.6, 0.85, 1.1, 1.5, 2.0];
    let force = tones.iter().enumerate().map(|(i, f)| 26.0 * (TAU * f * t + 1.7 * (i * i) as f64).sin()).sum();
    let speed = (0.85 + 0.25 * (TAU * 0.15 * t).sin()) * (t / 2.0).min(1.0);
    let yaw_rate = 0.45 * (TAU * 0.35 * t).sin() + 0.35 * (TAU * 0.8 * t).sin();
    Command::Speed { speed, yaw_rate, force }
}

/// The same with so many times the force and yaw rate.
fn harder(command: &Command, effort: f64) -> Command {
    match *command {
        Command::Speed { speed, yaw_rate, force } => {
            Command::Speed { speed, yaw_rate: effort * yaw_rate, force: effort * force }
        }
        Command::Torque(torque) => Command::Torque(torque.map(|each| effort * each)),
    }
}

/// Active hip torque of coughs: half sines of 40 N m over 0.25 s.
fn cough(starts: &[f64], t: f64) -> f64 {
    let since = starts.iter().map(|start| t - start).filter(|since| (0.0..0.25).contains(since));
    since.map(|since| 40.0 * (PI * since / 0.25).sin()).sum()
}

/// Runs a scenario and returns its log only.
pub fn simulate(request: &Request) -> Result<Log, SimulateError> {
    run(request).map(|run| run.log)
}

/// Runs a scenario.
pub fn run(request: &Request) -> Result<Run, SimulateError> {
    let scenario = request.scenario.as_str();
    let plan = plan(scenario).ok_or_else(|| SimulateError::unknown(scenario, SCENARIOS))?;
    let chosen = Chosen::of(request)?;
    let mut rng = ChaCha8Rng::seed_from_u64(request.seed);
    let mut truth = chosen.machine.clone();
    chosen.draw_patient(&mut rng, scenario == "identification", &mut truth)?;
    // Refuses what does not fit together, as a stiffness that lets the body topple.
    NursingRobot::new(&truth)?;
    let successor = chosen.successor(&mut rng, &truth);
    let mut assumed = truth.clone();
    let mut symmetric = |limit: f64| limit * rng.random_range(-1.0..1.0);
    let draws: [f64; 8] = std::array::from_fn(|_| symmetric(1.0));
    let torque_gain = if plan.road_errors { 1.0 + chosen.settings.noise.torque_gain * draws[0] } else { 1.0 };
    if plan.road_errors {
        let wrong = 1.0 + chosen.settings.plant.rolling_error * draws[1];
        chosen.offer_all(&[("rolling.coefficient", truth.rolling.coefficient * wrong)], &mut truth)?;
    }
    match scenario {
        "identification" => chosen.offer_all(
            &[
                ("rolling.coefficient", truth.rolling.coefficient * (1.0 + 0.3 * draws[2])),
                ("robot.drive_efficiency", truth.robot.drive_efficiency * (0.97 + 0.03 * draws[3])),
                ("human.rest_pitch", 0.05 * draws[4]),
                ("human.rest_roll", 0.02 * draws[5]),
            ],
            &mut truth,
        )?,
        "disturbed" => {
            assumed.human.stiffness_pitch = stiff_enough(&assumed, 1.0 + 0.1 * draws[2]);
            assumed.human.damping_pitch *= 1.0 + 0.2 * draws[3];
            assumed.human.nominal_mass *= 1.0 + 0.05 * draws[4];
        }
        _ => {}
    }

    let mut plant = NursingRobotPlant::new(chosen.chassis(&truth), person(&truth));
    match scenario {
        "release" => plant.motion.sway[1] = (0.125 + 0.025 * draws[2]).copysign(draws[3]),
        "restless-start" => plant.motion.sway[1] += 0.15f64.copysign(draws[3]),
        "load-drop" => plant.motion.drive[0] = 0.5,
        "identification" => plant.speed_loop = SOFT_LOOP,
        _ => {}
    }
    let duration = if chosen.settings.plant.duration > 0.0 { chosen.settings.plant.duration } else { plan.duration };
    let period = truth.sample_period;
    let samples = (duration / period).round() as usize + 1;
    let mut recorder = Recorder::new(request, samples, torque_gain);
    let mut now = 0usize;
    for sample in 0..samples {
        let time = sample as f64 * period;
        // The plant's clock counts whole steps, so that any sample period works.
        while (now as f64 + 0.5) * STEP < time {
            let t = now as f64 * STEP;
            events(scenario, t, &successor, &truth, &mut plant);
            let active = cough(plan.coughs, t);
            plant.advance(&harder(&(plan.command)(t), chosen.settings.plant.effort), [0.0, active]);
            now += 1;
        }
        recorder.sample(time, &plant, cough(plan.coughs, time), &chosen.settings.noise, &mut rng);
    }
    Ok(Run { log: recorder.finish(&truth), truth, assumed })
}

/// A wrong stiffness that still holds the body upright.
fn stiff_enough(p: &Parameters, factor: f64) -> f64 {
    let toppling = p.human.toppling_stiffness(p.human.nominal_mass);
    (p.human.stiffness_pitch * factor).max(1.1 * toppling)
}

/// What changes while driving.
fn events(scenario: &str, t: f64, successor: &Parameters, truth: &Parameters, plant: &mut NursingRobotPlant) {
    match scenario {
        "new-patient" if t >= 16.0 => plant.person = person(successor),
        "load-drop" if t >= 20.0 => plant.person.mass = truth.human.nominal_mass - 20.0,
        "lean" => plant.person.rest[1] = truth.human.rest_pitch + 0.1 * (t - 4.0).clamp(0.0, 1.0),
        _ => {}
    }
}

/// Channels beside the inputs, in the order in which [`Recorder::sample`] writes them.
const TRUTH: [&str; 12] = [
    "true_load_mass",
    "true_speed",
    "true_yaw_rate",
    "true_body_pitch",
    "true_body_pitch_rate",
    "true_body_roll",
    "true_body_roll_rate",
    "true_sway_force",
    "true_hip_torque",
    "true_active_torque",
    "true_acceleration",
    "true_rolling_resistance",
];

/// Parameters that are drawn or can be identified; their truth goes into the log as constant channels.
const CONSTANTS: [&str; 10] = [
    "human.com_height",
    "human.gyration_radius",
    "human.stiffness_pitch",
    "human.damping_pitch",
    "human.rest_pitch",
    "human.stiffness_roll",
    "human.damping_roll",
    "human.rest_roll",
    "rolling.coefficient",
    "robot.drive_efficiency",
];

/// Collects the channels of a log.
struct Recorder {
    log: Log,
    time: Vec<f64>,
    rows: Vec<Vec<f64>>,
    torque_gain: f64,
}

impl Recorder {
    fn new(request: &Request, samples: usize, torque_gain: f64) -> Self {
        let source = format!("nursing-robot {} seed {}", request.scenario, request.seed);
        let log = Log { source, ..Log::default() };
        let (time, rows) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
        Self { log, time, rows, torque_gain }
    }

    fn sample(
        &mut self,
        time: f64,
        plant: &NursingRobotPlant,
        active: f64,
        noise: &NoiseSettings,
        rng: &mut ChaCha8Rng,
    ) {
        let mut disturb = |std: f64| {
            let draw: f64 = StandardNormal.sample(rng);
            std * draw
        };
        let motion = &plant.motion;
        let forces = plant.forces([0.0, active]);
        let speed = motion.drive[0] + disturb(noise.speed);
        let step = noise.speed_step;
        let inputs = Inputs {
            torque_left: self.torque_gain * plant.torque[0] + disturb(noise.torque),
            torque_right: self.torque_gain * plant.torque[1] + disturb(noise.torque),
            speed: if step > 0.0 { (speed / step).round() * step } else { speed },
            yaw_rate: motion.drive[1] + disturb(noise.yaw_rate),
            tilt: motion.sway[1] + noise.tilt_bias + disturb(noise.tilt),
            tilt_rate: motion.sway_rate[1] + noise.tilt_rate_bias + disturb(noise.tilt_rate),
            roll: motion.sway[0] + disturb(noise.tilt),
            roll_rate: motion.sway_rate[0] + disturb(noise.tilt_rate),
            accel_x: forces.acceleration + disturb(noise.accel),
        };
        let mut row = inputs.to_vec();
        row.extend([
            plant.person.mass,
            motion.drive[0],
            motion.drive[1],
            motion.sway[1],
            motion.sway_rate[1],
            motion.sway[0],
            motion.sway_rate[0],
            forces.sway_force,
            forces.hip_torque[1],
            active,
            forces.acceleration,
            plant.rolling_resistance(motion.drive[0]),
        ]);
        self.time.push(time);
        self.rows.push(row);
    }

    fn finish(mut self, truth: &Parameters) -> Log {
        self.log.time = self.time.into();
        let inputs = Inputs::declare().into_iter().map(|input| input.name);
        let names: Vec<String> = inputs.chain(TRUTH.map(str::to_owned)).collect();
        for (i, name) in names.iter().enumerate() {
            self.log.push(name, self.rows.iter().map(|row| row[i]).collect::<Series>());
        }
        let values = truth.to_vec();
        for (variable, value) in Parameters::declare().iter().zip(values) {
            if CONSTANTS.contains(&variable.name.as_str()) {
                self.log.push(&format!("true_{}", variable.name), vec![value; self.log.len()]);
            }
        }
        self.log
    }
}
