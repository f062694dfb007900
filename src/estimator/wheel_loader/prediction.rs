//! Time update: by the model through sigma points or its linearisation, or, while the unknowns are held, by a random walk.

use super::belief::STATES;
use super::coordinates::{Centre, Map};
use super::parameters::{Kind, Parameters, Radii};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::sigma_points::UnscentedTransform;
use crate::filter::square_root::{absorb_diagonal, variances};
use crate::filter::srukf;
use crate::model::wheel_loader::{Drive, Driven, Motion};
use nalgebra::{SMatrix, SVector, Vector3};

/// Longest implicit step of the model, s.
const LONGEST_STEP: f64 = 0.01;
/// Power spectral densities of the motion's random walk while the estimates are held: m2/s3, rad2/s3.
const HELD_PSD: [f64; 3] = [0.25, 4.0, 4.0];

/// Time update by the model.
#[derive(Clone, Debug)]
pub struct Prediction {
    kind: Kind,
    transform: UnscentedTransform,
    substeps: u32,
    overshoot: bool,
    /// Power spectral densities of the process noise, in the filter's coordinates.
    psd: SVector<f64, STATES>,
    /// Least standard deviations of the unknowns.
    minimum: Vector3<f64>,
}

impl Prediction {
    /// From the parameters.
    pub fn new(p: &Parameters, map: &Map) -> Self {
        let (filter, walk, unit) = (&p.filter, &p.filter.process_psd, map.unit);
        let radius = if filter.radii == Radii::Estimated { walk.wheel_radius } else { 0.0 };
        let [stiffness, height, ratio]: [f64; 3] = unit.component_mul(&unit).into();
        let least = &filter.minimum_std;
        let minimum = Vector3::new(least.slip_stiffness, least.cg_height, least.cg_ratio).component_mul(&unit);
        Self {
            kind: filter.kind,
            // With radii the sigma points stay as far out as without: one tuning for both.
            transform: UnscentedTransform::new(6, filter.alpha, filter.beta, filter.kappa),
            substeps: filter.substeps.max(1) as u32,
            overshoot: filter.overshoot,
            psd: SVector::from([
                walk.speed,
                walk.wheel_speed,
                walk.wheel_speed,
                walk.slip_stiffness * stiffness,
                walk.cg_height * height,
                walk.cg_ratio * ratio,
                radius,
                radius,
            ]),
            minimum: if filter.supervise { minimum } else { Vector3::zeros() },
        }
    }

    /// Steps of the model over `dt` seconds.
    fn steps(&self, dt: f64) -> u32 {
        self.substeps.max((dt / LONGEST_STEP - 1e-9).ceil() as u32)
    }

    fn driven<'a>(&self, map: &'a Map, drive: &Drive) -> Driven<'a> {
        let driven = Driven::new(&map.machine, drive);
        if self.overshoot { driven.overshooting() } else { driven }
    }

    /// Carries the belief over `dt` seconds; unknowns and radii walk only if something may be learnt.
    pub fn predict<const N: usize, const K: usize>(
        &self,
        belief: &mut FactoredGaussian<N>,
        map: &Map,
        drive: &Drive,
        dt: f64,
        learn: bool,
    ) {
        let std = self.process_std(belief, dt, learn);
        let (substeps, driven) = (self.steps(dt), self.driven(map, drive));
        match self.kind {
            Kind::SquareRootUnscented => {
                let points = Points::around(&belief.mean, map, &driven, (dt, substeps));
                let centre = points.centre();
                srukf::predict::<N, 3, K>(belief, &self.transform, &std, &centre, |offsets| points.pairs(offsets));
            }
            Kind::Extended => {
                let (moved, f) = linearised(belief, map, &driven, dt, substeps);
                srukf::predict_linearised::<N, 3, K>(belief, &moved, &f, &std);
            }
        }
    }

    /// Covariance of the belief now with that at the end of [`predict`](Self::predict): `S M^T`, where `M` holds what
    /// becomes of the columns of the factor `S`, half the distance of opposite sigma points for the motion.
    pub fn cross_covariance<const N: usize>(
        &self,
        belief: &FactoredGaussian<N>,
        map: &Map,
        drive: &Drive,
        dt: f64,
    ) -> SMatrix<f64, N, N> {
        let (substeps, driven) = (self.steps(dt), self.driven(map, drive));
        let mut moved = belief.factor;
        if self.kind == Kind::Extended {
            let (_, f) = linearised(belief, map, &driven, dt, substeps);
            moved.fixed_rows_mut::<3>(0).copy_from(&(f * belief.factor));
        } else {
            let points = Points::around(&belief.mean, map, &driven, (dt, substeps));
            for j in 0..N {
                let offset = belief.factor.column(j) * self.transform.distance;
                let [[up, down], _] = points.pairs([&offset; 2]);
                moved.fixed_view_mut::<3, 1>(0, j).copy_from(&((up - down) * (0.5 / self.transform.distance)));
            }
        }
        belief.factor * moved.transpose()
    }

    /// Standard deviations of the process noise over `dt` seconds. Those of the unknowns make up for what is short of
    /// their least standard deviations.
    fn process_std<const N: usize>(&self, belief: &FactoredGaussian<N>, dt: f64, learn: bool) -> SVector<f64, N> {
        let mut std = SVector::<f64, N>::from_fn(|i, _| if i < 3 || learn { (self.psd[i] * dt).sqrt() } else { 0.0 });
        if learn {
            let variance = variances(&belief.factor);
            for i in 0..3 {
                let short = self.minimum[i] * self.minimum[i] - variance[3 + i];
                if short > 0.0 {
                    std[3 + i] = (std[3 + i] * std[3 + i] + short).sqrt();
                }
            }
        }
        std
    }
}

