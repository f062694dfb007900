//! Stage 2: slip stiffness and centre of gravity from the torque at the slip.

use super::sample::{Balance, Machine, Run, SHARE_APART};
use crate::log::Log;
use crate::problem::{FitError, Fitted, Known, Session};
use crate::solve::{Affine, Constraint, Regression, Rows, Unknown};

/// Slowest speed, m/s, and largest slip of the samples of stage 2.
const SLOWEST: f64 = 0.8;
const LARGEST_SLIP: f64 = 0.15;
/// Linearisations of the columns of radii and delays in stage 2.
const PASSES: usize = 3;
/// Number of unknowns of stage 2 before the logs' delays.
pub(super) const SHARED: usize = 5;
/// Relative standard deviation of a radius that is not to move.
pub(super) const FIXED: f64 = 1e-7;

/// What is known of the rolling radii beforehand: values, and relative standard deviations.
pub(super) struct Radii {
    pub given: [f64; 2],
    pub std: [f64; 2],
}

/// Stage 2 over some logs.
pub(super) struct Slip<'a> {
    pub logs: &'a [Run],
    pub names: &'a [&'a str],
    /// One of so many samples is used.
    pub stride: usize,
}

impl Slip<'_> {
    /// Solves stage 2 and leaves its answer in the machine for the next linearisation.
    pub fn fit(
        &self,
        machine: &mut Machine,
        radii: &Radii,
        height: Option<(f64, f64)>,
        session: &mut Session,
    ) -> Result<Option<Fitted>, FitError> {
        let mut fit = None;
        for _ in 0..PASSES {
            let before = [machine.late.clone(), machine.apart.clone()];
            fit = session.solve(&slip_balance(self.logs, machine, radii, height, true, self.stride), self.names)?;
            let Some(found) = fit else { break };
            let theta = &session.solution(found).theta;
            machine.unknowns = [theta[0], theta[1] / theta[0], theta[2] / theta[0]];
            let after = |before: &[f64], x: &[f64]| before.iter().zip(x).map(|(late, x)| late + x / theta[0]).collect();
            machine.late = after(&before[0], &theta[SHARED..]);
            machine.apart = after(&before[1], &theta[SHARED + self.logs.len()..]);
        }
        Ok(fit)
    }
}

/// Stage 2: torque as a function of slip and load, unknowns `(K, K lambda, K h, eta_f, eta_r, K tau of each log,
/// K tau_fr of each log)`, from one of `stride` samples.
fn slip_balance(
    logs: &[Run],
    machine: &Machine,
    radii: &Radii,
    height: Option<(f64, f64)>,
    instrumented: bool,
    stride: usize,
) -> Regression {
    let [stiffness, lambda, given_height] = machine.unknowns;
    let columns = SHARED + 2 * logs.len();
    let mut rows = Rows::new("slip", "N.m", columns);
    let mut noise = vec![0.0; (columns + 1) * (columns + 1)];
    let (mut row, mut instruments) = (vec![0.0; columns], vec![0.0; columns]);
    let mut first = 0;
    for (index, run) in logs.iter().enumerate() {
        row.fill(0.0);
        instruments.fill(0.0);
        let late = [0, 1].map(|axle| machine.late_against(index, axle));
        for (k, sample) in run.samples.iter().enumerate().step_by(stride) {
            let speed = sample.smooth;
            if speed <= SLOWEST || speed.is_nan() {
                continue;
            }
            let Balance { load_row, traction, rate } = sample.balance(machine);
            for axle in 0..2 {
                let radius = machine.radius[axle];
                let slipping = radius * sample.wheel[axle] - run.speed(k, late[axle]);
                if slipping.abs() >= LARGEST_SLIP * speed || slipping.is_nan() {
                    continue;
                }
                let (g, traction) = (load_row[axle], traction[axle]);
                let load = g[0] + g[1] * lambda + g[2] * given_height;
                // Times the speed: the noise of the slip speed is the same at every speed.
                let fill = |row: &mut [f64], slipping: f64| {
                    for (cell, g) in row.iter_mut().zip(g) {
                        *cell = radius * slipping * g;
                    }
                    row[3 + axle] = speed * radius * load;
                    row[4 - axle] = 0.0;
                    row[SHARED + index] = -rate * radius * load;
                    row[SHARED + logs.len() + index] = -SHARE_APART[axle] * rate * radius * load;
                };
                fill(&mut row, slipping);
                let id = first + run.cluster(k + 1);
                if instrumented {
                    fill(&mut instruments, speed * traction / (radius * stiffness * load));
                    rows.push_instrumented(&row, speed * traction, &instruments, id);
                } else if rows.push(&row, speed * traction, id) {
                    // What the sensors' noise alone puts into the row.
                    let sensors = machine.noise[0].powi(2) + (radius * machine.noise[1]).powi(2);
                    for (j, k) in (0..9).map(|n| (n / 3, n % 3)) {
                        noise[j * (columns + 1) + k] += radius * radius * sensors * g[j] * g[k];
                    }
                }
            }
        }
        first += run.cluster(run.samples.len()) + 1;
    }
    if !instrumented && !rows.is_empty() {
        rows.noise = noise.iter().map(|sum| sum / rows.len() as f64).collect();
    }
    let (unknowns, constraints) = unknowns(machine, radii, height);
    Regression { name: "slip and load".to_owned(), unknowns, groups: vec![rows], constraints }
}

/// The unknowns of stage 2 with what is known of them, and the ranges of share and height.
fn unknowns(machine: &Machine, radii: &Radii, height: Option<(f64, f64)>) -> (Vec<Unknown>, Vec<Constraint>) {
    let stiffness = machine.unknowns[0];
    let delay = |name: &str, late: f64, std: f64| {
        let std = std.max(late.abs()).max(FIXED);
        Unknown::free(name).with_prior(-stiffness * late, stiffness * std)
    };
    let eta = |axle: usize| {
        let (given, std) = ((radii.given[axle] / machine.radius[axle]).ln(), radii.std[axle]);
        Unknown::free(if axle == 0 { "eta_f" } else { "eta_r" }).with_prior(stiffness * given, stiffness * std)
    };
    let between = |index: usize, low: f64, high: f64| {
        [
            Constraint::NonNegative(Affine::new(&[(index, 1.0), (0, -low)], 0.0)),
            Constraint::NonNegative(Affine::new(&[(index, -1.0), (0, high)], 0.0)),
        ]
    };
    let mut constraints = between(1, 0.1, 0.9).to_vec();
    constraints.extend(between(2, 0.3, 2.5));
    let mut unknowns = vec![
        Unknown::within("K", 2.0, 80.0),
        Unknown::free("K lambda"),
        match height {
            Some((mean, std)) => Unknown::free("K h").with_prior(stiffness * mean, stiffness * std),
            None => Unknown::free("K h"),
        },
        eta(0),
        eta(1),
    ];
    unknowns.extend(machine.late.iter().map(|late| delay("K tau", *late, machine.late_std)));
    unknowns.extend(machine.apart.iter().map(|late| delay("K tau_fr", *late, machine.apart_std)));
    (unknowns, constraints)
}

/// The regression of stage 2 with the known radii, by instruments or by plain least squares: for
/// comparisons.
pub fn slip_regression(log: &Log, known: &Known, instrumented: bool) -> Result<Regression, FitError> {
    let machine = Machine::new(known, 1);
    let radii = Radii { given: machine.radius, std: [FIXED; 2] };
    Ok(slip_balance(&[Run::new(log, &machine)?], &machine, &radii, None, instrumented, 1))
}
