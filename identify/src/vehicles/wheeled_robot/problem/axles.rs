//! Logs to lateral axle forces, slip angles and wheel loads.
//!
//! All signals pass the same symmetric window, the steering angle too: an angle sharper than the forces
//! biases the tyre's curve. From yaw and lateral balance
//!
//! ```text
//! (m ay lr + Iz r' - Mx)/L - (Fx_FL + Fx_FR) s = c (Fy_FL + Fy_FR) + tf/2 s (Fy_FL - Fy_FR)/L
//! (m ay lf - Iz r' + Mx)/L                     = Fy_RL + Fy_RR      - tf/2 s (Fy_FL - Fy_FR)/L
//! Mx = tf/2 (Fx_FR - Fx_FL) c + tr/2 (Fx_RR - Fx_RL),  c, s = cos, sin of the steering angle
//! ```
//!
//! The unequal forces of the steered wheels turn the vehicle too, most where parallel wheels scrub in a
//! tight bend.
//!
//! The accelerations are compared with what the speeds say of them, in the mean over the log:
//!
//! ```text
//! ax - (vx' - r vy) = bias + g sin(slope along),   ay - (vy' + r vx) = bias + g sin(slope across)
//! ```
//!
//! The balances hold on any slope, since an accelerometer and the wheels feel it alike, but not with a bias; the two cannot
//! be distinguished.
//!
//! Longitudinal wheel forces come from `wheel_force_x_*` channels where a log has them, else from torques
//! and wheel speeds through the sliding-mode observer, else from the longitudinal acceleration.

use crate::log::{Log, LogError};
use crate::problem::Offset;
use wheelstate::estimator::wheeled_robot::Parameters;
use wheelstate::filter::sliding_mode::SlidingMode;
use wheelstate::model::wheeled_robot::{Drive, GRAVITY, WheeledRobot, wheel_torque};

/// Half length of the smoothing window, s.
const HALF_WINDOW: f64 = 0.1;
/// Below this speed slip angles are mostly noise, m/s.
const LEAST_SPEED: f64 = 1.0;
/// Above this sine of the steering angle the front tyres' drag hides the rolling resistance.
const STRAIGHT: f64 = 0.1;
const WHEELS: [&str; 4] = ["fl", "fr", "rl", "rr"];

/// One instant of a log as the tyre fit needs it.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// Time, s.
    pub time: f64,
    /// Longitudinal speed, m/s.
    pub speed: f64,
    /// Slip angles, rad.
    pub slip: [f64; 4],
    /// Wheel loads, N.
    pub load: [f64; 4],
    /// Lateral force of the front and of the rear axle across the vehicle, N: what the lateral forces of
    /// the tyres have to explain, see [`Instant::explained`].
    pub axle_force: [f64; 2],
    /// Cosine of the steering angle.
    pub across: f64,
    /// `tf/2 sin(delta) / L`.
    pub leak: f64,
    /// Longitudinal forces, N.
    pub longitudinal: [f64; 4],
    /// Cluster of correlated instants.
    pub cluster: u32,
}

impl Instant {
    /// What lateral tyre forces make of the axle forces, N.
    pub fn explained(&self, lateral: &[f64; 4]) -> [f64; 2] {
        let turning = self.leak * (lateral[0] - lateral[1]);
        [self.across * (lateral[0] + lateral[1]) + turning, lateral[2] + lateral[3] - turning]
    }
}

/// One instant of the longitudinal balance: measured inertia force and torque force.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// Weight times the direction of travel, N.
    pub weight: f64,
    /// Force of the torques that is not seen in the acceleration, N.
    pub missing: f64,
    /// Cluster of correlated instants.
    pub cluster: u32,
}

/// What a log gives.
#[derive(Clone, Debug, Default)]
pub struct Axles {
    /// For the tyres.
    pub instants: Vec<Instant>,
    /// Standard deviation of the smoothed lateral speed's noise, m/s.
    pub lateral_noise: f64,
    /// For the rolling resistance; empty without torques.
    pub balance: Vec<Balance>,
    /// Where the longitudinal forces come from.
    pub forces_from: &'static str,
    /// The measured accelerations compared with the speeds.
    pub beyond: Vec<Offset>,
}

