//! What one estimation of a problem found, and the report of it.

use super::{Judgement, Known, Target};
use crate::assess::{Evidence, Verdict, verdict};
use crate::result::{Contribution, CorrelationPair, Covariance, Delay, FitReport, Parameter, Verdict as Shade};
use crate::solve::profile::Curve;
use nalgebra::{DMatrix, DVector};
use std::collections::{BTreeMap, BTreeSet};

/// Standard errors from which on a fitted delay or an offset is worth a note.
const SHOWN: f64 = 3.0;
/// Relative standard error below which a product of parameters counts as determined.
const KNOWN: f64 = 0.1;

/// One estimate with what is needed to judge it.
#[derive(Clone, Debug)]
pub struct Found {
    /// FMU name.
    pub name: String,
    /// The estimate.
    pub value: f64,
    /// Standard deviation by noise; 1.96 of it are the 97.5 % quantile.
    pub spread: f64,
    /// Estimated bias by noise in the regressors and by what the regression neglects.
    pub bias: f64,
    /// How far noise that is not white could pull it, per channel.
    pub coloured: Vec<(String, f64)>,
    /// Limits and what the machine adds.
    pub judgement: Judgement,
    /// Whether it, or an unknown that it is made of, sits at a bound.
    pub at_bound: bool,
    /// Largest share of noise in its regressors.
    pub noise_share: f64,
    /// Largest correlation with another parameter of its regression.
    pub correlation: f64,
    /// Condition number of its regression.
    pub condition_number: f64,
}

impl Found {
    /// Standard error of what this log alone makes of it: without causes that all logs share.
    pub fn own_error(&self) -> f64 {
        self.spread.hypot(self.bias).hypot(self.worst_colour().map_or(0.0, |(_, pull)| pull))
    }

    /// Whether the log holds nothing of it: its regressor is nothing but sensor noise. A fit to such rows is near zero for
    /// any true value, and small residuals are no proof of it.
    pub fn tells_nothing(&self) -> bool {
        self.noise_share > NOTHING_BUT_NOISE || !self.own_error().is_finite()
    }

    fn worst_colour(&self) -> Option<(&str, f64)> {
        let all = self.coloured.iter().map(|(channel, pull)| (channel.as_str(), pull.abs()));
        all.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// How much larger a channel is, in the mean over a log, than what other channels say of the same quantity: its bias, or
/// what both sides feel differently, as an accelerometer a slope.
#[derive(Clone, Debug)]
pub struct Offset {
    /// The log.
    pub log: String,
    /// The channel.
    pub channel: String,
    /// The channel's unit.
    pub unit: &'static str,
    /// What it is compared with, in words.
    pub against: String,
    /// The difference.
    pub value: f64,
    /// Its standard error.
    pub std_error: f64,
}

impl Offset {
    /// From differences, each with the number of its cluster, of a log that is still to be named; none with fewer than
    /// three clusters. The clusters' means count as independent.
    pub fn of_clusters(values: &[(u32, f64)], channel: &str, unit: &'static str, against: &str) -> Option<Self> {
        let values: Vec<(u32, f64)> = values.iter().filter(|(_, x)| x.is_finite()).copied().collect();
        let mean = |of: &[(u32, f64)]| of.iter().map(|(_, x)| x).sum::<f64>() / of.len() as f64;
        let means: Vec<f64> = values.chunk_by(|a, b| a.0 == b.0).map(mean).collect();
        let n = means.len() as f64;
        let value = means.iter().sum::<f64>() / n;
        let squares: f64 = means.iter().map(|x| (x - value).powi(2)).sum();
        let std_error = (squares / (n * (n - 1.0))).sqrt();
        let [channel, against] = [channel, against].map(str::to_owned);
        (n >= 3.0).then_some(Self { log: String::new(), channel, unit, against, value, std_error })
    }

    /// Root mean square of those of several logs; 0 of none.
    pub fn size<'a>(offsets: impl Iterator<Item = &'a Self>) -> f64 {
        let (sum, count) = offsets.fold((0.0, 0.0_f64), |(sum, count), o| (sum + o.value * o.value, count + 1.0));
        (sum / count.max(1.0)).sqrt()
    }

    /// Whether it is more than noise.
    pub fn shows(&self) -> bool {
        self.value.abs() > SHOWN * self.std_error
    }
}

/// All that was found.
#[derive(Clone, Debug)]
pub struct Findings {
    /// The estimates.
    pub found: Vec<Found>,
    /// Their covariance by noise.
    pub covariance: DMatrix<f64>,
    /// Delays that were fitted along.
    pub delays: Vec<Delay>,
    /// What channels differ by from others.
    pub offsets: Vec<Offset>,
    /// The profiles that were asked for.
    pub profiles: Vec<Profiled>,
    /// What was decided by the data, see [`Session::decide`](super::Session::decide).
    pub decisions: BTreeMap<String, bool>,
    /// Which of them hold for a fit to a part of the logs, too.
    pub of_parts: BTreeSet<String>,
    /// What was not found, with the reasons.
    pub given_up: BTreeMap<String, String>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Notes.
    pub notes: Vec<String>,
    /// Rows used.
    pub rows: usize,
    /// The worst condition number.
    pub condition_number: f64,
    /// Whether a conic program was solved to reduced accuracy only.
    pub almost: bool,
    /// Whether the bias was subtracted.
    pub corrected: bool,
}

/// The profile of an estimate.
#[derive(Clone, Debug)]
pub struct Profiled {
    /// Its name.
    pub name: String,
    /// The curve.
    pub curve: Curve,
    /// Whether it is by refits, or a parabola by the covariance.
    pub refitted: bool,
}

/// What one considered cause does to the estimates: one value per estimate, for one standard deviation.
#[derive(Clone, Debug)]
pub struct Effect {
    /// The cause.
    pub cause: String,
    /// The effects, in the order of [`Findings::found`].
    pub shift: Vec<f64>,
}

/// Share of noise in a regressor from which it shows nothing else.
const NOTHING_BUT_NOISE: f64 = 0.99;

impl Findings {
    /// The estimate of a parameter.
    pub fn get(&self, name: &str) -> Option<&Found> {
        self.found.iter().find(|found| found.name == name)
    }

