//! The human body: passive stiffness, damping and rest angle of every joint.
//!
//! A joint that is held by muscles at rest acts as a spring and a damper,
//! `tau = -stiffness (q - rest) - damping qd`, which is linear in `stiffness`, `damping` and
//! `stiffness * rest`. The torque is not measured: it comes from the estimator of the seated body,
//! run over the log with the sensors that the log has (`use.*` set by the user override that), or
//! from columns `tau_<joint>`, such as `identify estimate` writes, for any body.
//!
//! Nothing else in a log says when a force on a hand acted, so a late one shows only in the torques: to first order they are
//! off by `-delay S` with `S` the change of a torque when the force is taken so much earlier. Each joint's torque is
//! regressed on `S` beside its passive law, and a delay that several joints show is a warning.
use crate::assess::Limits;
use crate::check::relation::HARMLESS;
use crate::log::{Channel, Log};
use crate::problem::noise::noise_of;
use crate::problem::outliers::hampel;
use crate::problem::{FitError, Judgement, Known, Prediction, Problem, Session, Target, Task};
use crate::progress::Progress;
use crate::result::Trace;
use crate::solve::{Loss, Options, Regression, Rows, Unknown, solve, student};
use wheelstate::estimator::human_dynamics::variables::{GROUPS, JOINTS};
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::model::multibody::scatter::ScatterParameters;
use wheelstate::{Estimator, Status, Variable, Variables};

/// The problem.
pub const PROBLEM: Problem = Problem { targets, outliers: &SPIKED, estimate, validate };

/// Angles and rates stand among the regressors, where no robust loss bounds a spike.
const SPIKED: [&str; 2] = ["q_*", "qd_*"];

const PARTS: [(&str, &str); 3] = [("stiffness", "N.m/rad"), ("damping", "N.m.s/rad"), ("rest", "rad")];
/// Largest standard deviation of the torques, as a share of their own spread, that is still informative. The spread contains
/// the noise itself and what errors of the sensors make of a torque that hardly any sensor tells: hips and knees without foot
/// wrenches have 0.74 to 0.92 on the built-in plant, less where the sensors are wrong; joints that sensors tell, below 0.2.
const BLUR: f64 = 0.25;
/// Samples of which one is looked at where only differences between fits are looked for.
const COARSE: usize = 8;
/// Time over which the errors of the torques are correlated, s.
const CLUSTER: f64 = 0.25;

/// Time by which forces are taken earlier to see what a delay does, s.
const EARLIER: f64 = 0.02;
/// Standard errors by which a delay must be beyond what good sensors have.
const SURE: f64 = 4.0;
/// The torques are estimates, which smooth what acts on them: by so much a delay that they show may be off, s (on the own
/// plant 6 to 9 ms).
const ESTIMATED: f64 = 0.01;
/// Times that forces are taken earlier by what was found.
const CLOSER: usize = 4;

/// The joints of the logs: those of the seated body, or whatever has a torque of its own.
fn joints(logs: &[Log]) -> Vec<String> {
    let has = |name: &str| logs.iter().any(|log| log.channel(name).is_some());
    let own = logs.first().into_iter().flat_map(|log| &log.channels).filter_map(|channel| {
        let joint = channel.name.strip_prefix("q_")?;
        has(&format!("tau_{joint}")).then(|| joint.to_owned())
    });
    let own: Vec<String> = own.collect();
    if own.is_empty() { JOINTS.iter().map(|(name, ..)| (*name).to_owned()).collect() } else { own }
}

fn targets(logs: &[Log]) -> Vec<Target> {
    let one = |joint: &String, (part, unit): (&str, &str)| {
        let range = if part == "rest" { (-10.0, 10.0) } else { (0.0, 1e5) };
        Target {
            name: format!("{part}.{joint}"),
            unit: unit.to_owned(),
            range,
            usual: true,
            optional: true,
            contested: false,
        }
    };
    joints(logs).iter().flat_map(|joint| PARTS.map(|part| one(joint, part))).collect()
}

/// One joint over one log.
struct Joint<'a> {
    q: &'a [f64],
    qd: &'a [f64],
    tau: Vec<f64>,
    std: Vec<f64>,
}

/// Per joint, in the order of [`JOINTS`], a series over one log.
type Series = Vec<Vec<f64>>;

