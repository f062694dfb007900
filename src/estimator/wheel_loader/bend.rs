//! Bends: axles whose paths differ in length, which looks like slip.

use super::belief::{Belief, STATES};
use super::coordinates::Map;
use crate::filter::critically_damped::{CriticallyDamped, Transition};
use crate::model::wheel_loader::{Loader, SteadySlip, Unknowns};
use crate::variable::root_sum_square;
use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};

/// Corner frequency of the filter that gives the steering angle's rate, Hz.
const STEERING_CUTOFF: f64 = 3.0;
/// How long the error of a steering angle lasts, as a bend does, s.
const STEERING_MEMORY: f64 = 2.0;
/// Relative standard deviation of what a changing angle does to the paths: its rate comes late and with noise.
const RATE_ERROR: f64 = 0.2;

/// The steering angle's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SteeringAngle {
    known: bool,
    filtered: CriticallyDamped,
}

impl SteeringAngle {
    /// Makes of the front axle's wheel speed in `y` the one of a machine that drives straight at the rear axle's speed.
    /// Returns the standard deviation of what is left of the bend in it, rad/s. NaN is no angle: a straight drive.
    pub fn straighten(
        &mut self,
        loader: &Loader,
        angle: f64,
        angle_std: f64,
        y: &mut Vector3<f64>,
        dt: Option<f64>,
    ) -> f64 {
        if !angle.is_finite() {
            return 0.0;
        }
        match dt {
            Some(dt) if self.known => self.filtered.step(&Transition::new(STEERING_CUTOFF, dt), angle),
            _ => *self = Self { known: true, filtered: CriticallyDamped::at(angle) },
        }
        let (paths, radius) = (loader.paths(angle, self.filtered.rate), loader.wheel_radius_front);
        let wheel = y[1];
        y[1] = paths.gain * wheel + paths.offset / radius;
        if !wheel.is_finite() {
            return 0.0;
        }
        // An error that lasts counts as white noise of equal density: it is not averaged out within a bend.
        let lasting = (2.0 * STEERING_MEMORY / dt.unwrap_or(STEERING_MEMORY)).max(1.0).sqrt();
        lasting * root_sum_square([paths.gain_by_angle * angle_std * wheel, RATE_ERROR * paths.offset / radius])
    }
}

/// Time over which the difference of the paths is averaged, s.
const AVERAGING: f64 = 0.3;
/// Time over which it must be correlated to be noise of the road, and memory of that noise, s.
const ROAD: f64 = 0.05;
const ROAD_MEMORY: f64 = 2.0;
/// Standard deviations beyond which the paths differ, and within which they agree again.
const DIFFER: f64 = 4.0;
const AGREE: f64 = 2.0;
/// Time of agreement that ends a bend, s.
const STRAIGHT: f64 = 0.5;
/// Share of the slip that a tyre may have more or less than the model's.
const TIRE_ERROR: f64 = 0.06;
/// Distance over which a tyre's slip follows its load and torque, m: longer than the relaxation length of most.
const RELAXATION: f64 = 0.5;
/// Longest bend, s: what differs for longer is another machine than the one that was estimated.
const LONGEST: f64 = 20.0;

/// Whether the axles roll equally far.
///
/// `D = (r_f w_f - r_r w_r)/|v| - (sigma_f - sigma_r)` is what the wheel speeds differ by and no slip explains. The speed
/// over ground does not enter, nor its noise. Unknowns and radii may be wrong by their covariance, the tyres by a share of
/// the slip; what the average of `D` shows beyond that is a bend, in which nothing can be estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PathWatch {
    /// Average of `D`.
    mean: f64,
    /// `D` about its average, over [`ROAD`], and the mean square of that.
    road: f64,
    road_square: f64,
    /// Difference of the slips behind a relaxation length, and the mean squares of what that changes and of the slips.
    relaxed: f64,
    lag_square: f64,
    slip_square: f64,
    /// Time with samples, s.
    time: f64,
    differs: bool,
    /// Whether the front path was the longer one when they began to differ.
    front_longer: bool,
    /// Time of agreement during a bend, s.
    agreed: f64,
    /// Time in bends, less that out of them, s.
    lasted: f64,
}