    /// The decisions that a fit to a part of the logs takes over.
    pub fn decisions_of_parts(&self) -> BTreeMap<String, bool> {
        self.decisions.iter().filter(|(what, _)| self.of_parts.contains(*what)).map(|(w, d)| (w.clone(), *d)).collect()
    }

    /// Names and values.
    pub fn values(&self) -> impl Iterator<Item = (&str, f64)> {
        self.found.iter().map(|found| (found.name.as_str(), found.value))
    }

    /// Standard error of each estimate with everything that is known of; infinite where the log
    /// [tells nothing](Found::tells_nothing) of it.
    pub fn errors(&self, effects: &[Effect]) -> Vec<f64> {
        let of = |(index, found): (usize, &Found)| {
            if found.tells_nothing() {
                return f64::INFINITY;
            }
            let considered: f64 = effects.iter().map(|effect| effect.shift[index].powi(2)).sum();
            found.own_error().hypot(found.judgement.systematic_std).hypot(considered.sqrt())
        };
        self.found.iter().enumerate().map(of).collect()
    }

    /// Why an estimate is not identified; nothing if it is.
    fn reasons(&self, index: usize, std_error: f64, largest: Option<&Contribution>, doubts: &[String]) -> Vec<String> {
        let found = &self.found[index];
        let evidence = Evidence {
            value: found.judgement.size.unwrap_or(found.value),
            std_error,
            at_bound: found.at_bound,
            correlation: found.correlation,
            noise_share: found.noise_share,
            condition_number: found.condition_number,
        };
        let mut reasons = match verdict(&evidence, &found.judgement.limits) {
            Verdict::Identified => Vec::new(),
            Verdict::Unidentified(reasons) => reasons,
        };
        if let (Some(large), Some(cause)) =
            (reasons.iter_mut().find(|r| r.starts_with("standard error")), largest.filter(|c| c.cause != "noise"))
        {
            large.push_str(&format!(", most of it by the {}", cause.cause));
        }
        reasons.extend(found.judgement.doubt.map(str::to_owned));
        reasons.extend(doubts.iter().cloned());
        reasons
    }

    /// The causes of an estimate's uncertainty, the largest first.
    fn contributions(&self, index: usize, effects: &[Effect]) -> Vec<Contribution> {
        let found = &self.found[index];
        let mut all = vec![
            Contribution { cause: "noise".to_owned(), std: found.spread },
            Contribution {
                cause: "bias by noise in the regressors and by what they neglect".to_owned(),
                std: found.bias.abs(),
            },
            Contribution {
                cause: "systematic error that the fit of this machine allows for".to_owned(),
                std: found.judgement.systematic_std,
            },
        ];
        if let Some((channel, pull)) = found.worst_colour() {
            all.push(Contribution { cause: format!("noise of {channel} if it is not white"), std: pull });
        }
        all.extend(effects.iter().map(|e| Contribution { cause: e.cause.clone(), std: e.shift[index].abs() }));
        all.retain(|contribution| contribution.std > 0.0);
        all.sort_by(|a, b| b.std.total_cmp(&a.std));
        all
    }