/// Torques and their standard deviations of one log, NaN except at `every` so many samples.
fn torques(log: &Log, known: &Known, every: usize, progress: &Progress) -> Result<(Series, Series), FitError> {
    let mut parameters: Parameters = known.parameters();
    let inputs = Inputs::declare();
    // a group of sensors is used if the log has all its columns, unless the user said otherwise
    for group in GROUPS {
        let name = format!("use.{group}");
        if !known.is_set(&name) {
            let there = columns_of(group, &inputs).all(|column| log.channel(column).is_some());
            parameters.set(&name, f64::from(u8::from(there)))?;
        }
    }
    // The regression weighs samples by their noise; errors of the body are the same in all of them.
    for variable in ScatterParameters::declare() {
        let name = format!("scatter.{}", variable.name);
        if !known.is_set(&name) {
            parameters.set(&name, 0.0)?;
        }
    }
    if !known.is_set("delay_std") {
        parameters.set("delay_std", 0.0)?;
    }
    if let [first, second, ..] = log.time.as_slice()
        && !known.is_set("sample_period")
    {
        parameters.set("sample_period", (second - first).clamp(1e-4, 1.0))?;
    }
    for (name, ..) in JOINTS {
        log.require(&format!("q_{name}"))?;
        if !parameters.differentiate {
            log.require(&format!("qd_{name}"))?;
        }
    }
    let channels: Vec<Option<&[f64]>> = inputs.iter().map(|input| log.channel(&input.name)).collect();
    let mut estimator = HumanDynamics::new(&parameters)?;
    // without a gyroscope the seat is taken not to turn
    let mut sample = Inputs { base_gyro: [0.0; 3], ..Inputs::default() };
    let mut flat = sample.to_vec();
    let mut outputs = Outputs::default();
    let empty = || vec![Vec::with_capacity(log.len()); JOINTS.len()];
    let (mut tau, mut std) = (empty(), empty());
    for row in 0..log.len() {
        if row % 1000 == 0 {
            progress.check()?;
            progress.reach(row as f64 / log.len() as f64);
        }
        if row % every != 0 {
            tau.iter_mut().chain(&mut std).for_each(|series| series.push(f64::NAN));
            continue;
        }
        for (slot, channel) in flat.iter_mut().zip(&channels) {
            *slot = channel.map_or(*slot, |values| values[row]);
        }
        sample.read(&flat);
        let dt = if row == 0 { parameters.sample_period } else { log.time[row] - log.time[row - every] };
        let status = estimator.step(&sample, dt);
        estimator.outputs(&sample, 0.0, &mut outputs);
        let known = !status.contains(Status::SKIPPED);
        for joint in 0..JOINTS.len() {
            tau[joint].push(if known { outputs.tau[joint].value } else { f64::NAN });
            std[joint].push(if known { outputs.tau[joint].std } else { f64::NAN });
        }
    }
    Ok((tau, std))
}

/// The inputs of a group of sensors.
fn columns_of<'a>(group: &'a str, inputs: &'a [Variable]) -> impl Iterator<Item = &'a str> {
    inputs.iter().map(|input| input.name.as_str()).filter(move |name| match group {
        "joint_acceleration" => name.starts_with("qdd_"),
        "base_acceleration" => name.starts_with("base_accel_") || name.starts_with("base_angular_accel_"),
        "seat_wrench" => name.starts_with("seat_"),
        "imu" => name.starts_with("imu_"),
        "hand_wrench" => name.contains("_hand_"),
        _ => name.contains("_foot_"),
    })
}

/// All joints of all logs: per joint its logs.
fn collect<'a>(task: &Task<'a>) -> Result<Vec<(String, Vec<Joint<'a>>)>, FitError> {
    let names = joints(task.logs);
    let mut all: Vec<(String, Vec<Joint>)> = names.iter().map(|name| (name.clone(), vec![])).collect();
    for (index, log) in task.logs.iter().enumerate() {
        let own = names.iter().all(|name| log.channel(&format!("tau_{name}")).is_some());
        let estimated = if own {
            None
        } else {
            Some(torques(
                log,
                task.known,
                if task.coarse { COARSE } else { 1 },
                &task.progress.piece(index, task.logs.len()),
            )?)
        };
        for (k, (name, list)) in all.iter_mut().enumerate() {
            let (mut tau, std) = match &estimated {
                Some((tau, std)) => (tau[k].clone(), std[k].clone()),
                None => {
                    let zero = vec![0.0; log.len()];
                    let std = log.channel(&format!("tau_{name}_std")).map_or(zero, <[f64]>::to_vec);
                    (log.require(&format!("tau_{name}"))?.to_vec(), std)
                }
            };
            // One-sided spikes of any sensor would pull the robust fit, too: a percent of each of a dozen channels is a tenth of
            // the torques.
            if !task.coarse {
                hampel(&mut tau, log.period());
            }
            list.push(Joint {
                q: log.require(&format!("q_{name}"))?,
                qd: log.require(&format!("qd_{name}"))?,
                tau,
                std,
            });
        }
    }
    Ok(all)
}