/// The estimates before a sample.
pub struct Seen<'a> {
    /// The filter's coordinates.
    pub map: &'a Map,
    /// Mean and factor.
    pub belief: &'a Belief,
    /// The unknowns in it.
    pub unknowns: &'a Unknowns,
    /// The rolling radii in it, m.
    pub radius: [f64; 2],
    /// The slip that the drive takes of them.
    pub steady: &'a SteadySlip,
    /// Standard deviations of the wheel speeds, rad/s.
    pub wheel_std: [f64; 2],
}

/// What a sample says of the paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// Nothing new.
    #[default]
    Same,
    /// They begin to differ.
    Part,
    /// They have differed for too long for a bend.
    StayApart,
}

impl PathWatch {
    /// Whether the paths differ.
    pub fn differs(&self) -> bool {
        self.differs
    }

    /// Whether they differ as in the bend that was seen first: not alternating, as a wrong sign makes them.
    pub fn is_bend(&self) -> bool {
        self.differs && (self.mean > 0.0) == self.front_longer
    }

    /// By how much they differ, relative to the path.
    pub fn difference(&self) -> f64 {
        self.mean.abs()
    }

    /// Starts anew, after a start or when the unknowns are reset.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Takes the wheel speeds of `y` at a speed `v` that is not small.
    pub fn update(&mut self, seen: &Seen, y: &Vector3<f64>, v: f64, dt: f64) -> Paths {
        if !(y[1].is_finite() && y[2].is_finite()) {
            return Paths::Same;
        }
        let Seen { map, belief, unknowns, radius, wheel_std, .. } = *seen;
        let SteadySlip { demand, by_height_and_ratio: by, .. } = *seen.steady;
        let (size, sigma) = (v.abs(), demand.map(|demand| demand / unknowns[0]));
        let d = (radius[0] * y[1] - radius[1] * y[2]) / size - (sigma[0] - sigma[1]);

        let share = |time: f64| dt / (time + dt);
        let white = ((radius[0] * wheel_std[0]).powi(2) + (radius[1] * wheel_std[1]).powi(2)) / (size * size);
        let (a, b) = (share(AVERAGING), share(ROAD));
        self.time = (self.time + dt).min(1e9);
        // The plain mean until there is enough for a fading one.
        self.mean += a.max(dt / self.time) * (d - self.mean);
        self.road += b * (d - self.mean - self.road);
        self.road_square += share(ROAD_MEMORY) * (self.road * self.road - self.road_square);
        let noise = white.max(self.road_square * (2.0 - b) / b) * a / (2.0 - a);

        let [slip, lag] = [sigma[0] - sigma[1], sigma[0] - sigma[1] - self.relaxed];
        self.relaxed += share(RELAXATION / size) * lag;
        self.lag_square += a * (lag * lag - self.lag_square);
        self.slip_square += a * (sigma[0] * sigma[0] + sigma[1] * sigma[1] - self.slip_square);
        let tires = TIRE_ERROR * TIRE_ERROR * self.slip_square + self.lag_square;

        let slopes = map.derivative(unknowns);
        let mut gradient = SVector::<f64, STATES>::zeros();
        gradient[3] = slip / unknowns[0] * slopes[0];
        for i in 0..2 {
            gradient[4 + i] = -(sigma[0] * by[0][i] - sigma[1] * by[1][i]) * slopes[1 + i];
        }
        (gradient[6], gradient[7]) = (1.0, -1.0);
        let std = (noise + tires + belief.variance_along(&gradient)).sqrt();
        self.judge(std, dt)
    }

    fn judge(&mut self, std: f64, dt: f64) -> Paths {
        let size = self.mean.abs();
        self.agreed = if size < AGREE * std { self.agreed + dt } else { 0.0 };
        if !self.differs {
            self.lasted = (self.lasted - dt).max(0.0);
            let enough = self.time > AVERAGING;
            if !(enough && size > DIFFER * std) {
                return Paths::Same;
            }
            (self.differs, self.front_longer, self.agreed) = (true, self.mean > 0.0, 0.0);
            return Paths::Part;
        }
        self.lasted += dt;
        if self.agreed > STRAIGHT {
            self.differs = false;
        } else if self.lasted > LONGEST {
            self.lasted = LONGEST;
            return Paths::StayApart;
        }
        Paths::Same
    }
}