    /// The report of everything but logs, settings and validation. `doubts` are further reasons against estimates;
    /// a parameter that is optional and was not asked for by name is no warning if it was not found.
    pub fn report(
        &self,
        effects: &[Effect],
        doubts: &BTreeMap<String, Vec<String>>,
        targets: &[Target],
        known: &Known,
        asked: bool,
    ) -> FitReport {
        let mut report =
            FitReport { warnings: self.warnings.clone(), notes: self.notes.clone(), ..FitReport::default() };
        report.notes.extend(self.note_on_bias());
        report.notes.extend(self.notes_on_delays());
        report.notes.extend(self.notes_on_offsets());
        report.delays = self.delays.clone();
        let errors = self.errors(effects);
        let mut mostly: BTreeMap<String, Vec<&str>> = BTreeMap::new();
        for (index, found) in self.found.iter().enumerate() {
            let Some(target) = targets.iter().find(|target| target.name == found.name) else { continue };
            let std_error = errors[index];
            let contributions = self.contributions(index, effects);
            let largest = contributions.first().cloned();
            let doubted = |name: &str| doubts.get(name).map_or(&[][..], Vec::as_slice);
            // A standard deviation that is fitted along has in it all that is considered of its parameter, and is worth as
            // much as that.
            let of = found.name.strip_suffix("_std").and_then(|base| self.found.iter().position(|f| f.name == base));
            let reasons = match of {
                None => self.reasons(index, std_error, largest.as_ref(), doubted(&found.name)),
                Some(base) if self.reasons(base, errors[base], None, doubted(&self.found[base].name)).is_empty() => {
                    Vec::new()
                }
                Some(base) => vec![format!("{} is not identified", self.found[base].name)],
            };
            let considered = |of: usize| effects.iter().map(|effect| effect.shift[of].powi(2)).sum::<f64>().sqrt();
            // Of a state at the start it is absolute, else a share of the parameter.
            let size =
                |base: usize| if found.name.starts_with("initial.") { 1.0 } else { self.found[base].value.abs() };
            let value = of.map_or(found.value, |base| found.value.hypot(considered(base) / size(base)));
            // Seen, but not well enough, by a log without the manoeuvre that shows it.
            let kept = target.optional && !asked && !found.at_bound && doubted(&found.name).is_empty();
            let shade = match reasons.is_empty() {
                true => Shade::Identified,
                false if found.at_bound => Shade::AtBound,
                false if kept => Shade::PriorOnly,
                false if std_error < found.judgement.size.unwrap_or(found.value).abs() => Shade::Weak,
                false => Shade::NotIdentifiable,
            };
            if let Some(cause) = largest.as_ref().filter(|c| c.std > found.spread && c.cause != "noise") {
                mostly.entry(cause.cause.clone()).or_default().push(&found.name);
            }
            if !reasons.is_empty() {
                let text = format!("{} is not identified: {}", found.name, reasons.join("; "));
                if kept {
                    report.notes.push(format!("{text}; it keeps its known value"));
                } else {
                    report.warnings.push(text);
                }
            }
            let half = 1.96 * std_error;
            let parameter = Parameter {
                value,
                unit: target.unit.clone(),
                std_error,
                sampling_std: if std_error.is_finite() { found.spread.hypot(found.bias) } else { std_error },
                ci95: [value - half, value + half],
                identified: reasons.is_empty(),
                at_bound: found.at_bound,
                verdict: shade,
                start: known.find(&found.name),
                contributions: contributions.into_iter().take(4).collect(),
                ..Parameter::default()
            };
            report.parameters.insert(found.name.clone(), parameter);
        }
        for (cause, names) in mostly {
            report.notes.push(format!("largest part of the uncertainty is the {cause}: {}", names.join(", ")));
        }
        report.notes.extend(self.combinations(&report));
        let some = report.parameters.values().any(|parameter| parameter.identified);
        if !some {
            report
                .parameters
                .values_mut()
                .filter(|p| p.verdict == Shade::PriorOnly)
                .for_each(|p| p.verdict = Shade::Weak);
        }
        for (name, reason) in &self.given_up {
            let Some(target) = targets.iter().find(|target| target.name == *name) else { continue };
            let optional = target.optional && !asked && some;
            let text = format!("{name} is not identified: {reason}");
            if optional {
                report.notes.push(format!("{text}; it keeps its known value"));
            } else {
                report.warnings.push(text);
            }
            let parameter = Parameter {
                value: f64::NAN,
                unit: target.unit.clone(),
                std_error: f64::NAN,
                sampling_std: f64::NAN,
                ci95: [f64::NAN; 2],
                identified: false,
                verdict: if optional { Shade::PriorOnly } else { Shade::NotIdentifiable },
                start: known.find(name),
                ..Parameter::default()
            };
            report.parameters.insert(name.clone(), parameter);
        }
        report.condition_number = self.condition_number;
        report.windows_used = self.rows;
        report.solver_status = match (self.found.is_empty(), self.almost) {
            (true, _) => "not run",
            (false, true) => "AlmostSolved",
            (false, false) => "Solved",
        }
        .to_owned();
        self.covariance_into(&mut report, effects, &errors);
        report
    }

