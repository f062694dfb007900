//! Many logs on many machines: blocks that travel, and what two fits say of each other.
//!
//! # What a block is
//! A fit goes over the samples several times: Huber's loss and the refinement need residuals of the present solution, the
//! standard error of every sensor's gain, bias and delay comes from fits to samples that are changed accordingly, and the
//! validation predicts signals. No sums over the samples, fewer than the samples themselves, hold all that. A
//! [`Block`] is therefore the samples that the fit reads, without loss, and nothing else, as few bytes as they pack into: a
//! fit to merged blocks is the fit to the logs, to the last bit. What blocks spare is everything before the fit: files
//! are read, mapped, checked and hashed where they lie, and channels that the fit does not read stay there.
//!
//! # Order and repetition
//! [`merge`] sorts by source and hash and takes a block that came twice, because its worker was lost and the work done
//! again, once: the result does not depend on who did what when.

use crate::check::Subject;
use crate::log::Log;
use crate::problem::Known;
use crate::result::{FitReport, Parameter};
use crate::vehicle::Vehicle;
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// What the fit of a machine reads of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// The machine, as on the command line.
    pub vehicle: String,
    /// The log without what the fit does not read.
    pub log: Log,
}

/// Blocks that cannot be merged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// None was given.
    #[error("no block was given")]
    None,
    /// They are of several machines.
    #[error("{source_name}: is a block of {found}, not of {wanted}")]
    OtherMachine {
        /// The log of the block.
        source_name: String,
        /// Its machine.
        found: String,
        /// The machine of the first block.
        wanted: String,
    },
    /// The bytes are no block.
    #[error("{0}")]
    NoBlock(String),
}

const MAGIC: &[u8] = b"wheelstate block 1\n";

impl Block {
    /// Of a log of this machine.
    pub fn new(vehicle: &Vehicle, log: &Log) -> Self {
        let (inputs, known) = (vehicle.inputs(), Known::new(vehicle.parameters()));
        let subject = Subject { inputs: &inputs, known: &known, checks: &vehicle.checks };
        // True values that are constant stand in the report beside the estimates.
        let constant = |name: &str| {
            name.starts_with("true_") && log.channel(name).is_some_and(|v| v.iter().all(|value| *value == v[0]))
        };
        let keep = |name: &str| subject.reads(name) || constant(name);
        Self { vehicle: vehicle.name.to_owned(), log: log.slice(0..log.len(), keep) }
    }

    /// As bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        [MAGIC, self.vehicle.as_bytes(), b"\n", &self.log.to_compact()].concat()
    }

    /// From bytes; `name` is named in errors.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, MergeError> {
        let refuse = |what: &str| MergeError::NoBlock(format!("{name}: {what}"));
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| refuse("these bytes are no block of wheelstate"))?;
        let end = rest.iter().position(|byte| *byte == b'\n').ok_or_else(|| refuse("the block is damaged"))?;
        let vehicle = std::str::from_utf8(&rest[..end]).map_err(|_| refuse("the block is damaged"))?.to_owned();
        let log = Log::from_compact(name, &rest[end + 1..]).map_err(|error| MergeError::NoBlock(error.to_string()))?;
        Ok(Self { vehicle, log })
    }
}

/// The logs of the blocks in the order of their sources, each once.
pub fn merge(blocks: Vec<Block>) -> Result<(String, Vec<Log>), MergeError> {
    let wanted = blocks.first().ok_or(MergeError::None)?.vehicle.clone();
    if let Some(other) = blocks.iter().find(|block| block.vehicle != wanted) {
        let (source_name, found) = (other.log.source.clone(), other.vehicle.clone());
        return Err(MergeError::OtherMachine { source_name, found, wanted });
    }
    let mut logs: Vec<Log> = blocks.into_iter().map(|block| block.log).collect();
    logs.sort_by(|a, b| (&a.source, &a.sha256).cmp(&(&b.source, &b.sha256)));
    logs.dedup_by(|a, b| same_bits(a, b));
    Ok((wanted, logs))
}

/// Whether two logs are one: NaN is a sample like any other here.
fn same_bits(a: &Log, b: &Log) -> bool {
    let bits = |log: &Log| -> Vec<u64> {
        let channels = log.channels.iter().flat_map(|channel| &channel.values);
        log.time.iter().chain(channels).map(|value| value.to_bits()).collect()
    };
    let names = |log: &Log| log.channels.iter().map(|channel| channel.name.clone()).collect::<Vec<_>>();
    (&a.source, &a.sha256) == (&b.source, &b.sha256) && names(a) == names(b) && bits(a) == bits(b)
}

