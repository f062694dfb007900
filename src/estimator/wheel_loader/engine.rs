//! One supervised filter sample on the belief `[v, w_f, w_r, theta_K, theta_h, theta_lambda]`,
//! extended by relative errors of the two rolling radii where these are estimated.

use super::coordinates::{Map, unknowns};
use super::parameters::{Adaptation, Form, Kind, ModelError, Parameters, Radii};
use super::supervision::{Fading, SlipLimits, Supervision};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::sigma_points::UnscentedTransform;
use crate::filter::square_root::{absorb_diagonal, andrews, array, block, joseph, set_block, tria, variances};
use crate::filter::srukf;
use crate::model::wheel_loader::{Drive, Driven, GRAVITY, Loader, Motion, Unknowns, WheelLoader};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::f64::consts::TAU;

/// States of the belief as it is stored; without radii the last two are 0.
pub const STATES: usize = 8;
/// The belief as it is stored.
pub type Belief = FactoredGaussian<STATES>;
/// Longest implicit step of the model, s.
const LONGEST_STEP: f64 = 0.01;
/// The random walks are declared per this time, s.
const WALK_TIME: f64 = 0.01;
/// Random walk of the motion while the estimates are held: v in m/s, w in rad/s.
const HELD_WALK: [f64; 3] = [0.05, 0.2, 0.2];

/// Everything that is fixed after construction.
#[derive(Clone, Debug)]
pub struct Engine {
    /// The machine with the radii as given.
    pub machine: WheelLoader,
    /// Coordinates of the unknowns.
    pub map: Map,
    /// Whether the radii are part of the belief.
    pub radii: bool,
    kind: Kind,
    form: Form,
    transform: UnscentedTransform,
    substeps: u32,
    supervise: bool,
    gate: f64,
    gate_samples: u32,
    process: SVector<f64, STATES>,
    measurement: Vector3<f64>,
    minimum: Vector3<f64>,
    maximum: SVector<f64, 6>,
    adaptation: Adaptation,
    fading: Fading,
    start: Belief,
    /// The slip that torque must cause.
    pub slip_limits: SlipLimits,
    /// Standard deviations of the unknowns before the first sample.
    pub start_std: Vector3<f64>,
    model_error: ModelError,
}

/// What happened in one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Normalised innovation squared over the number of channels used.
    pub nis: f64,
    /// Logarithm of the likelihood of all channels, rejected ones included.
    pub log_likelihood: f64,
    /// A channel was rejected by the gate.
    pub gated: bool,
    /// A channel was accepted after too many rejections.
    pub reacquired: bool,
}

impl Engine {
    /// Translates the parameters; they are already within their ranges.
    pub fn new(p: &Parameters) -> Self {
        let filter = &p.filter;
        let radii = filter.radii == Radii::Estimated;
        let map = Map::new(filter.parameters, &p.start);
        let theta = map.coordinates(&unknowns(&p.start));
        let slope = map.slope(&unknowns(&p.start));
        let walk = &filter.process_std;
        let (low, high, first) = (&filter.minimum_std, &filter.maximum_std, &filter.start_std);
        let radius_walk = if radii { filter.process_std.wheel_radius } else { 0.0 };
        let radius_std = if radii { p.start.wheel_radius_std } else { 0.0 };
        let unit = map.unit;
        let mut mean = SVector::<f64, STATES>::zeros();
        mean.fixed_rows_mut::<3>(3).copy_from(&theta);
        let std = [
            first.speed,
            first.wheel_speed,
            first.wheel_speed,
            p.start.slip_stiffness_std / slope[0],
            p.start.cg_height_std / slope[1],
            p.start.cg_ratio_std / slope[2],
            radius_std,
            radius_std,
        ];
        Self {
            machine: p.machine(),
            map,
            radii,
            kind: filter.kind,
            form: filter.form,
            // With radii the sigma points stay as far out as without: one tuning for both.
            transform: UnscentedTransform::new(6, filter.alpha, filter.beta, filter.kappa),
            substeps: filter.substeps.max(1) as u32,
            supervise: filter.supervise,
            gate: filter.gate,
            gate_samples: filter.gate_samples.max(0) as u32,
            process: SVector::from([
                walk.speed,
                walk.wheel_speed,
                walk.wheel_speed,
                walk.slip_stiffness * unit[0],
                walk.cg_height * unit[1],
                walk.cg_ratio * unit[2],
                radius_walk,
                radius_walk,
            ]),
            measurement: Vector3::new(
                filter.measurement_std.speed,
                filter.measurement_std.wheel_speed,
                filter.measurement_std.wheel_speed,
            ),
            minimum: Vector3::new(low.slip_stiffness, low.cg_height, low.cg_ratio).component_mul(&unit),
            maximum: SVector::from([
                high.speed,
                high.wheel_speed,
                high.wheel_speed,
                high.slip_stiffness * unit[0],
                high.cg_height * unit[1],
                high.cg_ratio * unit[2],
            ]),
            adaptation: filter.adaptation.clone(),
            fading: Fading::new(&filter.adaptation, p.sample_period),
            start: FactoredGaussian::independent(mean, &SVector::from(std)),
            slip_limits: SlipLimits {
                largest_stiffness: map.largest_stiffness(theta[0], 2.0 * std[3]),
                ratio: p.start.cg_ratio,
                radius_std,
            },
            start_std: Vector3::new(p.start.slip_stiffness_std, p.start.cg_height_std, p.start.cg_ratio_std),
            model_error: p.model_error.clone(),
        }
    }

