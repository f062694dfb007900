//! How far the unknowns may be off: by the filter's covariance, and by what the model leaves out.

use super::belief::Belief;
use super::coordinates::Map;
use super::parameters::{ModelError, Parameters};
use super::speed_evidence::Doubt;
use crate::model::wheel_loader::{GRAVITY, Unknowns};
use crate::variable::root_sum_square;
use nalgebra::Vector3;

/// Specific force of usual driving, m/s2.
const USUAL_ACCELERATION: f64 = 0.5;

/// What the standard deviations of the unknowns follow from, beside the belief.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    model: ModelError,
    /// Standard deviations of the unknowns before the first sample.
    initial_std: Vector3<f64>,
    /// The same in the filter's coordinates.
    initial_theta_std: Vector3<f64>,
}

impl Uncertainty {
    /// From the parameters and the belief before the first sample.
    pub fn new(p: &Parameters, initial: &Belief) -> Self {
        let known = &p.initial;
        Self {
            model: p.model_error.clone(),
            initial_std: Vector3::new(known.slip_stiffness_std, known.cg_height_std, known.cg_ratio_std),
            initial_theta_std: Vector3::from_fn(|i, _| initial.factor[(3 + i, 3 + i)]),
        }
    }

    /// Standard deviation of one unknown: the filter's, the model's, and what a late speed may have done. An unknown at the
    /// end of its range is known no better than before the first sample.
    pub fn std(&self, i: usize, map: &Map, belief: &Belief, unknowns: &Unknowns, doubt: &Doubt) -> f64 {
        let (derivative, std) = (map.derivative_of(i, unknowns[i]), belief.std(3 + i));
        let by_filter = derivative * derivative * (std * std);
        let by_delay = match i {
            0 => root_sum_square([doubt.stiffness, doubt.scale]) * unknowns[0],
            1 => doubt.stiffness * unknowns[1] * self.learnt(1, std),
            _ => self.share_by_delay(map, belief, unknowns, doubt, 0.0),
        };
        let std = (by_filter + self.model_variance(i, map, std, unknowns) + by_delay * by_delay).sqrt();
        if map.at_end(i, unknowns[i]) { std.max(self.initial_std[i]) } else { std }
    }

    /// What a late speed may have done to the front axle's share of the load at this specific force, m/s2; that without any
    /// is the ratio of the centre of gravity.
    ///
    /// It adds the same to both axles' slips. What is seen of the loads, their difference, is then off as the slip stiffness
    /// is, by which it was multiplied: share and height alike, or, as far as the height was not learnt, the share at the
    /// specific force at which the slips were seen.
    pub fn share_by_delay(
        &self,
        map: &Map,
        belief: &Belief,
        unknowns: &Unknowns,
        doubt: &Doubt,
        specific_force: f64,
    ) -> f64 {
        let [_, h, lambda] = (*unknowns).into();
        let learnt = self.learnt(1, belief.std(4));
        let at = (1.0 - learnt) * doubt.specific_force + learnt * specific_force;
        let difference = lambda - 0.5 - h * at / (GRAVITY * map.machine.loader.wheelbase);
        doubt.stiffness * root_sum_square([difference, map.derivative_of(2, lambda) * belief.std(5)])
    }

    /// How much of an unknown the data and not the initial values have made.
    pub fn learnt(&self, i: usize, theta_std: f64) -> f64 {
        let left = theta_std / self.initial_theta_std[i];
        (1.0 - left * left).max(0.0)
    }

    /// Whether the data have at least halved the height's standard deviation, which is `std` now.
    pub fn height_is_observable(&self, std: f64) -> bool {
        std < 0.5 * self.initial_std[1]
    }

    /// Variance that the model's simplifications add, as far as the data and not the initial values made the estimate,
    /// which the filter knows to within `theta_std` in its coordinates.
    pub fn model_variance(&self, i: usize, map: &Map, theta_std: f64, unknowns: &Unknowns) -> f64 {
        let model = self.model_std(i, map, unknowns);
        self.learnt(i, theta_std) * model * model
    }

    /// What the change of a tyre's deflection with the load transfer of half a metre per second squared can make of its
    /// rolling radius, as a standard deviation, m. The filter takes the radii for the same at any load.
    pub fn radius_std(&self, map: &Map, unknowns: &Unknowns) -> f64 {
        let (error, loader) = (&self.model, &map.machine.loader);
        let transfer = USUAL_ACCELERATION * loader.mass * unknowns[1] / loader.wheelbase;
        error.radius_softness * transfer / error.tire_stiffness
    }

    /// What the model's simplifications can make of an unknown, as a standard deviation.
    ///
    /// A radius that shrinks by the share `s` of the tyre's deflection makes the acceleration's load
    /// transfer, `m h/l` times it, into slip that is proportional to the torque, as that of the load
    /// share itself: `dlambda = lambda (1 - lambda) 2 s K m g h / (l k r)`.
    fn model_std(&self, i: usize, map: &Map, unknowns: &Unknowns) -> f64 {
        let (error, [stiffness, h, lambda]) = (&self.model, (*unknowns).into());
        match i {
            0 => error.slip_stiffness * stiffness,
            1 => error.cg_height * h,
            _ => {
                let loader = &map.machine.loader;
                let radius = 0.5 * (loader.wheel_radius_front + loader.wheel_radius_rear);
                let softness = 2.0 * error.radius_softness * stiffness * loader.mass * GRAVITY * h
                    / (loader.wheelbase * error.tire_stiffness * radius);
                lambda * (1.0 - lambda) * softness
            }
        }
    }
}
