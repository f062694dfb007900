//! The best estimate of a ride that is over: fixed-interval smoothing of what the filter has estimated.
//!
//! With filtered mean and covariance `x[k|k]`, `P[k|k]`, predicted ones `x[k+1|k]`, `P[k+1|k]` and the covariance
//! `C[k+1]` of the state at `k` with that predicted for `k+1`, from the last sample back to the first:
//!
//! ```text
//! G[k]   = C[k+1] P[k+1|k]^-1
//! x[k|n] = x[k|k] + G[k] (x[k+1|n] - x[k+1|k])
//! P[k|n] = P[k|k] + G[k] (P[k+1|n] - P[k+1|k]) G[k]^T
//! ```
//!
//! Rauch, Tung and Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA Journal 3 (1965), with
//! `C = P F^T`; Särkkä, *Unscented Rauch-Tung-Striebel smoother*, IEEE Transactions on Automatic Control 53 (2008), with
//! `C` from the sigma points of the time update.
//!
//! The recursion is true where a sample conditions the predicted states and does nothing else. Where the filter makes a
//! new start, holds or takes back what it learnt, or where the model is contradicted, later samples say nothing of
//! earlier ones: there a segment ends, and its last estimate is the filter's.
//!
//! Memory is bounded: the states of the filter are kept every [`CHUNK`] samples, and what lies between is run again,
//! which repeats the bytes.

use super::{Column, RunError, Settings};
use crate::log::Log;
use crate::progress::Progress;
use crate::replay::Source;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;
use wheelstate::estimator::one_step::{Belief, OneStepPrediction, Transition};
use wheelstate::variable::Kind;
use wheelstate::{Estimator, Status, Variable, Variables};

/// Samples between two states that are kept.
pub(super) const CHUNK: usize = 1024;
/// What contradicts the model has done so for some time before it is shown, s: twice the time over which the innovations
/// are averaged.
const UNSEEN: f64 = 4.0;
/// A measurement makes a variance no larger, but for rounding.
const ROUNDING: f64 = 1e-6;

/// One step of the recursion; nothing where the predicted covariance has no inverse.
///
/// ```
/// use nalgebra::{DMatrix, DVector};
/// use wheelstate::estimator::one_step::{Belief, Transition};
/// use wheelstate_identify::run::smooth_step;
///
/// // a number that stays as it is: what is known of it later was as true before
/// let number = |mean, variance| Belief {
///     mean: DVector::from_element(1, mean),
///     covariance: DMatrix::from_element(1, 1, variance),
/// };
/// let filtered = number(1.0, 4.0);
/// let transition = Transition { predicted: filtered.clone(), cross: DMatrix::from_element(1, 1, 4.0) };
/// let later = number(2.0, 1.0);
/// assert_eq!(smooth_step(&filtered, &transition, &later), Some(later));
/// ```
pub fn smooth_step(filtered: &Belief, transition: &Transition, later: &Belief) -> Option<Belief> {
    let Transition { predicted, cross } = transition;
    let size = filtered.mean.len();
    if predicted.mean.len() != size || later.mean.len() != size || cross.shape() != (size, size) {
        return None;
    }
    // States that are known exactly say nothing and learn nothing. The others in units of their standard deviations.
    let known: Vec<usize> = (0..size).filter(|&i| predicted.covariance[(i, i)] > 0.0).collect();
    let std = DVector::from_iterator(known.len(), known.iter().map(|&i| predicted.covariance[(i, i)].sqrt()));
    let n = known.len();
    let scaled = DMatrix::from_fn(n, n, |a, b| predicted.covariance[(known[a], known[b])] / (std[a] * std[b]));
    let factor = scaled.cholesky()?;
    let cross = DMatrix::from_fn(n, size, |a, row| cross[(row, known[a])] / std[a]);
    let mut gain = factor.solve(&cross).transpose();
    for (a, std) in std.iter().enumerate() {
        gain.column_mut(a).scale_mut(1.0 / std);
    }
    let change = DVector::from_fn(n, |a, _| later.mean[known[a]] - predicted.mean[known[a]]);
    let shrunk = DMatrix::from_fn(n, n, |a, b| {
        let (i, j) = (known[a], known[b]);
        later.covariance[(i, j)] - predicted.covariance[(i, j)]
    });
    let mean = &filtered.mean + &gain * change;
    let mut covariance = &filtered.covariance + &gain * shrunk * gain.transpose();
    covariance = 0.5 * (&covariance + covariance.transpose());
    let sound = mean.iter().chain(covariance.iter()).all(|value| value.is_finite())
        && (0..size).all(|i| covariance[(i, i)] >= 0.0);
    sound.then_some(Belief { mean, covariance })
}