    /// The belief before the first sample.
    pub fn start(&self) -> &Belief {
        &self.start
    }

    /// The unknowns of a belief.
    pub fn unknowns(&self, mean: &SVector<f64, STATES>) -> Unknowns {
        self.map.unknowns(&mean.fixed_rows::<3>(3).into_owned())
    }

    /// The rolling radii with their relative errors.
    fn radius(&self, errors: [f64; 2]) -> [f64; 2] {
        let given = self.machine.loader.wheel_radius();
        [given[0] * (1.0 + errors[0]), given[1] * (1.0 + errors[1])]
    }

    /// The machine with the radii of a belief.
    pub fn corrected(&self, radius_errors: [f64; 2]) -> WheelLoader {
        let [wheel_radius_front, wheel_radius_rear] = self.radius(radius_errors);
        let loader = Loader { wheel_radius_front, wheel_radius_rear, ..self.machine.loader };
        WheelLoader { loader, ..self.machine }
    }

    /// What the model's simplifications can make of the unknowns, as standard deviations.
    ///
    /// A radius that shrinks by the share `s` of the tyre's deflection makes the acceleration's load
    /// transfer, `m h/l` times it, into slip that is proportional to the torque, as that of the load
    /// share itself: `dlambda = lambda (1 - lambda) 2 s K m g h / (l k r)`.
    pub fn model_std(&self, unknowns: &Unknowns) -> Vector3<f64> {
        let (stiffness, h, lambda) = (unknowns[0], unknowns[1], unknowns[2]);
        let (loader, error) = (&self.machine.loader, &self.model_error);
        let radius = 0.5 * (loader.wheel_radius_front + loader.wheel_radius_rear);
        let softness = 2.0 * error.radius_softness * stiffness * loader.mass * GRAVITY * h
            / (loader.wheelbase * error.tire_stiffness * radius);
        Vector3::new(error.slip_stiffness * stiffness, error.cg_height * h, lambda * (1.0 - lambda) * softness)
    }

    /// Sets the motion from the first measurement; a missing wheel speed follows from the speed and
    /// the other way round.
    pub fn begin(&self, belief: &mut Belief, y: &[f64; 3]) {
        let r = self.machine.loader.wheel_radius();
        let rolling = (0..2).map(|i| r[i] * y[i + 1]).find(|speed| speed.is_finite());
        let v = if y[0].is_finite() { y[0] } else { rolling.unwrap_or(0.0) };
        let motion = [v, v / r[0], v / r[1]];
        // Nothing ties the unknowns to a motion that begins anew; their own covariance stays.
        let unknowns = tria(belief.factor.fixed_rows::<5>(3).into_owned());
        belief.factor.fill(0.0);
        belief.factor.fixed_view_mut::<5, 5>(3, 3).copy_from(&unknowns);
        for i in 0..3 {
            let measured = y[i].is_finite();
            let std = if measured { self.start.factor[(i, i)] } else { self.maximum[i] };
            belief.mean[i] = if measured { y[i] } else { motion[i] };
            belief.factor[(i, i)] = std;
        }
    }

