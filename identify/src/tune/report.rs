//! What a tuning says: `tune.json`, in the shape of `fit.json` with a section on the search.

use super::dung_beetle::Optimum;
use super::objective::{AnyTrack, Replay};
use super::{Candidate, Objective, Tuner};
use crate::result::{FORMAT_VERSION, FitReport, LogEntry, Parameter, Verdict};
use nalgebra::DMatrix;
use serde::Serialize;

/// Half the difference step of the curvature, in decades.
const STEP: f64 = 0.03;
/// A noise setting is identified if its standard error is below this many decades (a factor of two).
const DECADES: f64 = 0.3;

/// The result. Its parameters are the report's, by their FMU names.
#[derive(Clone, Debug, Serialize)]
pub struct TuneReport {
    /// Parameters, warnings and notes.
    #[serde(flatten)]
    pub fit: FitReport,
    /// The search.
    pub tuning: Tuning,
}

/// The search.
#[derive(Clone, Debug, Serialize)]
pub struct Tuning {
    /// `nll` or `rmse`.
    pub objective: &'static str,
    /// Seed.
    pub seed: u64,
    /// Number of beetles.
    pub population: usize,
    /// Number of generations.
    pub iterations: usize,
    /// Number of evaluations, each a replay of all logs.
    pub evaluations: usize,
    /// Objective of the start values.
    pub start: f64,
    /// Objective of the result.
    pub best: f64,
    /// Best objective after the start and after each generation.
    pub history: Vec<f64>,
    /// Consistency on each log.
    pub nis: Vec<LogNis>,
}

/// Consistency on one log.
#[derive(Clone, Debug, Serialize)]
pub struct LogNis {
    /// The log.
    pub log: String,
    /// Whether the search did not see it.
    pub held_out: bool,
    /// Mean normalised innovation squared per channel with the start values; 1 is consistent.
    pub before: f64,
    /// With the result.
    pub after: f64,
    /// Objective with the start values.
    pub objective_before: f64,
    /// With the result.
    pub objective_after: f64,
}

impl TuneReport {
    /// The file's text, ending in a new line.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }
}

impl Tuner<'_> {
    /// What the user is told.
    pub(super) fn report(
        &self,
        replay: &Replay,
        held_out: &[Box<dyn AnyTrack>],
        found: &[Candidate],
        optimum: &Optimum,
    ) -> TuneReport {
        let Self { logs, request, .. } = self;
        let start: Vec<f64> = found.iter().map(|c| c.start.log10()).collect();
        let at = &optimum.position;
        let bound: Vec<Option<bool>> = found.iter().zip(at).map(|(c, x)| at_bound(c, *x)).collect();
        let std = match request.objective {
            Objective::Nll => standard_errors(replay, at, &bound),
            Objective::Rmse => vec![f64::NAN; found.len()],
        };
        let mut fit = FitReport {
            format_version: FORMAT_VERSION,
            vehicle: self.subject.vehicle.to_owned(),
            condition_number: f64::NAN,
            loss: request.objective.word().to_owned(),
            windows_used: replay.samples(),
            logs: logs.iter().map(LogEntry::from).collect(),
            solver_status: format!("{} evaluations", optimum.evaluations),
            settings: request.settings.iter().cloned().collect(),
            ..FitReport::default()
        };
        for (i, candidate) in found.iter().enumerate() {
            let variable = &self.parameters[candidate.index];
            let (value, known) = (10f64.powf(at[i]), std[i].is_finite() && std[i] < DECADES);
            let at_bound = bound[i].is_some();
            let identified = request.objective == Objective::Nll && (known || at_bound);
            let verdict = match (at_bound, identified) {
                (true, _) => Verdict::AtBound,
                (false, true) => Verdict::Identified,
                (false, false) => Verdict::Weak,
            };
            let parameter = Parameter {
                value,
                unit: variable.unit.to_owned(),
                std_error: value * std[i] * std::f64::consts::LN_10,
                ci95: [value * 10f64.powf(-1.96 * std[i]), value * 10f64.powf(1.96 * std[i])],
                identified,
                at_bound,
                verdict,
                start: Some(candidate.start),
                ..Parameter::default()
            };
            if let Some(low) = bound[i] {
                let (side, limit) = if low { ("floor", candidate.range.0) } else { ("upper limit", candidate.range.1) };
                fit.warnings.push(format!("{} sits at its {side} {limit:.3e} {}", variable.name, variable.unit));
            }
            fit.parameters.insert(variable.name.clone(), parameter);
        }

        let mut nis = Vec::new();
        let seen = replay.tracks.iter().map(|track| (track, false));
        for (track, held_out) in seen.chain(held_out.iter().map(|track| (track, true))) {
            let judge = |x: &[f64]| {
                let score = replay.score(&**track, x);
                score.map_or((f64::NAN, f64::NAN), |score| (score.mean_nis(), score.value(request.objective)))
            };
            let ((before, objective_before), (after, objective_after)) = (judge(&start), judge(at));
            let log = track.source().to_owned();
            let (unseen, word) = (if held_out { " (held out)" } else { "" }, request.objective.word());
            fit.notes.push(format!(
            "{log}{unseen}: {word} {objective_before:.4} before, {objective_after:.4} now; NIS per channel {before:.2} \
             before, {after:.2} now; 1 is consistent"
        ));
            let entry = LogNis { log, held_out, before, after, objective_before, objective_after };
            nis.push(entry);
        }
        if *at == start {
            fit.notes.push("the search found nothing better than the start values".into());
        }
        if logs.len() == 1 {
            fit.notes.push(
                "tuned on one log: a second manoeuvre, and one held out, would show whether it generalises".into(),
            );
        }
        if request.objective == Objective::Rmse {
            fit.warnings.push(degeneracy(replay, found, at, optimum.value, &nis));
        }
        fit.notes.push(
            "a consistent NIS does not prove consistent state errors; the optimiser favours the middle of its box"
                .into(),
        );
        let tuning = Tuning {
            objective: request.objective.word(),
            seed: request.seed,
            population: request.population,
            iterations: request.iterations,
            evaluations: optimum.evaluations,
            start: replay.value(&start),
            best: optimum.value,
            history: optimum.history.clone(),
            nis,
        };
        TuneReport { fit, tuning }
    }
}

