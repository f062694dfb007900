//! A simulated robot with its sensors, and the estimator run over them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::wheeled_robot::{Channels, Inputs, Outputs, Parameters, WheeledRobot};
use wheelstate::plant::wheeled_robot::{Controls, Machine, State, TireLaw, Truth};
use wheelstate::{Estimator, Variables};

/// Sample period, s.
pub const DT: f64 = 0.01;

pub fn machine() -> Machine {
    let tire = TireLaw {
        stiffness: 1318.464,
        nominal: 147.15,
        sensitivity: 2.0,
        shape: 1.4,
        friction: 0.8,
        friction_slope: -0.1,
        curvature: -0.2,
    };
    Machine {
        mass: 60.0,
        yaw_inertia: 7.5,
        arms: [0.38, 0.42],
        tracks: [0.60, 0.62],
        height: 0.25,
        radius: 0.15,
        wheel_inertia: 0.06,
        tires: [tire.clone(), tire],
        ground: [1.0; 4],
        slip_law: [1.6, 12.0],
        rolling: 0.0,
        combined: false,
        guard: 0.5,
        brake_fade: 0.5,
    }
}

/// Sensors of a robot that snakes at 3 m/s (or stands), with the true motion.
pub fn drive(seed: u64, seconds: f64, speed: f64, swing: f64) -> Vec<(Inputs, [f64; 3])> {
    drive_of(&machine(), seed, seconds, speed, swing)
}

/// The same of another robot.
pub fn drive_of(machine: &Machine, seed: u64, seconds: f64, speed: f64, swing: f64) -> Vec<(Inputs, [f64; 3])> {
    drive_with(machine, seed, seconds, speed, swing, |_, now| 0.1 * (speed - now).clamp(-5.0, 5.0) * 9.0)
}

/// The same with the torque on each wheel, N m, from time and speed: a negative one brakes.
pub fn drive_with(
    machine: &Machine,
    seed: u64,
    seconds: f64,
    speed: f64,
    swing: f64,
    torque: impl Fn(f64, f64) -> f64,
) -> Vec<(Inputs, [f64; 3])> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| std * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
    let mut x = machine.rolling_at(speed);
    (0..(seconds / DT) as usize)
        .map(|k| {
            let steer = swing * (2.5 * k as f64 * DT).sin();
            let torque = torque(k as f64 * DT, x[0]);
            let controls = Controls { steering: steer, drive: [torque; 4], brake: [0.0; 4] };
            let truth = machine.truth(&x, &controls);
            let sample = sensed(&x, &truth, &controls, &mut noise);
            let motion = [x[0], x[1], x[2]];
            x = machine.advance(&x, DT, |_| controls);
            (sample, motion)
        })
        .collect()
}

/// What the sensors of a robot show, `noise` being drawn with a standard deviation.
pub fn sensed(x: &State, truth: &Truth, controls: &Controls, noise: &mut impl FnMut(f64) -> f64) -> Inputs {
    let Controls { steering, drive, brake } = *controls;
    Inputs {
        steering_angle: steering + noise(0.003),
        drive_torque_fl: drive[0] + noise(0.05),
        drive_torque_fr: drive[1] + noise(0.05),
        drive_torque_rl: drive[2] + noise(0.05),
        drive_torque_rr: drive[3] + noise(0.05),
        brake_torque_fl: brake[0],
        brake_torque_fr: brake[1],
        brake_torque_rl: brake[2],
        brake_torque_rr: brake[3],
        wheel_speed_fl: x[3] + noise(0.03),
        wheel_speed_fr: x[4] + noise(0.03),
        wheel_speed_rl: x[5] + noise(0.03),
        wheel_speed_rr: x[6] + noise(0.03),
        accel_x: truth.accel[0] + noise(0.1),
        accel_y: truth.accel[1] + noise(0.1),
        gyro_z: x[2] + noise(0.01),
        speed: f64::NAN,
    }
}

pub fn parameters(channels: Channels) -> Parameters {
    let mut p = Parameters::default();
    p.filter.channels = channels;
    p.initial.speed_x = 3.0;
    p
}

pub fn run(p: &Parameters, log: &[(Inputs, [f64; 3])], spoil: impl Fn(usize, &mut Inputs)) -> Vec<Outputs> {
    let mut estimator = WheeledRobot::new(p).unwrap();
    log.iter()
        .enumerate()
        .map(|(k, (inputs, _))| {
            let mut inputs = inputs.clone();
            spoil(k, &mut inputs);
            estimator.step(&inputs, DT);
            let mut outputs = Outputs::default();
            estimator.outputs(&inputs, 0.0, &mut outputs);
            assert!(outputs.to_vec().iter().all(|v| v.is_finite()), "sample {k}: {outputs:?}");
            outputs
        })
        .collect()
}