    /// Takes one sample; `y` is NaN where nothing was measured. A belief that is not finite is not taken
    /// over and nothing is returned.
    pub fn sample(
        &self,
        belief: &mut Belief,
        drive: &Drive,
        y: &[f64; 3],
        dt: f64,
        supervision: &mut Supervision,
    ) -> Option<Outcome> {
        if self.radii {
            let (posterior, outcome) = self.sample_states::<STATES, 5>(belief, drive, y, dt, supervision);
            *belief = posterior.is_valid().then_some(posterior)?;
            return Some(outcome);
        }
        let prior = FactoredGaussian { mean: block(&belief.mean, 0, 0), factor: block(&belief.factor, 0, 0) };
        let (posterior, outcome) = self.sample_states::<6, 3>(&prior, drive, y, dt, supervision);
        let posterior = posterior.is_valid().then_some(posterior)?;
        set_block(&mut belief.mean, 0, 0, &posterior.mean);
        set_block(&mut belief.factor, 0, 0, &posterior.factor);
        Some(outcome)
    }

    fn sample_states<const N: usize, const K: usize>(
        &self,
        prior: &FactoredGaussian<N>,
        drive: &Drive,
        y: &[f64; 3],
        dt: f64,
        supervision: &mut Supervision,
    ) -> (FactoredGaussian<N>, Outcome) {
        let held = supervision.held;
        let mut belief = if held && !supervision.settling {
            self.hold(prior, dt)
        } else {
            self.predict::<N, K>(prior, drive, dt, !held)
        };

        // Channels: missing ones carry no information, far ones are rejected for a while.
        let mut nu = Vector3::zeros();
        let mut hs = Matrix3::zeros(); // H S without its columns of zeros
        let mut noise = Matrix3::identity();
        let mut outcome = Outcome::default();
        let mut used = 0;
        let (level, measurement) = self.measurement(&belief, y, dt, supervision);
        let (mut protect, variance) = (held, variances(&belief.factor));
        for i in 0..3 {
            if !y[i].is_finite() {
                continue;
            }
            let innovation = y[i] - belief.mean[i];
            let variance = variance[i] + level[i] * level[i];
            if self.supervise && innovation * innovation > self.gate * self.gate * variance {
                supervision.masked[i] = supervision.masked[i].saturating_add(1);
                if supervision.masked[i] <= self.gate_samples {
                    outcome.gated = true;
                    outcome.log_likelihood -= 0.5 * (innovation * innovation / variance + (TAU * variance).ln());
                    continue;
                }
                outcome.reacquired = true;
                protect = true;
            } else {
                supervision.masked[i] = 0;
            }
            used += 1;
            nu[i] = innovation;
            noise[(i, i)] = measurement[i];
            for j in 0..3 {
                hs[(i, j)] = belief.factor[(i, j)];
            }
        }

        if used > 0 {
            let leading = block(&belief.factor, 0, 0);
            let update = match self.form {
                Form::Andrews if !protect => andrews(&leading, &hs, &noise),
                _ => array(&leading, &hs, &noise),
            };
            let square = update.whiten(&nu).norm_squared();
            // channels without a sample have 1 on the diagonal
            let determinant = update.innovation.diagonal().product();
            outcome.nis = square / f64::from(used);
            outcome.log_likelihood -= 0.5 * (square + f64::from(used) * TAU.ln()) + determinant.ln();
            if protect {
                let mut gain: SMatrix<f64, N, 3> = update.gain();
                for row in 3..N {
                    gain.row_mut(row).fill(0.0);
                }
                let mut all = SMatrix::<f64, 3, N>::zeros();
                set_block(&mut all, 0, 0, &hs);
                belief.mean += gain * nu;
                belief.factor = joseph(&belief.factor, &all, &noise, &gain);
            } else {
                belief.mean += update.step(&nu);
                set_block(&mut belief.factor, 0, 0, &update.factor);
            }
        }
        self.limit(&mut belief);
        (belief, outcome)
    }

