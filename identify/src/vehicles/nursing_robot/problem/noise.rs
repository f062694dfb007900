//! What sensor noise alone makes of a row: its covariance says how far noise in the regressors
//! pulls the estimates, and whether the signals rise above it at all.

use super::rows::{Body, Drive, GRAVITY};
use super::sources::Windowed;
use crate::problem::noise::{Part, noise_of as noise, tell_noise};
use crate::solve::Rows;

/// Weights of one sensor in every entry of `[row, right-hand side]`.
type Weights = Vec<Vec<f64>>;

/// What the sensors of every log, or of every block of it, make of the rows.
#[derive(Default)]
pub(super) struct Sensors {
    logs: Vec<(Vec<Part>, f64, f64)>,
}

impl Sensors {
    /// Adds those of a log, if there are any.
    pub fn add(&mut self, log: &Windowed, parts: Vec<Part>) {
        if !parts.is_empty() {
            self.logs.push((parts, log.signals.period, log.signals.len() as f64));
        }
    }

    /// Sets the rows' noise.
    pub fn tell(&self, rows: &mut Rows) {
        tell_noise(rows, &self.logs);
    }
}

fn scaled(weights: &[f64], factor: f64) -> Vec<f64> {
    weights.iter().map(|weight| factor * weight).collect()
}

fn sum(a: Vec<f64>, b: Vec<f64>) -> Vec<f64> {
    a.into_iter().zip(b).map(|(a, b)| a + b).collect()
}

/// `[k, c, k phi_0]` rows: `[psi, -psi', 0 | -(J psi'' - b g psi)]` on the angle, `b psi'` on the speed.
fn joint(log: &Windowed, body: &Body, channel: &'static str, angle: &[f64], coupling: f64) -> Vec<Part> {
    if angle.is_empty() {
        return Vec::new();
    }
    let [psi, psi1, psi2, _] = &log.sway.weights;
    let zero = scaled(psi, 0.0);
    let rhs = sum(scaled(psi2, -body.j), scaled(psi, body.b * GRAVITY));
    let on_angle = vec![psi.clone(), scaled(psi1, -1.0), zero.clone(), rhs];
    let on_speed = vec![zero.clone(), zero.clone(), zero, scaled(psi1, coupling)];
    vec![(channel, on_angle, noise(angle)), ("speed", on_speed, log.speed_noise())]
}

pub(super) fn pitch(log: &Windowed, body: &Body) -> Vec<Part> {
    joint(log, body, "tilt", &log.signals.pitch, body.b)
}

pub(super) fn roll(log: &Windowed, body: &Body) -> Vec<Part> {
    joint(log, body, "roll", &log.signals.roll, 0.0)
}

pub(super) fn drive(log: &Windowed, body: &Body, unknowns: Drive, accelerometer: bool) -> Vec<Part> {
    let signals = &log.signals;
    let [psi, psi1, _, _] = &log.sway.weights;
    let zero = scaled(psi, 0.0);
    // Mean square slope of tanh(v / v_s): only near standstill does noise change its sign.
    let slopes = signals.speed.iter().filter(|v| v.is_finite()).map(|v| {
        let cosh = (v / body.smoothing_speed).abs().min(300.0).cosh();
        (cosh.powi(-2) / body.smoothing_speed).powi(2)
    });
    let count = signals.speed.iter().filter(|v| v.is_finite()).count().max(1);
    let slope = (slopes.sum::<f64>() / count as f64).sqrt();
    let rolling = scaled(psi, GRAVITY * slope);
    let rate = scaled(psi1, -1.0);
    let of_mass = |mass: f64| if accelerometer { zero.clone() } else { scaled(&rate, mass) };
    let (on_speed, on_force, on_accel): (Weights, Weights, Weights) = match unknowns {
        Drive::Rolling | Drive::RollingEfficiency => {
            let balance = sum(scaled(&rate, -body.rotating_mass), scaled(&of_mass(body.total_mass()), -1.0));
            let accel = scaled(psi, -body.total_mass());
            let rolling = scaled(&rolling, body.total_mass());
            if unknowns == Drive::Rolling {
                (vec![rolling, balance], vec![zero.clone(), scaled(psi, body.efficiency)], vec![zero.clone(), accel])
            } else {
                (
                    vec![rolling, zero.clone(), balance],
                    vec![zero.clone(), scaled(psi, -1.0), zero.clone()],
                    vec![zero.clone(), zero.clone(), accel],
                )
            }
        }
        Drive::RollingLoad | Drive::RollingRobot | Drive::RollingRobotDrag => {
            let known = if unknowns == Drive::RollingLoad { body.robot_mass } else { body.human_mass };
            let balance = sum(scaled(&rate, -body.rotating_mass), scaled(&of_mass(known), -1.0));
            let mut on_speed = vec![rolling, of_mass(1.0), balance];
            let mut on_force = vec![zero.clone(), zero.clone(), scaled(psi, body.efficiency)];
            let mut on_accel = vec![zero.clone(), psi.clone(), scaled(psi, -known)];
            if unknowns == Drive::RollingRobotDrag {
                // d(v |v|) = 2 |v| dv
                let moving = signals.speed.iter().filter(|v| v.is_finite());
                let size = (moving.map(|v| v * v).sum::<f64>() / count as f64).sqrt();
                on_speed.insert(2, scaled(psi, body.air_density * size));
                on_force.insert(2, zero.clone());
                on_accel.insert(2, zero.clone());
            }
            (on_speed, on_force, on_accel)
        }
    };
    let mut parts = vec![("speed", on_speed, log.speed_noise()), ("torque", on_force, noise(&signals.force))];
    if accelerometer {
        parts.push(("accel_x", on_accel, noise(&signals.accel)));
    }
    parts
}