/// What two fits say of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// FMU name.
    pub name: String,
    /// Unit in the FMI spelling.
    pub unit: String,
    /// The second value minus the first.
    pub difference: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Probability of a difference at least as large if both machines are the same.
    pub p: f64,
}

/// Compares the parameters that both fits identified.
///
/// With `same_sensors` what the standard errors hold of sensors and known values counts for both alike and drops out:
/// right for two rides of one machine with its own sensors. Without it every standard error counts in full.
pub fn compare(a: &FitReport, b: &FitReport, same_sensors: bool) -> Result<Vec<Difference>, MergeError> {
    if a.vehicle != b.vehicle {
        let (wanted, found) = (a.vehicle.clone(), b.vehicle.clone());
        return Err(MergeError::OtherMachine { source_name: "the second fit".to_owned(), found, wanted });
    }
    let error = |parameter: &Parameter| if same_sensors { parameter.sampling_std } else { parameter.std_error };
    let pairs =
        a.identified().filter_map(|(name, a)| Some((name, a, b.parameters.get(name).filter(|b| b.identified)?)));
    let differences = pairs.filter_map(|(name, a, b)| {
        let (difference, std) = (b.value - a.value, error(a).hypot(error(b)));
        let known = std.is_finite() && std > 0.0 && difference.is_finite();
        let p = erfc(difference.abs() / std / SQRT_2);
        known.then(|| Difference { name: name.to_owned(), unit: a.unit.clone(), difference, std, p })
    });
    Ok(differences.collect())
}

/// The complementary error function for `x >= 0`, to 1e-13 of its value where it is above 1e-300: the series
/// `erf x = 2/sqrt(pi) exp(-x^2) sum 2^n x^(2n+1) / (2n+1)!!` up to 2, the continued fraction
/// `sqrt(pi) exp(x^2) erfc x = 1/(x + (1/2)/(x + 1/(x + (3/2)/(x + ...))))` beyond (Abramowitz and Stegun 7.1.6, 7.1.14).
fn erfc(x: f64) -> f64 {
    let gauss = (-x * x).exp() / std::f64::consts::PI.sqrt();
    if x < 2.0 {
        let (mut term, mut sum) = (x, x);
        for n in 1..60 {
            term *= 2.0 * x * x / f64::from(2 * n + 1);
            sum += term;
        }
        return 1.0 - 2.0 * gauss * sum;
    }
    gauss / (1..120).rev().fold(x, |below, n| x + 0.5 * f64::from(n) / below)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of a printed table of the complementary error function (Abramowitz and Stegun 7.1 and 7.3).
    #[test]
    fn the_complementary_error_function_is_that_of_the_table() {
        for (x, value) in [
            (0.0, 1.0),
            (0.5, 0.479500122187),
            (1.0, 0.157299207050),
            (2.0, 4.677734981047e-3),
            (3.0, 2.209049699858e-5),
            (5.0, 1.537459794428e-12),
        ] {
            assert!((erfc(x) / value - 1.0).abs() < 1e-10, "{x}: {}", erfc(x));
        }
    }

    fn report(value: f64, std_error: f64) -> FitReport {
        let parameter =
            Parameter { value, std_error, sampling_std: 0.5 * std_error, identified: true, ..Parameter::default() };
        FitReport { parameters: [("robot.mass".to_owned(), parameter)].into(), ..FitReport::default() }
    }

    #[test]
    fn two_standard_deviations_apart_is_one_chance_in_twenty_two() {
        let differences = compare(&report(100.0, 3.0), &report(110.0, 4.0), false).unwrap();
        assert_eq!((differences[0].difference, differences[0].std), (10.0, 5.0));
        assert!((differences[0].p - 0.0455).abs() < 1e-4, "{}", differences[0].p);
        assert!((compare(&report(100.0, 3.0), &report(110.0, 4.0), true).unwrap()[0].p - 6.33e-5).abs() < 1e-6);
    }

    #[test]
    fn blocks_that_come_twice_or_in_another_order_give_the_same_logs() {
        let block = |source: &str| Block {
            vehicle: "wheelchair".to_owned(),
            log: Log { source: source.to_owned(), time: vec![0.0, f64::NAN].into(), ..Log::default() },
        };
        let sources = |blocks| merge(blocks).unwrap().1.into_iter().map(|log| log.source).collect::<Vec<_>>();
        assert_eq!(sources(vec![block("b"), block("a"), block("b")]), ["a", "b"]);
        assert_eq!(merge(Vec::new()), Err(MergeError::None));
    }
}
