//! Noise of the measurements, which follows the road: tyres that bounce.

use super::parameters::{Adaptation, Parameters};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::srukf::Noise;
use crate::variable::root_sum_square;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Standard deviations of speed and wheel speeds, raised where the slip innovations of the last second show more noise,
/// or slower noise, than the settings expect.
#[derive(Clone, Debug)]
pub struct SensorNoise {
    given: Vector3<f64>,
    radius: [f64; 2],
    /// `None`: the noise is as given.
    adaptation: Option<(Adaptation, Fading)>,
}

impl SensorNoise {
    /// From the parameters.
    pub fn new(p: &Parameters) -> Self {
        let (std, adaptation) = (&p.filter.measurement_std, &p.filter.adaptation);
        let adapts = p.filter.supervise && adaptation.enabled;
        Self {
            given: Vector3::new(std.speed, std.wheel_speed, std.wheel_speed),
            radius: p.loader.wheel_radius(),
            adaptation: adapts.then(|| (adaptation.clone(), Fading::new(adaptation, p.sample_period))),
        }
    }

    /// Standard deviations of the wheel speeds as given, with what a bend adds to the front one, rad/s.
    pub fn wheel_std(&self, path_std: f64) -> [f64; 2] {
        [root_sum_square([self.given[1], path_std]), self.given[2]]
    }

    /// The present noise level, and with it the weight of each sample: one with a large innovation counts less (Huber).
    /// The speed is as noisy as the worse of the axles; `path_std` is what a bend adds to the front wheel speed, rad/s.
    pub fn follow<const N: usize>(
        &self,
        predicted: &FactoredGaussian<N>,
        (y, path_std): (&Vector3<f64>, f64),
        dt: f64,
        roughness: &mut [Roughness; 2],
    ) -> Noise<3> {
        let mut given = self.given;
        if path_std > 0.0 {
            given[1] = root_sum_square([given[1], path_std]);
        }
        let Some((adaptation, usual)) = &self.adaptation else {
            return Noise { level: given, weighted: given };
        };
        let (mut level, mut weighted) = (given, given);
        let fading = if dt == usual.dt { *usual } else { Fading::new(adaptation, dt) };
        let mut common = (1.0_f64, 1.0_f64);
        for i in 0..2 {
            let r = self.radius[i];
            let e = r * (y[i + 1] - predicted.mean[i + 1]) - (y[0] - predicted.mean[0]);
            let sensors = (r * given[i + 1]).powi(2) + given[0].powi(2);
            let mut belief = 0.0;
            for j in 0..=i + 1 {
                belief += (r * predicted.factor[(i + 1, j)] - predicted.factor[(0, j)]).powi(2);
            }
            // Without a sample the road is as rough as it was.
            if e.is_finite() {
                roughness[i].update(e, sensors, belief, adaptation, &fading);
            }
            let ratio = roughness[i].ratio(adaptation);
            let size = e.abs() / (adaptation.huber * (sensors * ratio * ratio + belief).sqrt());
            // max ignores a size that is NaN
            let weighted_ratio = ratio * size.max(1.0);
            level[i + 1] *= ratio;
            weighted[i + 1] *= weighted_ratio;
            common = (common.0.max(ratio), common.1.max(weighted_ratio));
        }
        level[0] *= common.0;
        weighted[0] *= common.1;
        Noise { level, weighted }
    }
}

/// Noise of one axle's slip innovation relative to what the settings expect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Roughness {
    smooth: f64,
    excess: f64,
}

/// What a sample contributes to the averages of [`Roughness`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fading {
    /// The time between two samples, s.
    dt: f64,
    smoothing: f64,
    memory: f64,
}

impl Fading {
    /// For samples `dt` seconds apart.
    fn new(adaptation: &Adaptation, dt: f64) -> Self {
        let share = |time: f64| 1.0 - (-dt / time).exp();
        Self { dt, smoothing: share(adaptation.smoothing), memory: share(adaptation.memory) }
    }
}

impl Roughness {
    /// Follows the slip innovation `e` (m/s) with its variance by the sensors and by the belief.
    fn update(&mut self, e: f64, sensors: f64, belief: f64, adaptation: &Adaptation, fading: &Fading) {
        let (a, b) = (fading.smoothing, fading.memory);
        self.smooth += a * (e - self.smooth);
        let white = a / (2.0 - a) * sensors;
        let ratio = (self.smooth * self.smooth - belief) / white;
        let cap = adaptation.limit * adaptation.limit;
        self.excess += b * (ratio.clamp(0.0, 10.0 * cap) - self.excess);
    }

    /// Ratio by which the noise's standard deviation is raised.
    fn ratio(&self, adaptation: &Adaptation) -> f64 {
        self.excess.clamp(1.0, adaptation.limit * adaptation.limit).sqrt()
    }
}