/// Reads a log. Needs `steering_angle`, `accel_y`, `gyro_z`, `speed_y`, and `speed_x` or `speed`.
pub fn axles(log: &Log, p: &Parameters) -> Result<Axles, LogError> {
    let period = log.period();
    let half = ((HALF_WINDOW / period).round() as usize).max(2);
    let smooth = |values: &[f64]| smooth(values, half);
    let steering = smooth(log.require("steering_angle")?);
    let gyro = smooth(log.require("gyro_z")?);
    let raw = log.require("speed_y")?;
    let lateral_speed = smooth(raw);
    let speed = smooth(match log.channel("speed_x") {
        Some(speed) => speed,
        None => log.require("speed")?,
    });
    let accel_y = smooth(log.require("accel_y")?);
    let accel_x = log.channel("accel_x").map_or_else(|| derivative(&speed, &log.time), smooth);
    let turn = derivative(&gyro, &log.time);
    let (speed_rate, lateral_rate) = (derivative(&speed, &log.time), derivative(&lateral_speed, &log.time));
    let mut beyond = [Vec::new(), Vec::new()];
    let model = WheeledRobot::new(&p.vehicle, &p.tire, p.filter.minimum_speed);
    let (forces, forces_from) = forces(log, p, &model, &accel_x);
    let forces = forces.map(|force| smooth(&force));
    let torque_force = torque_force(log, p, period).map(|force| smooth(&force));

    let (v, base) = (&p.vehicle, p.vehicle.wheelbase());
    let lateral_noise = remaining_noise(raw, &lateral_speed, half);
    let mut axles = Axles { forces_from, lateral_noise, ..Axles::default() };
    // Neighbours within the window are correlated; clusters of a second are independent enough.
    for k in (half..log.len().saturating_sub(half)).step_by(half) {
        let (delta, r, r_dot) = (steering[k], gyro[k], turn[k]);
        let ax = accel_x[k] + r * r * p.imu.x + r_dot * p.imu.y;
        let ay = accel_y[k] + r * r * p.imu.y - r_dot * p.imu.x;
        let fx: [f64; 4] = std::array::from_fn(|i| forces[i][k]);
        let (s, c) = delta.sin_cos();
        let twist = 0.5 * v.track_front * (fx[1] - fx[0]) * c + 0.5 * v.track_rear * (fx[3] - fx[2]);
        let front = (v.mass * ay * v.cg_to_rear + v.yaw_inertia * r_dot - twist) / base;
        let rear = (v.mass * ay * v.cg_to_front - v.yaw_inertia * r_dot + twist) / base;
        let axle_force = [front - (fx[0] + fx[1]) * s, rear];
        let (across, leak) = (c, 0.5 * v.track_front * s / base);
        let x = [speed[k], lateral_speed[k], r];
        let cluster = (log.time[k] - log.time[0]).max(0.0) as u32;
        let finite = x.iter().chain(&axle_force).chain([&delta, &ax]).all(|x| x.is_finite());
        if !finite || speed[k].abs() < LEAST_SPEED.max(p.filter.minimum_speed) {
            continue;
        }
        beyond[0].push((cluster, ax - (speed_rate[k] - r * lateral_speed[k])));
        beyond[1].push((cluster, ay - (lateral_rate[k] + r * speed[k])));
        let slip = model.driven(&Drive::new(delta, fx)).slip_angles(&x);
        let load = model.loads(ax, ay);
        let instant = Instant {
            time: log.time[k],
            speed: speed[k],
            slip,
            load,
            axle_force,
            across,
            leak,
            longitudinal: fx,
            cluster,
        };
        axles.instants.push(instant);
        if let Some(torque_force) = &torque_force
            && torque_force[k].is_finite()
            && s.abs() < STRAIGHT
        {
            let direction = (speed[k] / p.wheel.radius / 0.1).tanh();
            let seen = v.mass * ax + axle_force[0] * s / c + (fx[0] + fx[1]) * (1.0 - c);
            let weight = v.mass * GRAVITY * direction;
            axles.balance.push(Balance { weight, missing: torque_force[k] - seen, cluster });
        }
    }
    let against = ["the change of the speed says", "the turn and the change of speed_y say"];
    for (index, channel) in ["accel_x", "accel_y"].into_iter().enumerate().filter(|(_, c)| log.channel(c).is_some()) {
        axles.beyond.extend(Offset::of_clusters(&beyond[index], channel, "m/s2", against[index]));
    }
    Ok(axles)
}

/// A channel that a log may lack.
type Recorded<'a> = Option<&'a [f64]>;

/// Drive and brake torque of a wheel, if the log has either.
fn torque(log: &Log, wheel: usize) -> Option<(Recorded<'_>, Recorded<'_>)> {
    let drive = log.channel(&format!("drive_torque_{}", WHEELS[wheel]));
    let brake = log.channel(&format!("brake_torque_{}", WHEELS[wheel]));
    (drive.is_some() || brake.is_some()).then_some((drive, brake))
}