/// Where the filter's points go.
struct Points<'a> {
    map: &'a Map,
    driven: &'a Driven<'a>,
    /// Time, s, and the number of the model's steps.
    time: (f64, u32),
    motion: Motion,
    unknowns: Centre,
    radius_errors: [f64; 2],
}

impl<'a> Points<'a> {
    fn around<const N: usize>(mean: &SVector<f64, N>, map: &'a Map, driven: &'a Driven, time: (f64, u32)) -> Self {
        let motion = Motion::new(mean[0], mean[1], mean[2]);
        let unknowns = map.centre(&Vector3::new(mean[3], mean[4], mean[5]));
        Self { map, driven, time, motion, unknowns, radius_errors: radius_errors(mean) }
    }

    fn centre(&self) -> Motion {
        let (dt, substeps) = self.time;
        self.driven.advance(self.map.radius(self.radius_errors), &self.motion, &self.unknowns.unknowns, dt, substeps)
    }

    /// Those of the mean with each of two offsets and with the opposite one.
    fn pairs<const N: usize>(&self, offsets: [&SVector<f64, N>; 2]) -> [[Motion; 2]; 2] {
        let ((dt, substeps), [of_front, of_rear]) = (self.time, self.radius_errors);
        let [[a, b], [c, d]] = offsets.map(|offset| {
            let step = Motion::new(offset[0], offset[1], offset[2]);
            let [front, rear] = radius_errors(offset);
            let [up, down] = self.unknowns.pair(&Vector3::new(offset[3], offset[4], offset[5]));
            let radius = |sign: f64| self.map.radius([of_front + sign * front, of_rear + sign * rear]);
            [(radius(1.0), self.motion + step, up), (radius(-1.0), self.motion - step, down)]
        });
        let points = [&a, &b, &c, &d];
        let [a, b, c, d] = self.driven.advance_four(
            points.map(|point| point.0),
            points.map(|point| &point.1),
            points.map(|point| &point.2),
            dt,
            substeps,
        );
        [[a, b], [c, d]]
    }
}

/// Where the motion goes, with the derivative over all states.
fn linearised<const N: usize>(
    belief: &FactoredGaussian<N>,
    map: &Map,
    driven: &Driven,
    dt: f64,
    substeps: u32,
) -> (Motion, SMatrix<f64, 3, N>) {
    let mean = &belief.mean;
    let (motion, errors) = (Motion::new(mean[0], mean[1], mean[2]), radius_errors(mean));
    let unknowns = map.centre(&Vector3::new(mean[3], mean[4], mean[5])).unknowns;
    let (moved, mut f) = driven.advance_linearised::<N>(map.radius(errors), &motion, &unknowns, dt, substeps);
    let derivative = map.derivative(&unknowns);
    for row in 0..3 {
        for k in 3..6 {
            f[(row, k)] *= derivative[k - 3];
        }
        for k in 6..N {
            f[(row, k)] /= 1.0 + mean[k];
        }
    }
    (moved, f)
}

/// The relative errors of the radii, where they are among the states.
fn radius_errors<const N: usize>(state: &SVector<f64, N>) -> [f64; 2] {
    if N > 6 { [state[6], state[7]] } else { [0.0; 2] }
}

/// Time update while the unknowns are held: the motion walks at random, the unknowns keep mean and covariance.
pub fn hold<const N: usize>(belief: &mut FactoredGaussian<N>, dt: f64) {
    let std = SVector::<f64, N>::from_fn(|i, _| if i < 3 { (HELD_PSD[i] * dt).sqrt() } else { 0.0 });
    absorb_diagonal(&mut belief.factor, &std);
}