fn spread(values: &[f64]) -> f64 {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let n = finite.len().max(1) as f64;
    let mean = finite.iter().sum::<f64>() / n;
    (finite.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    if !task.coarse {
        late_hands(task, session)?;
    }
    for (name, logs) in collect(task)? {
        let parameters = PARTS.map(|(part, _)| format!("{part}.{name}"));
        let parameters: [&str; 3] = std::array::from_fn(|k| parameters[k].as_str());
        if task.wanted_of(&parameters).is_empty() {
            continue;
        }
        let tau: Vec<f64> = logs.iter().flat_map(|joint| joint.tau.iter().copied()).collect();
        let mut std: Vec<f64> = logs.iter().flat_map(|j| j.std.iter().copied()).filter(|s| s.is_finite()).collect();
        std.sort_by(f64::total_cmp);
        let typical = std.get(std.len() / 2).copied().unwrap_or(0.0);
        if typical > BLUR * spread(&tau) {
            let why = format!(
                "the sensors leave its torque uncertain by {typical:.2} N.m while it varies by only {:.2} N.m \
                 (hand and foot wrenches make arms and legs observable)",
                spread(&tau)
            );
            parameters.iter().for_each(|parameter| session.give_up(parameter, &why));
            continue;
        }
        let rows = rows(task, &logs);
        let unknowns = vec![Unknown::within("k", 0.0, 1e5), Unknown::within("d", 0.0, 1e5), Unknown::free("k rest")];
        let regression =
            Regression { name: format!("torque of {name}"), unknowns, groups: vec![rows], constraints: vec![] };
        if let Some(fit) = session.solve(&regression, &parameters)? {
            session.estimate(parameters[0], fit, |x| x[0]);
            session.estimate(parameters[1], fit, |x| x[1]);
            // an angle may well be zero: it is judged by its absolute error
            let limits = Limits { absolute_error: Some(0.05), ..Limits::default() };
            session.estimate_judged(parameters[2], fit, Judgement { limits, ..Judgement::default() }, |x| x[2] / x[0]);
        }
    }
    Ok(())
}

/// How late forces are, by the torques of the joints that they reach.
struct Lateness {
    /// s
    delay: f64,
    /// Its standard error, s.
    std: f64,
    /// Joints that show one by themselves.
    joints: usize,
}

/// Warns of forces on the hands that arrive late. Those on the feet hardly change while one sits: their torques tell no delay.
fn late_hands(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let inputs = Inputs::declare();
    let own: Vec<&str> = columns_of("hand_wrench", &inputs).collect();
    let torques_given = |log: &Log| log.channels.iter().any(|channel| channel.name.starts_with("tau_"));
    let measured = |log: &&Log| own.iter().all(|name| log.channel(name).is_some()) && !torques_given(log);
    let logs: Vec<&Log> = task.logs.iter().filter(measured).collect();
    let Some(first) = lateness(task, &logs, &own, 0.0, session.loss())? else { return Ok(()) };
    if first.joints < 2 || first.delay.abs() - SURE * first.std <= HARMLESS {
        return Ok(());
    }
    // To first order only: the rest is found with the forces taken earlier by what was found.
    let (mut delay, mut std) = (first.delay, first.std);
    for _ in 0..CLOSER {
        let Some(rest) = lateness(task, &logs, &own, delay, session.loss())? else { break };
        delay += rest.delay;
        std = rest.std;
        if rest.delay.abs() < std {
            break;
        }
    }
    let (hands, motion) = ("the forces on the hands", "the motion");
    let (late, early) = if delay > 0.0 { (hands, motion) } else { (motion, hands) };
    session.warn(format!(
        "{late} arrive about {:.0} ms (+-{:.0}) later than {early}, by the torques of {} joints; give both one clock, or shift them \
         back before the fit",
        1e3 * delay.abs(),
        2e3 * std.hypot(ESTIMATED),
        first.joints
    ));
    Ok(())
}

/// How late forces are beyond a time by which they are taken earlier, s; none if no torque tells.
fn lateness(task: &Task, logs: &[&Log], own: &[&str], by: f64, loss: Loss) -> Result<Option<Lateness>, FitError> {
    let mut of_joint: Vec<Rows> = JOINTS.iter().map(|(name, ..)| Rows::new(name, "N.m", 4)).collect();
    let mut first = 0;
    for log in logs {
        let samples = |time: f64| (time / log.period()).round() as isize;
        let (base, ahead) = (samples(by), samples(by) + samples(EARLIER).max(1));
        let step = (ahead - base) as f64 * log.period();
        let torques = |samples| torques(&earlier(log, own, samples), task.known, COARSE, &Progress::none());
        let ((tau, _), (ahead, _)) = (torques(base)?, torques(ahead)?);
        let begin = log.time.first().copied().unwrap_or(0.0);
        let cluster = |k: usize| first + ((log.time[k] - begin) / CLUSTER) as u32;
        for (joint, rows) in of_joint.iter_mut().enumerate() {
            let channel = |part: &str| log.channel(&format!("{part}_{}", JOINTS[joint].0));
            let (Some(q), Some(qd)) = (channel("q"), channel("qd")) else { continue };
            for k in 0..log.len() {
                let change = (ahead[joint][k] - tau[joint][k]) / step;
                rows.push(&[-q[k], -qd[k], 1.0, -change], tau[joint][k], cluster(k));
            }
        }
        first = cluster(log.len() - 1) + 1;
    }
    let mut answer = Lateness { delay: 0.0, std: f64::INFINITY, joints: 0 };
    let mut weights = 0.0;
    for rows in of_joint {
        let positive = |name: &str| Unknown::within(name, 0.0, 1e5);
        let unknowns = vec![positive("k"), positive("d"), Unknown::free("k rest"), Unknown::free("delay")];
        let regression = Regression { name: "delay".to_owned(), unknowns, groups: vec![rows], constraints: vec![] };
        // A joint that the force does not reach says nothing.
        let Ok(solution) = solve(&regression, &Options { loss, ..Options::default() }) else { continue };
        let (delay, std) = (solution.theta[3], solution.std(3) * student(solution.degrees_of_freedom));
        if std > 0.0 && std.is_finite() {
            answer.delay += delay / (std * std);
            weights += 1.0 / (std * std);
            // The joints share their sensors' noise: together they are hardly more certain than the best of them.
            answer.std = answer.std.min(std);
            answer.joints += usize::from(delay.abs() - 2.0 * std > HARMLESS);
        }
    }
    answer.delay /= weights;
    Ok((weights > 0.0).then_some(answer))
}

/// A log with some channels so many samples earlier, without the references that no fit looks at.
fn earlier(log: &Log, names: &[&str], samples: isize) -> Log {
    let moved = |channel: &Channel| {
        let values = &channel.values;
        let last = values.len() - 1;
        let at = |k: usize| values[k.saturating_add_signed(samples).min(last)];
        let late = names.contains(&channel.name.as_str());
        Channel {
            name: channel.name.clone(),
            values: if late { (0..values.len()).map(at).collect() } else { values.clone() },
        }
    };
    let measured = log.channels.iter().filter(|channel| !channel.name.starts_with("true_"));
    Log {
        channels: measured.map(moved).collect(),
        time: log.time.clone(),
        source: log.source.clone(),
        ..Log::default()
    }
}

/// `tau = [-q, -qd, 1] [k, d, k rest]`, a row per sample.
fn rows(task: &Task, logs: &[Joint]) -> Rows {
    let mut rows = Rows::new("joint torque", "N.m", 3);
    let mut first = 0;
    let (mut of_q, mut of_qd) = (0.0_f64, 0.0_f64);
    for (joint, log) in logs.iter().zip(task.logs) {
        let begin = log.time.first().copied().unwrap_or(0.0);
        let mut last = first;
        for (k, &tau) in joint.tau.iter().enumerate() {
            last = first + ((log.time[k] - begin) / CLUSTER) as u32;
            rows.push(&[-joint.q[k], -joint.qd[k], 1.0], tau, last);
        }
        first = last + 1;
        of_q = of_q.max(noise_of(joint.q));
        of_qd = of_qd.max(noise_of(joint.qd));
    }
    let mut covariance = vec![0.0; 16];
    covariance[0] = of_q * of_q;
    covariance[5] = of_qd * of_qd;
    rows.noise = covariance;
    rows
}

fn validate(task: &Task) -> Vec<Prediction> {
    let Ok(all) = collect(task) else { return vec![] };
    let mut predictions = vec![];
    for (name, logs) in &all {
        let found = PARTS.map(|(part, _)| task.known.find(&format!("{part}.{name}")));
        let [Some(stiffness), Some(damping), Some(rest)] = found else { continue };
        for (joint, log) in logs.iter().zip(task.logs) {
            let model = joint.q.iter().zip(joint.qd).map(|(q, qd)| -stiffness * (q - rest) - damping * qd).collect();
            let step = log.time.get(1).map_or(CLUSTER, |t| t - log.time[0]);
            let trace = Trace {
                name: format!("tau_{name}"),
                unit: "N.m".to_owned(),
                log: log.source.clone(),
                time: log.time.to_vec(),
                measured: joint.tau.clone(),
                predicted: model,
            };
            predictions.push(Prediction::new(trace, (CLUSTER / step).round().max(1.0) as usize));
        }
    }
    predictions
}
