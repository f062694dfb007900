//! Maximum a posteriori estimation over whole logs, for any tree of bodies.
//!
//! ```text
//! URDF -> urdf.rs ----\
//! sensors.toml -> config.rs -> WholeBody --- log rows ---> result columns
//! ```

pub mod bench;
pub mod config;
pub mod gyroscope;
pub mod urdf;

use crate::log::{Log, LogError, Series};
use crate::progress::Progress;
use config::{Setup, Source};
use std::path::Path;
use wheelstate::Status;
use wheelstate::estimator::human_dynamics::whole_body::Posture;
use wheelstate::model::multibody::equations::Kind;

/// An estimation that was refused.
#[derive(Debug, thiserror::Error)]
pub enum EstimateError {
    /// Something is wrong with the model or the sensors.
    #[error("{file}: {what}")]
    File {
        /// Path of the file.
        file: String,
        /// What is wrong and what is expected.
        what: String,
    },
    /// Something is wrong with the log.
    #[error(transparent)]
    Log(#[from] LogError),
}

impl EstimateError {
    pub(crate) fn new(file: &str, what: impl Into<String>) -> Self {
        Self::File { file: file.to_owned(), what: what.into() }
    }
}

/// Reads a URDF and a sensors file.
pub fn setup(model: &Path, sensors: &Path) -> Result<Setup, EstimateError> {
    let description = urdf::read(model)?;
    config::read(&description, model, sensors)
}

/// Estimates every row of a log: per joint `tau_<joint>` and `tau_<joint>_std`, for a moving base
/// the seat's wrench with standard deviations that contain the errors of the body, per channel of a gyroscope `innovation_<column>`, and
/// per row `nis`, `nis_channels` and `status`. A row without a whole posture, and one that could not
/// be solved, has no estimates (NaN).
pub fn run(setup: &mut Setup, log: &Log, progress: &Progress) -> Result<Log, EstimateError> {
    let joints = setup.body.equations().tree().dof_names.clone();
    let column = |stem: &str, name: &str| log.require(&format!("{stem}{name}"));
    let q = joints.iter().map(|j| column("q_", j)).collect::<Result<Vec<_>, _>>()?;
    let qd = joints.iter().map(|j| column("qd_", j)).collect::<Result<Vec<_>, _>>()?;
    let axes: &[&str] = if setup.moving { &["x", "y", "z"] } else { &[] };
    let rates = axes.iter().map(|axis| column("base_gyro_", axis)).collect::<Result<Vec<_>, _>>()?;
    let samples = channels(setup, log)?;
    let gyroscopes = gyroscope::all(setup);

    let torque: Vec<usize> = (0..joints.len()).map(|dof| setup.body.torque_slot(dof)).collect();
    let base = setup.body.equations().slots()[0].map(|slots| slots.range(Kind::ParentWrench));
    let base_slots: Vec<usize> = base.into_iter().flatten().collect();
    let mut considered = vec![0.0; joints.len() + 6];
    let mut columns = Columns::new(log.len());
    let (mut posture_q, mut posture_qd) = (vec![0.0; joints.len()], vec![0.0; joints.len()]);
    let mut values = vec![0.0; samples.len()];
    progress.start("estimating", log.len() as u64);
    for row in 0..log.len() {
        progress.check().map_err(LogError::from)?;
        for (slot, channel) in posture_q.iter_mut().zip(&q) {
            *slot = channel[row];
        }
        for (slot, channel) in posture_qd.iter_mut().zip(&qd) {
            *slot = channel[row];
        }
        for (slot, sample) in values.iter_mut().zip(&samples) {
            *slot = sample.at(row);
        }
        let mut base_rate = [0.0; 3];
        for (slot, channel) in base_rate.iter_mut().zip(&rates) {
            *slot = channel[row];
        }
        let posture = Posture { q: &posture_q, qd: &posture_qd, base_rate };
        let status = setup.body.step(&posture, &values, true);
        let known = status.is_ok();
        if known {
            considered.copy_from_slice(setup.body.scattered());
        }
        let (mean, variance) = (setup.body.mean(), setup.body.variance());
        for (&slot, considered) in torque.iter().chain(&base_slots).zip(&considered) {
            let estimate = (mean[slot], (variance[slot] + considered).sqrt());
            columns.push(if known { estimate } else { (f64::NAN, f64::NAN) });
        }
        for gyroscope in &gyroscopes {
            let innovation = gyroscope.innovation(&setup.body, &values);
            innovation.into_iter().for_each(|v| columns.innovations.push(if known { v } else { f64::NAN }));
        }
        let innovations = setup.body.innovations(|_| true);
        let nis = if known { (innovations.nis, innovations.rows) } else { (f64::NAN, 0) };
        columns.end_row(nis, status.unwrap_or(Status::SKIPPED));
        progress.advance(1);
    }
    progress.finish();
    let wrench = ["force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"];
    let names = joints.iter().map(|j| format!("tau_{j}"));
    let names = names.chain(wrench.iter().take(base_slots.len()).map(|part| format!("seat_wrench_{part}")));
    let gyro_names: Vec<String> = gyroscopes.iter().flat_map(|g| g.names.clone()).collect();
    Ok(columns.into_log(names.collect(), &gyro_names, log))
}

/// One sample of one row of a sensor.
enum Sample<'a> {
    Channel(&'a [f64]),
    Value(f64),
}

impl Sample<'_> {
    fn at(&self, row: usize) -> f64 {
        match self {
            Self::Channel(values) => values[row],
            Self::Value(value) => *value,
        }
    }
}