    /// What the data do say of parameters that are not identified: a product of powers if there is one, else a sum.
    fn combinations(&self, report: &FitReport) -> Vec<String> {
        let open = |found: &Found| report.parameters.get(&found.name).is_some_and(|p| !p.identified) && !found.at_bound;
        let of = |index: usize| self.product(index).or_else(|| self.sum(index));
        let mut all: Vec<String> =
            (0..self.found.len()).filter(|index| open(&self.found[*index])).filter_map(of).collect();
        let mut seen = BTreeSet::new();
        all.retain(|line| seen.insert(line.clone()));
        all
    }

    fn correlation(&self, i: usize, j: usize) -> f64 {
        let c = &self.covariance;
        c[(i, j)] / (c[(i, i)] * c[(j, j)]).sqrt()
    }

    /// A product of powers that noise leaves well known although it does not leave this parameter so: relative errors add
    /// as `sum a_j d ln p_j`, and the eigenvectors of their covariance with the smallest eigenvalues have the exponents.
    /// First it is looked for in pairs. Exponents are rounded to halves where that is as good.
    fn product(&self, index: usize) -> Option<String> {
        const ENTANGLED: f64 = 0.5;
        let own = |j: &usize| *j == index || self.correlation(index, *j).abs() > ENTANGLED;
        let together: Vec<usize> = (0..self.found.len())
            .filter(|j| self.found[*j].value != 0.0 && self.covariance[(*j, *j)] > 0.0 && own(j))
            .collect();
        let place = together.iter().position(|j| *j == index)?;
        let n = together.len();
        let value = |i: usize| self.found[together[i]].value;
        let relative =
            DMatrix::from_fn(n, n, |i, j| self.covariance[(together[i], together[j])] / (value(i) * value(j)));
        let std = |powers: &DVector<f64>| powers.dot(&(&relative * powers)).max(0.0).sqrt();
        let worth = |std: f64| std < KNOWN && std < 0.3 * relative[(place, place)].sqrt();
        let pair = |other: usize| {
            DVector::from_fn(n, |j, _| match j {
                _ if j == place => 1.0,
                _ if j == other => -relative[(place, other)] / relative[(other, other)],
                _ => 0.0,
            })
        };
        let mut candidates: Vec<DVector<f64>> = (0..n).filter(|other| *other != place).map(pair).collect();
        candidates.sort_by(|a, b| std(a).total_cmp(&std(b)));
        let eigen = relative.clone().symmetric_eigen();
        let mut order: Vec<usize> = (0..n).filter(|k| eigen.eigenvectors[(place, *k)].abs() > 0.3).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        candidates.extend(order.iter().map(|k| eigen.eigenvectors.column(*k) / eigen.eigenvectors[(place, *k)]));
        let powers = candidates.iter().find_map(|exact| {
            let rounded = exact.map(|power| (2.0 * power).round() / 2.0);
            let as_good = std(&rounded) < (2.0 * std(exact)).max(0.02);
            [rounded, exact.map(|power| if power.abs() < 0.1 { 0.0 } else { power })]
                .into_iter()
                .zip([as_good, true])
                .find(|(powers, good)| {
                    *good && worth(std(powers)) && powers.iter().filter(|power| **power != 0.0).count() > 1
                })
                .map(|(powers, _)| powers)
        })?;
        let used = || (0..n).filter(|j| powers[*j] != 0.0);
        let factor = |j: usize| {
            let name = &self.found[together[j]].name;
            match powers[j] {
                1.0 => name.clone(),
                power => format!("{name}^{}", format!("{power:.2}").trim_end_matches('0').trim_end_matches('.')),
            }
        };
        let product: f64 = used().map(|j| value(j).abs().powf(powers[j])).product();
        // Powers of what is next to nothing may leave the range of numbers.
        if !product.is_normal() {
            return None;
        }
        let names: Vec<String> = used().map(factor).collect();
        let percent = 100.0 * std(&powers);
        let digits = (3 - product.abs().log10().floor() as i32).clamp(0, 9) as usize;
        Some(format!("determined is {} = {product:.digits$} +- {percent:.2} %", names.join(" * ")))
    }

