//! Time of whole estimation steps.

use super::config::{Setup, Source};
use serde::Serialize;
use std::time::Instant;
use wheelstate::estimator::human_dynamics::whole_body::{Posture, StepError};

/// Medians over the steps of one run on one thread.
#[derive(Clone, Debug, Serialize)]
pub struct Timing {
    /// Name of the model.
    pub model: String,
    /// Unknowns of a step.
    pub variables: usize,
    /// Rows of measurements.
    pub measurements: usize,
    /// Steps of each kind.
    pub steps: usize,
    /// Kinematics, assembly, factorisation and corrections, microseconds per step.
    pub mean_only_us: f64,
    /// The same with the variances of all unknowns, microseconds per step.
    pub with_variances_us: f64,
    /// Nonzeros of the factor.
    pub factor_nonzeros: usize,
    /// Floating-point operations of one factorisation.
    pub factor_flops: usize,
}

/// Takes `steps` steps without and as many with variances, each in another posture.
pub fn run(setup: &mut Setup, steps: usize) -> Result<Timing, StepError> {
    let mean_only_us = median_step(setup, steps, false)?;
    let with_variances_us = median_step(setup, steps, true)?;
    let body = &setup.body;
    Ok(Timing {
        model: body.equations().tree().name.clone(),
        variables: body.equations().variables(),
        measurements: body.measurements(),
        steps,
        mean_only_us,
        with_variances_us,
        factor_nonzeros: body.map().ldl().nonzeros(),
        factor_flops: body.map().ldl().factor_flops(),
    })
}

fn median_step(setup: &mut Setup, steps: usize, variances: bool) -> Result<f64, StepError> {
    let dof = setup.body.equations().tree().dof();
    let (mut q, mut qd) = (vec![0.0; dof], vec![0.0; dof]);
    let mut samples = vec![];
    for (sensor, source) in setup.body.equations().sensors().iter().zip(&setup.sources) {
        let value = if let Source::Value(value) = source { *value } else { 0.5 };
        samples.extend((0..sensor.quantity.rows()).map(|_| value));
    }
    let mut times = Vec::with_capacity(steps);
    for step in 0..steps.max(1) {
        // every step in another posture, so that nothing can be remembered from the last one
        for (i, (q, qd)) in q.iter_mut().zip(&mut qd).enumerate() {
            let phase = 0.37 * i as f64 + 0.11 * step as f64;
            (*q, *qd) = (0.4 * phase.sin(), 0.7 * phase.cos());
        }
        let base_rate = [0.1, (0.05 * step as f64).sin(), -0.2];
        let posture = Posture { q: &q, qd: &qd, base_rate };
        let start = Instant::now();
        setup.body.step(&posture, &samples, variances)?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
