//! Profiles of the estimates of a fit, for the report.

use super::findings::{Effect, Findings, Found, Profiled};
use super::fit::Doubts;
use super::{FitRequest, Target};
use crate::result::{Profile, ProfileEnd};
use crate::solve::profile::{Curve, End, parabola};

/// Half of a 95 % interval in standard deviations.
const HALF: f64 = 1.96;
/// Difference between the ends by a profile and by the standard error that is worth a note, as a share of the latter.
const UNLIKE: f64 = 0.2;

/// What is said of profiles.
#[derive(Debug, Default)]
pub struct Said {
    /// The profiles.
    pub profiles: Vec<Profile>,
    /// In words, one line each.
    pub notes: Vec<String>,
    /// Of refits that are better than the fit, and of profiles that cannot be.
    pub warnings: Vec<String>,
}

/// The profiles that were asked for; those of estimates that logs were combined to, each with its own answer, are parabolas
/// by their covariance. A curve without an end is a doubt.
pub fn profiles(
    request: &FitRequest,
    findings: &Findings,
    effects: &[Effect],
    targets: &[Target],
    doubts: &mut Doubts,
) -> Said {
    let mut said = Said::default();
    let errors = findings.errors(effects);
    for name in &request.profile {
        let Some(index) = findings.found.iter().position(|found| found.name == *name) else {
            said.warnings.push(format!("{name} has no profile: it is not fitted, or each log has its own value of it"));
            continue;
        };
        let found = &findings.found[index];
        let range = targets.iter().find(|target| target.name == *name).map_or((f64::MIN, f64::MAX), |t| t.range);
        let made = findings.profiles.iter().find(|profiled| profiled.name == *name).cloned();
        let made = made.or_else(|| {
            let curve = parabola(found.value, found.spread, range)?;
            Some(Profiled { name: name.clone(), curve, refitted: false })
        });
        let Some(Profiled { curve, refitted, .. }) = made else {
            said.warnings.push(format!("{name} has no profile: it is no function of what is fitted"));
            continue;
        };
        if let Some(better) = curve.better {
            said.warnings.push(format!(
                "the fit is not the best: refits with {name} held near {} fit better than the estimate {}",
                near(better, found.spread),
                near(found.value, found.spread)
            ));
        }
        let others = (errors[index].powi(2) - found.spread.powi(2)).max(0.0).sqrt();
        let profile = profile(found, others, &curve, refitted);
        let edges = [profile.values.first(), profile.values.last()].map(|edge| edge.copied().unwrap_or(f64::NAN));
        let sides = profile.ends.iter().zip(["lower", "upper"]).zip(edges);
        for ((_, side), edge) in sides.filter(|((end, _), _)| **end == ProfileEnd::Open) {
            doubts
                .entry(name.clone())
                .or_default()
                .push(format!("its profile has no {side} end: the logs do not exclude even {edge:.3e} at 99.7 %"));
        }
        let limits = found.judgement.limits;
        let size = found.judgement.size.unwrap_or(found.value).abs();
        let reach = profile.ci95.map(|end| (end - found.value).abs()).into_iter().fold(0.0, f64::max);
        if reach.is_finite() && reach > HALF * limits.absolute_error.unwrap_or(limits.relative_error * size) {
            let [low, high] = profile.ci95.map(|end| near(end, found.spread));
            let what = format!("its profile is wider than its standard error: 95 % {low} to {high}");
            doubts.entry(name.clone()).or_default().push(what);
        }
        said.notes.push(words(&profile));
        said.profiles.push(profile);
    }
    said
}

/// For the report; `others` is the standard error by everything but noise.
fn profile(found: &Found, others: f64, curve: &Curve, refitted: bool) -> Profile {
    let bounds = [curve.value.first(), curve.value.last()].map(|end| end.copied().unwrap_or(f64::NAN));
    let interval = |level: usize| {
        [0, 1].map(|side| match curve.ends[side] {
            End::Bound if curve.crossings[level][side].is_infinite() => bounds[side],
            _ => curve.crossings[level][side],
        })
    };
    let noise95 = interval(0);
    let value = found.value;
    let wider = |end: f64| value + (end - value).hypot(HALF * others).copysign(end - value);
    Profile {
        parameter: found.name.clone(),
        estimate: value,
        std: found.spread,
        values: curve.value.clone(),
        statistic: curve.statistic.clone(),
        refitted,
        inflation: curve.inflation,
        noise95,
        noise997: interval(1),
        ci95: noise95.map(wider),
        ends: curve.ends.map(|end| match end {
            End::Passed => ProfileEnd::Passed,
            End::Bound => ProfileEnd::Bound,
            End::Open => ProfileEnd::Open,
        }),
    }
}

fn words(profile: &Profile) -> String {
    let Profile { parameter, noise95, noise997, ci95, ends, estimate: value, std: spread, .. } = profile;
    let (value, spread) = (*value, *spread);
    let text = |end: f64| if end.is_finite() { near(end, spread) } else { "no end".to_owned() };
    let between = |[low, high]: [f64; 2]| format!("{} to {}", text(low), text(high));
    let how = if profile.refitted { "by refits" } else { "a parabola by its covariance" };
    let mut all = format!(
        "profile of {parameter} ({how}): 95 % {} and 99.7 % {} by noise alone; 95 % with all that is considered {}",
        between(*noise95),
        between(*noise997),
        between(*ci95)
    );
    for (end, side) in ends.iter().zip(["below", "above"]).filter(|(end, _)| **end != ProfileEnd::Passed) {
        all += &match end {
            ProfileEnd::Bound => format!("; {side} it ends at a bound"),
            _ => format!("; {side} it has no end"),
        };
    }
    let half = HALF * spread;
    let unlike = |end: f64, usual: f64| end.is_finite() && (end - usual).abs() > UNLIKE * half;
    if unlike(noise95[0], value - half) || unlike(noise95[1], value + half) {
        all += &format!(
            "; the cost is not quadratic: the standard error makes it {} by noise",
            between([value - half, value + half])
        );
    }
    all
}

/// A value with as many decimals as its standard deviation is worth.
fn near(value: f64, std: f64) -> String {
    let decimals = (1 - std.log10().floor() as i64).clamp(0, 9) as usize;
    format!("{value:.decimals$}")
}