/// Whether a sample did nothing but condition the prediction.
fn conditioned(predicted: &Belief, filtered: &Belief) -> bool {
    let less = |i: usize| filtered.covariance[(i, i)] <= (1.0 + ROUNDING) * predicted.covariance[(i, i)];
    predicted.mean.len() == filtered.mean.len() && (0..filtered.mean.len()).all(less)
}

/// Samples whose information must not go back beyond them.
fn borders(time: &[f64], status: &[f64]) -> Vec<bool> {
    let any = |value: f64, set: Status| value as u32 & set.bits() != 0;
    let new_start = Status::RESTARTED | Status::RECOVERED | Status::SKIPPED | Status::BAD_STEP;
    let mut contradicted_at = f64::INFINITY;
    let mut borders = vec![false; time.len()];
    for k in (0..time.len()).rev() {
        if any(status[k], Status::CONTRADICTED) {
            contradicted_at = time[k];
        }
        borders[k] = any(status[k], new_start) || contradicted_at - time[k] <= UNSEEN;
    }
    borders
}

/// A sample of the present chunk.
struct Sample<S> {
    state: S,
    filtered: Belief,
    /// From the sample before.
    transition: Option<Transition>,
}

/// Where smoothed estimates come from and go to.
pub(super) struct Smoother<'a, E: Estimator> {
    pub log: &'a Log,
    pub parameters: &'a E::Parameters,
    /// The states before samples 0, [`CHUNK`], 2 [`CHUNK`] and so on.
    pub kept: Vec<E::State>,
    /// The filter's outputs.
    pub filtered: &'a [Column],
}