fn channels<'a>(setup: &Setup, log: &'a Log) -> Result<Vec<Sample<'a>>, EstimateError> {
    let mut samples = vec![];
    for (sensor, source) in setup.body.equations().sensors().iter().zip(&setup.sources) {
        match source {
            Source::Value(value) => samples.extend((0..sensor.quantity.rows()).map(|_| Sample::Value(*value))),
            Source::Columns(columns) => {
                for column in columns {
                    samples.push(Sample::Channel(log.require(column)?));
                }
            }
        }
    }
    Ok(samples)
}

/// Estimates row by row.
struct Columns {
    rows: usize,
    width: usize,
    estimates: Vec<(f64, f64)>,
    innovations: Vec<f64>,
    nis: Vec<f64>,
    channels: Vec<f64>,
    status: Vec<f64>,
}

impl Columns {
    fn new(rows: usize) -> Self {
        Self { rows, width: 0, estimates: vec![], innovations: vec![], nis: vec![], channels: vec![], status: vec![] }
    }

    fn push(&mut self, estimate: (f64, f64)) {
        self.estimates.push(estimate);
    }

    fn end_row(&mut self, (nis, channels): (f64, usize), status: Status) {
        self.nis.push(nis);
        self.channels.push(channels as f64);
        self.status.push(f64::from(status.bits()));
        self.width = self.estimates.len() / self.status.len();
    }

    fn into_log(self, names: Vec<String>, gyroscopes: &[String], log: &Log) -> Log {
        let mut result = Log { source: log.source.clone(), time: log.time.clone(), ..Log::default() };
        let column = |k: usize| (0..self.rows).map(move |row| row * self.width + k);
        for (k, name) in names.iter().enumerate() {
            result.push(name, column(k).map(|i| self.estimates[i].0).collect::<Series>());
            result.push(&format!("{name}_std"), column(k).map(|i| self.estimates[i].1).collect::<Series>());
        }
        for (k, name) in gyroscopes.iter().enumerate() {
            let innovations = self.innovations.iter().copied().skip(k).step_by(gyroscopes.len());
            result.push(name, innovations.collect::<Series>());
        }
        result.push("nis", self.nis);
        result.push("nis_channels", self.channels);
        result.push("status", self.status);
        result
    }
}