/// Longitudinal wheel forces and where they come from.
fn forces(log: &Log, p: &Parameters, model: &WheeledRobot, accel_x: &[f64]) -> ([Vec<f64>; 4], &'static str) {
    let measured = WHEELS.map(|wheel| log.channel(&format!("wheel_force_x_{wheel}")));
    if let [Some(a), Some(b), Some(c), Some(d)] = measured {
        return ([a, b, c, d].map(<[f64]>::to_vec), "measured wheel forces");
    }
    if (0..4).any(|wheel| torque(log, wheel).is_some()) {
        let speeds = WHEELS.map(|wheel| log.channel(&format!("wheel_speed_{wheel}")));
        let observed = std::array::from_fn(|wheel| observe(log, p, wheel, speeds[wheel]));
        return (observed, "torques and wheel speeds through the observer");
    }
    // shared in proportion to the static loads
    let load = model.loads(0.0, 0.0);
    let share = |i: usize| accel_x.iter().map(|ax| ax * load[i] / GRAVITY).collect();
    (std::array::from_fn(share), "the longitudinal acceleration, shared by load")
}

fn observe(log: &Log, p: &Parameters, wheel: usize, speeds: Option<&[f64]>) -> Vec<f64> {
    let period = log.period();
    let o = &p.observer;
    // a slowly sampled log cannot bear the gain of a fast one
    let kappa = o.gain + o.amplitude * o.steepness;
    let shrink = (0.5 / (kappa * period)).min(1.0);
    let observer = SlidingMode {
        gain: o.gain * shrink,
        amplitude: o.amplitude * shrink,
        steepness: o.steepness,
        nominal_rate: o.nominal_rate * shrink,
        force_limit: o.force_limit,
        feedforward: o.feedforward,
        adaptation: None,
    };
    let (drive, brake) = torque(log, wheel).unwrap_or((None, None));
    let mut state = observer.start();
    let mut last = 0.0;
    (0..log.len())
        .map(|k| {
            let speed = speeds.map_or(f64::NAN, |s| s[k]);
            let turning = if speed.is_finite() { speed } else { state.speed };
            let at = |values: Option<&[f64]>| values.map_or(0.0, |values| values[k]);
            let torque = wheel_torque(at(drive), at(brake), turning, o.stop_speed, 0.0);
            last = if torque.is_finite() { torque } else { last };
            if speeds.is_none() {
                p.wheel.steady_force(last)
            } else {
                observer.step(&p.wheel, &mut state, speed, last, period)
            }
        })
        .collect()
}

/// Sum of the wheels' `(T - J w')/R`, N, by central differences; nothing without torques.
fn torque_force(log: &Log, p: &Parameters, period: f64) -> Option<Vec<f64>> {
    let mut sum = vec![0.0; log.len()];
    let half = ((HALF_WINDOW / period).round() as usize).max(2);
    let mut any = false;
    for (wheel, name) in WHEELS.iter().enumerate() {
        let Some((drive, brake)) = torque(log, wheel) else { continue };
        let speed = smooth(log.channel(&format!("wheel_speed_{name}"))?, half);
        let change = derivative(&speed, &log.time);
        any = true;
        for k in 0..log.len() {
            let at = |values: Option<&[f64]>| values.map_or(0.0, |values| values[k]);
            let torque = wheel_torque(at(drive), at(brake), speed[k], p.observer.stop_speed, 0.0);
            sum[k] += p.wheel.steady_force(torque - p.wheel.inertia * change[k]);
        }
    }
    any.then_some(sum)
}

/// What is left of a signal's white noise after smoothing: the noise is what the smoothing took away.
fn remaining_noise(raw: &[f64], smoothed: &[f64], half: usize) -> f64 {
    let taken: Vec<f64> = raw.iter().zip(smoothed).map(|(a, b)| (a - b).powi(2)).filter(|s| s.is_finite()).collect();
    if taken.is_empty() {
        return 0.0;
    }
    // sum of squares over square of the sum of the window's weights
    let share = 0.75 / (half + 1) as f64;
    (taken.iter().sum::<f64>() / taken.len() as f64 * share).sqrt()
}

/// Symmetric cosine window of `2 half + 1` samples; NaN spreads over it, at the ends it is cut.
fn smooth(values: &[f64], half: usize) -> Vec<f64> {
    let weight: Vec<f64> =
        (0..=half).map(|i| 0.5 + 0.5 * (std::f64::consts::PI * i as f64 / (half + 1) as f64).cos()).collect();
    let mean = |k: usize| {
        let reach = half.min(k).min(values.len() - 1 - k);
        let (mut sum, mut total) = (values[k] * weight[0], weight[0]);
        for i in 1..=reach {
            sum += weight[i] * (values[k - i] + values[k + i]);
            total += 2.0 * weight[i];
        }
        sum / total
    };
    (0..values.len()).map(mean).collect()
}

/// Central differences between the log's own times, which a Savitzky-Golay fit would take as even.
fn derivative(values: &[f64], time: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    (0..values.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            (values[b] - values[a]) / (time[b] - time[a])
        })
        .collect()
}
