//! The check of gyroscopes: a gyroscope measures no unknown of the estimation, since the posture and
//! its rates are taken as exact, so its reading can only be compared with the rate that these give.

use super::config::{Setup, Source};
use crate::log::Log;
use wheelstate::estimator::human_dynamics::whole_body::WholeBody;
use wheelstate::model::multibody::sensors::{Noise, Quantity};

/// Root mean square of the normalised innovations above which a gyroscope and the posture's rates
/// contradict each other.
const CONSISTENT: f64 = 3.0;

/// A gyroscope of the sensors file that is read from columns.
#[derive(Clone, Debug)]
pub struct Gyroscope {
    /// Number of the sensor.
    sensor: usize,
    /// Place of its first sample.
    start: usize,
    /// Names of its innovations in the result, axis by axis.
    pub names: Vec<String>,
}

/// The gyroscopes that have columns in the log.
pub fn all(setup: &Setup) -> Vec<Gyroscope> {
    let mut start = 0;
    let mut found = vec![];
    for (sensor, (described, source)) in setup.body.equations().sensors().iter().zip(&setup.sources).enumerate() {
        if let (Quantity::Gyroscope, Source::Columns(columns)) = (described.quantity, source) {
            let names = columns.iter().map(|column| format!("innovation_{column}")).collect();
            found.push(Gyroscope { sensor, start, names });
        }
        start += described.quantity.rows();
    }
    found
}

impl Gyroscope {
    /// Reading minus the angular velocity that the posture of the last step has there, sensor axes,
    /// rad/s; NaN where the sample is missing.
    pub fn innovation(&self, body: &WholeBody, samples: &[f64]) -> [f64; 3] {
        let expected = body.equations().gyroscope(self.sensor);
        std::array::from_fn(|axis| {
            let reading = samples[self.start + axis];
            let innovation = expected.map_or(f64::NAN, |rate| reading - rate[axis]);
            if innovation.is_finite() { innovation } else { f64::NAN }
        })
    }
}

/// How the gyroscopes of a result fit the posture's rates: a line for each, and whether it is a warning.
pub fn report(setup: &Setup, result: &Log) -> Vec<(String, bool)> {
    let lines = all(setup).into_iter().filter_map(|gyroscope| {
        let sensor = &setup.body.equations().sensors()[gyroscope.sensor];
        let variance = |axis: usize| match &sensor.noise {
            Noise::Scalar(variance) => *variance,
            Noise::Diagonal(variances) => variances[axis],
            Noise::Full(covariance) => covariance[4 * axis],
        };
        let (mut squares, mut normalised, mut count) = (0.0, 0.0, 0);
        for (axis, name) in gyroscope.names.iter().enumerate() {
            for value in result.channel(name)?.iter().filter(|value| value.is_finite()) {
                squares += value * value;
                normalised += value * value / variance(axis);
                count += 1;
            }
        }
        let name = &sensor.name;
        if count == 0 {
            return Some((format!("'{name}': no samples to check"), false));
        }
        let [rms, ratio] = [squares, normalised].map(|sum| (sum / f64::from(count)).sqrt());
        let warns = ratio > CONSISTENT;
        let verdict = if warns { "contradicts the rates of the joints" } else { "agrees with the rates of the joints" };
        Some((format!("'{name}': {verdict}, innovation {rms:.3} rad/s rms, {ratio:.1} standard deviations"), warns))
    });
    lines.collect()
}