    /// The sum of a parameter with a multiple of the one that noise tells it apart from worst.
    fn sum(&self, i: usize) -> Option<String> {
        const ENTANGLED: f64 = 0.9;
        let c = &self.covariance;
        let others = (0..self.found.len()).filter(|j| *j != i && self.correlation(i, *j).is_finite());
        let j = others.max_by(|a, b| self.correlation(i, *a).abs().total_cmp(&self.correlation(i, *b).abs()))?;
        let (found, other, rho) = (&self.found[i], &self.found[j], self.correlation(i, j));
        let factor = -c[(i, j)] / c[(j, j)];
        let (value, std) = (found.value + factor * other.value, (c[(i, i)] * (1.0 - rho * rho)).max(0.0).sqrt());
        let sign = if factor < 0.0 { '-' } else { '+' };
        (rho.abs() > ENTANGLED && std < 0.3 * value.abs()).then(|| {
            let factor = factor.abs();
            format!("determined is {} {sign} {factor:.3e} {} = {value:.4} +- {std:.2}", found.name, other.name)
        })
    }

    /// Delays that the logs show.
    fn notes_on_delays(&self) -> impl Iterator<Item = String> {
        self.delays.iter().filter(|delay| delay.value.abs() > SHOWN * delay.std_error).map(|delay| {
            let (ms, half) = (1e3 * delay.value, 1.96e3 * delay.std_error);
            format!(
                "{} of {} arrives {ms:.1} ms ({:.1} to {:.1}) later than its {}; the fit allows for it",
                delay.channel,
                delay.log,
                ms - half,
                ms + half,
                delay.against
            )
        })
    }

    /// Offsets that the logs show.
    fn notes_on_offsets(&self) -> impl Iterator<Item = String> {
        self.offsets.iter().filter(|offset| offset.shows()).map(|offset| {
            let Offset { log, channel, unit, against, value, std_error } = offset;
            let more = if *value > 0.0 { "more" } else { "less" };
            format!(
                "{channel} of {log} is in the mean {:.3} {unit} (+-{:.3}) {more} than {against}: a bias, a tilt of the sensor or a \
                 slope; the intervals allow for that much",
                value.abs(),
                std_error
            )
        })
    }

    /// Which estimates are mostly biased, if the user may have that subtracted.
    fn note_on_bias(&self) -> Option<String> {
        let biased = self.found.iter().filter(|found| found.bias.abs() > found.spread);
        let biased: Vec<_> = biased.map(|found| format!("{} by about {:.2e}", found.name, found.bias)).collect();
        (!self.corrected && !biased.is_empty())
            .then(|| format!("biased beyond chance: {} (--correct subtracts what is known of it)", biased.join(", ")))
    }

    /// The covariance with all that is considered, and the pair that noise alone tells apart worst.
    fn covariance_into(&self, report: &mut FitReport, effects: &[Effect], errors: &[f64]) {
        let n = self.found.len();
        if n == 0 {
            return;
        }
        let entry = |i: usize, j: usize| {
            if i == j {
                return errors[i] * errors[i];
            }
            let together: f64 = effects.iter().map(|effect| effect.shift[i] * effect.shift[j]).sum();
            let bias = if self.covariance[(i, j)] == 0.0 { 0.0 } else { self.found[i].bias * self.found[j].bias };
            self.covariance[(i, j)] + bias + together
        };
        let pair = (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| {
            let c = &self.covariance;
            let correlation = c[(i, j)] / (c[(i, i)] * c[(j, j)]).sqrt();
            (i, j, if correlation.is_finite() { correlation } else { 0.0 })
        });
        report.correlation_worst_pair =
            pair.max_by(|a, b| a.2.abs().total_cmp(&b.2.abs())).map(|(i, j, correlation)| CorrelationPair {
                parameters: [self.found[j].name.clone(), self.found[i].name.clone()],
                correlation,
            });
        let matrix = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
        let parameters = self.found.iter().map(|found| found.name.clone()).collect();
        report.covariance = Some(Covariance { parameters, matrix });
    }
}