/// At the lower (true) or upper (false) end of the search interval, to a hundredth of it.
fn at_bound(candidate: &Candidate, logarithm: f64) -> Option<bool> {
    let (low, high) = (candidate.range.0.log10(), candidate.range.1.log10());
    let near = 0.01 * (high - low);
    if logarithm - low < near {
        Some(true)
    } else if high - logarithm < near {
        Some(false)
    } else {
        None
    }
}

/// Standard errors in decades from the curvature of the negative log-likelihood; NaN for settings at
/// a bound.
fn standard_errors(replay: &Replay, at: &[f64], bound: &[Option<bool>]) -> Vec<f64> {
    let free: Vec<usize> = (0..at.len()).filter(|i| bound[*i].is_none()).collect();
    let n = free.len();
    if n == 0 {
        return vec![f64::NAN; at.len()];
    }
    let samples = replay.samples() as f64;
    // f, f ± e_i, f + e_i + e_j
    let mut points = vec![at.to_vec()];
    let moved = |steps: &[(usize, f64)]| {
        let mut x = at.to_vec();
        steps.iter().for_each(|(i, step)| x[free[*i]] += step);
        x
    };
    for i in 0..n {
        points.extend([moved(&[(i, STEP)]), moved(&[(i, -STEP)])]);
    }
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).collect();
    points.extend(pairs.iter().map(|(i, j)| moved(&[(*i, STEP), (*j, STEP)])));
    let f: Vec<f64> = replay.values(&points).iter().map(|value| samples * value).collect();
    let mut hessian = DMatrix::zeros(n, n);
    for i in 0..n {
        hessian[(i, i)] = (f[1 + 2 * i] - 2.0 * f[0] + f[2 + 2 * i]) / (STEP * STEP);
    }
    for (k, (i, j)) in pairs.iter().enumerate() {
        let cross = (f[1 + 2 * n + k] - f[1 + 2 * i] - f[1 + 2 * j] + f[0]) / (STEP * STEP);
        (hessian[(*i, *j)], hessian[(*j, *i)]) = (cross, cross);
    }
    // A decade is taken as known beforehand, so that flat directions have a size.
    let mut std = vec![f64::NAN; at.len()];
    let modes = hessian.symmetric_eigen();
    for (i, place) in free.iter().enumerate() {
        let share = |k: usize| modes.eigenvectors[(i, k)].powi(2) / (1.0 + modes.eigenvalues[k].max(0.0));
        std[*place] = (0..n).map(share).sum::<f64>().sqrt();
    }
    std
}

/// Shows that the source's objective does not see the scale of the noises.
fn degeneracy(replay: &Replay, found: &[Candidate], at: &[f64], best: f64, nis: &[LogNis]) -> String {
    let scaled = |decades: f64| {
        let moved = |(x, c): (&f64, &Candidate)| x + if c.power { 2.0 * decades } else { decades };
        let x: Vec<f64> = at.iter().zip(found).map(moved).collect();
        100.0 * (replay.value(&x) / best - 1.0)
    };
    let worst = nis.iter().map(|entry| entry.after).fold(0.0, f64::max);
    let why = if replay.knows_the_truth() { "it" } else { "it rewards following the measurement noise and" };
    format!(
        "objective rmse is degenerate: {why} does not see the scale of \
         the noises; all of them doubled change it by {:+.2} %, halved by {:+.2} %, and NIS per channel is up \
         to {worst:.2} where 1 is consistent; use --objective nll",
        scaled(2f64.log10()),
        scaled(-2f64.log10())
    )
}
