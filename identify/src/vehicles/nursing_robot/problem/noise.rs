//! What sensor noise alone makes of a row: its covariance tells how far noise in the regressors
//! pulls the estimates, and whether the signals rise above it at all.

use super::Windowed;
use super::rows::{Body, Drive, GRAVITY};
use crate::problem::noise::{add_noise as add, noise_of as noise};

/// Weights of one sensor in every entry of `[row, right-hand side]`.
type Weights = Vec<Vec<f64>>;

/// Mean over the logs, weighted with their lengths.
fn mean(logs: &[Windowed], size: usize, of: impl Fn(&Windowed) -> Option<Vec<f64>>) -> Vec<f64> {
    let mut sum = vec![0.0; size * size];
    let mut samples = 0.0;
    for (log, covariance) in logs.iter().filter_map(|log| Some((log, of(log)?))) {
        let weight = log.signals.len() as f64;
        samples += weight;
        sum.iter_mut().zip(&covariance).for_each(|(sum, value)| *sum += weight * value);
    }
    if samples > 0.0 { sum.iter().map(|value| value / samples).collect() } else { Vec::new() }
}

fn scaled(weights: &[f64], factor: f64) -> Vec<f64> {
    weights.iter().map(|weight| factor * weight).collect()
}

fn sum(a: Vec<f64>, b: Vec<f64>) -> Vec<f64> {
    a.into_iter().zip(b).map(|(a, b)| a + b).collect()
}

/// `[k, c, k phi_0]` rows: `[psi, -psi', 0 | -(J psi'' - b g psi)]` on the angle, `b psi'` on the speed.
fn joint(log: &Windowed, body: &Body, angle: &[f64], coupling: f64) -> Option<Vec<f64>> {
    if angle.is_empty() {
        return None;
    }
    let [psi, psi1, psi2, _] = &log.sway.weights;
    let zero = scaled(psi, 0.0);
    let rhs = sum(scaled(psi2, -body.j), scaled(psi, body.b * GRAVITY));
    let mut covariance = vec![0.0; 16];
    add(&mut covariance, &[psi.clone(), scaled(psi1, -1.0), zero.clone(), rhs], noise(angle));
    let on_speed = vec![zero.clone(), zero.clone(), zero, scaled(psi1, coupling)];
    add(&mut covariance, &on_speed, noise(&log.signals.speed));
    Some(covariance)
}

pub(super) fn pitch(logs: &[Windowed], body: &Body) -> Vec<f64> {
    mean(logs, 4, |log| joint(log, body, &log.signals.pitch, body.b))
}

pub(super) fn roll(logs: &[Windowed], body: &Body) -> Vec<f64> {
    mean(logs, 4, |log| joint(log, body, &log.signals.roll, 0.0))
}

pub(super) fn drive(logs: &[Windowed], body: &Body, unknowns: Drive, accelerometer: bool) -> Vec<f64> {
    mean(logs, unknowns.unknowns() + 1, |log| {
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
        let n = unknowns.unknowns() + 1;
        let mut covariance = vec![0.0; n * n];
        let (on_speed, on_force, on_accel): (Weights, Weights, Weights) = match unknowns {
            Drive::Rolling | Drive::RollingEfficiency => {
                let balance = sum(scaled(&rate, -body.rotating_mass), scaled(&of_mass(body.total_mass()), -1.0));
                let accel = scaled(psi, -body.total_mass());
                let rolling = scaled(&rolling, body.total_mass());
                if unknowns == Drive::Rolling {
                    (
                        vec![rolling, balance],
                        vec![zero.clone(), scaled(psi, body.efficiency)],
                        vec![zero.clone(), accel],
                    )
                } else {
                    (
                        vec![rolling, zero.clone(), balance],
                        vec![zero.clone(), scaled(psi, -1.0), zero.clone()],
                        vec![zero.clone(), zero.clone(), accel],
                    )
                }
            }
            Drive::RollingLoad | Drive::RollingRobot => {
                let known = if unknowns == Drive::RollingLoad { body.robot_mass } else { body.human_mass };
                let balance = sum(scaled(&rate, -body.rotating_mass), scaled(&of_mass(known), -1.0));
                (
                    vec![rolling, of_mass(1.0), balance],
                    vec![zero.clone(), zero.clone(), scaled(psi, body.efficiency)],
                    vec![zero.clone(), psi.clone(), scaled(psi, -known)],
                )
            }
        };
        add(&mut covariance, &on_speed, noise(&signals.speed));
        add(&mut covariance, &on_force, noise(&signals.force));
        if accelerometer {
            add(&mut covariance, &on_accel, noise(&signals.accel));
        }
        Some(covariance)
    })
}
