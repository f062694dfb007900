//! One sample of the filter: time update, measurement update, limits.

use super::belief::{Belief, STATES, begin_motion};
use super::coordinates::Map;
use super::noise::{Roughness, SensorNoise};
use super::parameters::{Parameters, Radii};
use super::prediction::{Prediction, hold};
use super::supervision::Mode;
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::innovation::{Gate, Innovation};
use crate::filter::square_root::{block, set_block, variances};
use crate::filter::srukf::{self, UpdateForm};
use crate::model::wheel_loader::Drive;
use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};

/// The filter without its memory.
#[derive(Clone, Debug)]
pub struct LoaderFilter {
    /// What its states mean.
    pub map: Map,
    /// Whether the radii are among the states.
    pub radii: bool,
    supervise: bool,
    pub(super) prediction: Prediction,
    /// Noise of the measurements.
    pub noise: SensorNoise,
    gate: Gate,
    form: UpdateForm,
    /// Largest standard deviations of motion and unknowns.
    maximum: SVector<f64, 6>,
    /// Standard deviations of a motion that a sample has just given.
    initial_std: [f64; 3],
}

/// What the filter remembers beside its belief.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Channels {
    /// Rejections in a row of speed and wheel speeds.
    rejections: [u32; 3],
    /// Noise level of each axle.
    pub(super) roughness: [Roughness; 2],
}

impl Channels {
    /// Whether a channel is used that disagrees, because the gate has rejected too many in a row.
    pub fn any_let_through(&self, innovation: &Innovation<3>) -> bool {
        (0..3).any(|i| innovation.used[i] && self.rejections[i] > 0)
    }
}

impl LoaderFilter {
    /// From the parameters.
    pub fn new(p: &Parameters) -> Self {
        let (map, most, initial) = (Map::new(p), &p.filter.maximum_std, &p.initial);
        let unit = map.unit;
        Self {
            radii: p.filter.radii == Radii::Estimated,
            supervise: p.filter.supervise,
            prediction: Prediction::new(p, &map),
            noise: SensorNoise::new(p),
            gate: p.gate(),
            form: p.form(),
            maximum: SVector::from([
                most.speed,
                most.wheel_speed,
                most.wheel_speed,
                most.slip_stiffness * unit[0],
                most.cg_height * unit[1],
                most.cg_ratio * unit[2],
            ]),
            initial_std: [initial.speed_std, initial.wheel_speed_std, initial.wheel_speed_std],
            map,
        }
    }

    /// Restarts the motion from a sample; what this does not give is as uncertain as it may be.
    pub fn begin(&self, belief: &mut Belief, channels: &mut Channels, y: &Vector3<f64>) {
        let radius = self.map.machine.loader.wheel_radius();
        begin_motion(belief, y, radius, self.initial_std, std::array::from_fn(|i| self.maximum[i]));
        channels.rejections = [0; 3];
    }

    /// Takes the sample `y` that comes after `dt` seconds of `drive`, NaN where nothing was measured; what a bend leaves in
    /// the front wheel speed has the standard deviation `path_std`, rad/s. A belief that is
    /// not finite is not taken over and nothing is returned.
    pub fn sample(
        &self,
        belief: &mut Belief,
        channels: &mut Channels,
        mode: Mode,
        drive: &Drive,
        (y, path_std): (&Vector3<f64>, f64),
        dt: f64,
    ) -> Option<Innovation<3>> {
        if self.radii {
            let mut posterior = *belief;
            let innovation = self.sample_states::<STATES, 5>(&mut posterior, channels, mode, drive, (y, path_std), dt);
            *belief = posterior.is_valid().then_some(posterior)?;
            return Some(innovation);
        }
        let mut posterior = FactoredGaussian { mean: block(&belief.mean, 0, 0), factor: block(&belief.factor, 0, 0) };
        let innovation = self.sample_states::<6, 3>(&mut posterior, channels, mode, drive, (y, path_std), dt);
        let posterior = posterior.is_valid().then_some(posterior)?;
        set_block(&mut belief.mean, 0, 0, &posterior.mean);
        set_block(&mut belief.factor, 0, 0, &posterior.factor);
        Some(innovation)
    }

    /// The same for `N` states, of which `K` only walk at random.
    fn sample_states<const N: usize, const K: usize>(
        &self,
        belief: &mut FactoredGaussian<N>,
        channels: &mut Channels,
        mode: Mode,
        drive: &Drive,
        (y, path_std): (&Vector3<f64>, f64),
        dt: f64,
    ) -> Innovation<3> {
        let learn = mode == Mode::Active;
        match mode {
            Mode::Held => hold(belief, dt),
            Mode::Settling | Mode::Active => {
                self.prediction.predict::<N, K>(belief, &self.map, drive, dt, learn);
            }
        }
        let noise = self.noise.follow(belief, (y, path_std), dt, &mut channels.roughness);
        let gate = (self.gate, &mut channels.rejections);
        let considered = std::array::from_fn(|i| i >= 3 && !learn);
        let innovation = srukf::correct(belief, y, &noise, gate, considered, self.form);
        self.limit(belief);
        innovation
    }

    /// Clips direct coordinates and caps the standard deviations.
    fn limit<const N: usize>(&self, belief: &mut FactoredGaussian<N>) {
        let mut theta = Vector3::new(belief.mean[3], belief.mean[4], belief.mean[5]);
        self.map.clip(&mut theta);
        set_block(&mut belief.mean, 3, 0, &theta);
        if !self.supervise {
            return;
        }
        let variance = variances(&belief.factor);
        for i in 0..6 {
            if variance[i] > self.maximum[i] * self.maximum[i] {
                let scale = self.maximum[i] / variance[i].sqrt();
                for j in 0..=i {
                    belief.factor[(i, j)] *= scale;
                }
            }
        }
    }
}