    /// Standard deviations of the measurements, raised where the slip innovations of the last second
    /// show more noise, or slower noise, than the settings expect: tyres that bounce. The first is the
    /// present noise level, the second also counts a single large innovation less (Huber).
    fn measurement<const N: usize>(
        &self,
        predicted: &FactoredGaussian<N>,
        y: &[f64; 3],
        dt: f64,
        supervision: &mut Supervision,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let given = self.measurement;
        if !self.supervise || !self.adaptation.enabled {
            return (given, given);
        }
        let (mut level, mut weighted) = (given, given);
        let fading = if dt == self.fading.dt { self.fading } else { Fading::new(&self.adaptation, dt) };
        let mut common = (1.0_f64, 1.0_f64);
        for i in 0..2 {
            let r = self.machine.loader.wheel_radius()[i];
            let e = r * (y[i + 1] - predicted.mean[i + 1]) - (y[0] - predicted.mean[0]);
            if !e.is_finite() {
                continue;
            }
            let sensors = (r * given[i + 1]).powi(2) + given[0].powi(2);
            let mut belief = 0.0;
            for j in 0..=i + 1 {
                belief += (r * predicted.factor[(i + 1, j)] - predicted.factor[(0, j)]).powi(2);
            }
            let roughness = &mut supervision.roughness[i];
            roughness.take(e, sensors, belief, &self.adaptation, &fading);
            let ratio = roughness.ratio(&self.adaptation);
            let size = e.abs() / (self.adaptation.huber * (sensors * ratio * ratio + belief).sqrt());
            level[i + 1] *= ratio;
            weighted[i + 1] *= ratio * size.max(1.0);
            common = (common.0.max(ratio), common.1.max(ratio * size.max(1.0)));
        }
        level[0] *= common.0;
        weighted[0] *= common.1;
        (level, weighted)
    }

    /// Time update while nothing is learnt: the motion walks, the unknowns keep mean and covariance.
    fn hold<const N: usize>(&self, prior: &FactoredGaussian<N>, dt: f64) -> FactoredGaussian<N> {
        let scale = (dt / WALK_TIME).sqrt();
        let q = SVector::<f64, N>::from_fn(|i, _| if i < 3 { HELD_WALK[i] * scale } else { 0.0 });
        let mut predicted = *prior;
        absorb_diagonal(&mut predicted.factor, &q);
        predicted
    }

    /// Time update by the model; the unknowns walk only if something may be learnt.
    fn predict<const N: usize, const K: usize>(
        &self,
        prior: &FactoredGaussian<N>,
        drive: &Drive,
        dt: f64,
        learn: bool,
    ) -> FactoredGaussian<N> {
        let scale = (dt / WALK_TIME).sqrt();
        let mut q = SVector::<f64, N>::from_fn(|i, _| if i < 3 || learn { self.process[i] * scale } else { 0.0 });
        if self.supervise && learn {
            let variance = variances(&prior.factor);
            for i in 0..3 {
                let short = self.minimum[i] * self.minimum[i] - variance[3 + i];
                if short > 0.0 {
                    q[3 + i] = (q[3 + i] * q[3 + i] + short).sqrt();
                }
            }
        }
        let substeps = self.substeps.max((dt / LONGEST_STEP - 1e-9).ceil() as u32);
        let mean = &prior.mean;
        let errors = |z: &SVector<f64, N>| if N > 6 { [z[6], z[7]] } else { [0.0; 2] };
        let motion = Motion::new(mean[0], mean[1], mean[2]);
        let unknowns = self.map.centre(&Vector3::new(mean[3], mean[4], mean[5]));
        let (driven, radii) = (Driven::new(&self.machine, drive), errors(mean));
        let advance = |motion: &Motion, unknowns: &Unknowns, radii: [f64; 2]| {
            driven.advance(self.radius(radii), motion, unknowns, dt, substeps)
        };
        let mut belief = *prior;
        match self.kind {
            Kind::SquareRootUnscented => {
                let centre = advance(&motion, &unknowns.unknowns, radii);
                srukf::predict::<N, 3, K>(&mut belief, &self.transform, &q, &centre, |offset| {
                    let step = Motion::new(offset[0], offset[1], offset[2]);
                    let [up, down] = unknowns.pair(&Vector3::new(offset[3], offset[4], offset[5]));
                    let [front, rear] = errors(offset);
                    [
                        advance(&(motion + step), &up, [radii[0] + front, radii[1] + rear]),
                        advance(&(motion - step), &down, [radii[0] - front, radii[1] - rear]),
                    ]
                });
            }
            Kind::Extended => {
                let (moved, mut f) =
                    driven.advance_linearised::<N>(self.radius(radii), &motion, &unknowns.unknowns, dt, substeps);
                let slope = self.map.slope(&unknowns.unknowns);
                for row in 0..3 {
                    for k in 3..6 {
                        f[(row, k)] *= slope[k - 3];
                    }
                    for k in 6..N {
                        f[(row, k)] /= 1.0 + mean[k];
                    }
                }
                srukf::predict_linearised::<N, 3, K>(&mut belief, &moved, &f, &q);
            }
        }
        belief
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