impl<E: Estimator> Smoother<'_, E> {
    /// The smoothed estimates as columns `x_smoothed`, `x_smoothed_std`, those that differ from the filter's; and
    /// `smoothed`, whether later samples had a part in a row.
    pub fn run(&self, progress: &Progress) -> Result<Vec<Column>, RunError> {
        let log = self.log;
        let status = self.filtered.iter().find(|column| column.variable.name == "status");
        let border = borders(&log.time, status.map_or(&[], |column| &column.values));
        let pairs = estimates(self.filtered);
        let mut values: Vec<_> = pairs.iter().map(|_| [vec![0.0; log.len()], vec![0.0; log.len()]]).collect();
        let mut smoothed = vec![0.0; log.len()];
        let source = Source::of::<E>(log);
        let (mut inputs, mut outputs) = (E::Inputs::default(), E::Outputs::default());
        let (mut flat_in, mut flat_out) = (vec![0.0; E::Inputs::COUNT], vec![0.0; E::Outputs::COUNT]);
        // The sample after the present one: its smoothed belief, its filtered one, and how the present one leads there.
        let mut next: Option<(Belief, Belief, Option<Transition>)> = None;
        progress.start("smoothing", log.len() as u64);
        for (chunk, state) in self.kept.iter().enumerate().rev() {
            let rows = chunk * CHUNK..((chunk + 1) * CHUNK).min(log.len());
            let mut estimator = self.estimator(state)?;
            let samples = self.again(&mut estimator, &source, rows.clone());
            for (k, sample) in rows.zip(samples).rev() {
                let back = next.take().and_then(|(later, filtered, transition)| {
                    let transition = transition.filter(|t| !border[k + 1] && conditioned(&t.predicted, &filtered))?;
                    smooth_step(&sample.filtered, &transition, &later)
                });
                smoothed[k] = f64::from(u8::from(back.is_some()));
                let belief = back.unwrap_or_else(|| sample.filtered.clone());
                source.row(k, &mut flat_in);
                inputs.read(&flat_in);
                if smoothed[k] != 0.0 && estimator.restore(&sample.state).is_ok() {
                    estimator.believe(&belief);
                    estimator.outputs(&inputs, 0.0, &mut outputs);
                    outputs.write(&mut flat_out);
                    for (pair, [value, std]) in pairs.iter().zip(&mut values) {
                        (value[k], std[k]) = (flat_out[pair[0]], flat_out[pair[1]]);
                    }
                } else {
                    for (pair, [value, std]) in pairs.iter().zip(&mut values) {
                        (value[k], std[k]) = (self.filtered[pair[0]].values[k], self.filtered[pair[1]].values[k]);
                    }
                }
                next = Some((belief, sample.filtered, sample.transition));
            }
            progress.advance(CHUNK as u64);
            progress.check()?;
        }
        progress.finish();
        Ok(self.columns(&pairs, values, smoothed))
    }

    /// An estimator in a state.
    fn estimator(&self, state: &E::State) -> Result<E, RunError> {
        let mut estimator = E::new(self.parameters)?;
        estimator.restore(state).map_err(|error| RunError::State(error.to_string()))?;
        Ok(estimator)
    }

    /// Runs some samples again.
    fn again(&self, estimator: &mut E, source: &Source, rows: Range<usize>) -> Vec<Sample<E::State>> {
        let mut inputs = E::Inputs::default();
        let mut flat = vec![0.0; E::Inputs::COUNT];
        let mut prediction = OneStepPrediction::default();
        let time = &self.log.time;
        let sample = |k: usize| {
            source.row(k, &mut flat);
            inputs.read(&flat);
            let dt = if k == 0 { estimator.sample_period() } else { time[k] - time[k - 1] };
            estimator.predict_one_step(&inputs, dt, &mut prediction);
            estimator.step(&inputs, dt);
            let filtered =
                estimator.belief().unwrap_or(Belief { mean: DVector::zeros(0), covariance: DMatrix::zeros(0, 0) });
            Sample { state: estimator.state().clone(), filtered, transition: prediction.transition.take() }
        };
        rows.map(sample).collect()
    }

    fn columns(&self, pairs: &[[usize; 2]], values: Vec<[Vec<f64>; 2]>, smoothed: Vec<f64>) -> Vec<Column> {
        let mut columns = Vec::new();
        for (pair, smoothed) in pairs.iter().zip(values) {
            let filtered = pair.map(|index| &self.filtered[index]);
            if filtered.iter().zip(&smoothed).all(|(filtered, smoothed)| filtered.values == *smoothed) {
                continue;
            }
            let [value, std] = smoothed;
            let variable = &filtered[0].variable;
            let of = |name: String, about: String, values| Column {
                variable: Variable::new(name, about, variable.unit, Kind::Real, (f64::NEG_INFINITY, f64::INFINITY)),
                values,
            };
            let name = format!("{}_smoothed", variable.name);
            columns.push(of(
                name.clone(),
                format!("{} Smoothed: from all samples of the ride.", variable.description),
                value,
            ));
            columns.push(of(format!("{name}_std"), format!("Standard deviation of {name}."), std));
        }
        let about =
            "Whether later samples had a part in the smoothed estimates of this row; else they are the filter's.";
        let variable = Variable::new("smoothed".to_owned(), about, "1", Kind::Boolean, (0.0, 1.0));
        columns.push(Column { variable, values: smoothed });
        columns
    }
}

/// Places of the estimates that have a standard deviation, and of this.
fn estimates(outputs: &[Column]) -> Vec<[usize; 2]> {
    let place = |name: &str| outputs.iter().position(|column| column.variable.name == name);
    let pair = |(index, column): (usize, &Column)| Some([index, place(&format!("{}_std", column.variable.name))?]);
    outputs.iter().enumerate().filter_map(pair).collect()
}

/// Refuses what cannot be smoothed.
pub(super) fn check<E: Estimator>(estimator: &E, settings: &Settings) -> Result<(), RunError> {
    if settings.smooth
        && let Err(reason) = estimator.belief()
    {
        return Err(RunError::NotSmooth { model: E::NAME, reason });
    }
    Ok(())
}
