//! Properties that any tree must have: two methods agree, information never hurts, errors are as
//! large as the variances say.

use super::cases::*;
use crate::counting::held_bytes;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::estimator::human_dynamics::whole_body::{Posture, WholeBody};
use wheelstate::filter::map::{Map, Numbers, Pattern};
use wheelstate::model::multibody::equations::Base;
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::sensors::{Noise, Quantity, Sensor};
use wheelstate::model::multibody::spatial::Pose;
use wheelstate::model::multibody::tree::{Description, Joint, JointKind, Link, Tree};

struct Draw(ChaCha8Rng);

impl Draw {
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
    fn below(&mut self, n: usize) -> usize {
        self.0.random_range(0..n)
    }
    fn three(&mut self, scale: f64) -> [f64; 3] {
        [self.normal() * scale, self.normal() * scale, self.normal() * scale]
    }
}

/// A tree with general axes, some sliding joints, some links without mass, some fixed joints.
fn random_tree(draw: &mut Draw, links: usize) -> Description {
    let mut description = Description { name: "random".into(), ..Default::default() };
    for k in 0..links {
        let massless = k > 0 && draw.below(6) == 0;
        let mass = if massless { 0.0 } else { 0.2 + 3.0 * draw.normal().abs() };
        let size = [0.1 + 0.1 * draw.normal().abs(), 0.1 + 0.1 * draw.normal().abs(), 0.1];
        let moment = |a: f64, b: f64| mass / 12.0 * (a * a + b * b);
        description.links.push(Link {
            name: format!("l{k}"),
            mass,
            com: if massless { [0.0; 3] } else { draw.three(0.1) },
            inertia: [moment(size[1], size[2]), 0.0, 0.0, moment(size[0], size[2]), 0.0, moment(size[0], size[1])],
        });
        if k > 0 {
            let near = draw.below(4) > 0;
            let parent = if near { k - 1 } else { draw.below(k) };
            let kind = match draw.below(10) {
                0 => JointKind::Prismatic,
                1 => JointKind::Fixed,
                _ => JointKind::Revolute,
            };
            description.joints.push(Joint {
                name: format!("j{k}"),
                kind,
                parent: format!("l{parent}"),
                child: format!("l{k}"),
                xyz: draw.three(0.2),
                rpy: draw.three(0.8),
                axis: draw.three(1.0),
            });
        }
    }
    description
}

fn random_sensors(draw: &mut Draw, tree: &Tree, moving: bool) -> Vec<Sensor> {
    let mut sensors = vec![];
    let variance = |draw: &mut Draw| Noise::Scalar(10f64.powf(-3.0 + 2.0 * draw.normal().abs()));
    for joint in &tree.dof_names {
        if draw.below(10) < 8 {
            sensors.push(Sensor::new(Quantity::JointAcceleration, joint, variance(draw)));
        }
        if draw.below(12) == 0 {
            let quantity = if draw.below(2) == 0 { Quantity::JointTorque } else { Quantity::JointWrench };
            sensors.push(Sensor::new(quantity, joint, variance(draw)));
        }
    }
    for body in tree.bodies.iter().skip(usize::from(!moving)) {
        if draw.below(10) < 8 {
            sensors.push(Sensor::new(Quantity::NetExtWrench, &body.name, Noise::Scalar(1e-4)));
        }
        if draw.below(4) == 0 {
            let pose = Pose::from_xyz_rpy(&draw.three(0.1), &draw.three(0.7));
            sensors.push(Sensor::new(Quantity::Accelerometer, &body.name, variance(draw)).at(pose));
        }
    }
    if moving {
        sensors.push(Sensor::new(Quantity::BaseAcceleration, "", Noise::Scalar(1e-3)));
    } else {
        sensors.push(Sensor::new(Quantity::NetExtWrench, &tree.bodies[0].name, Noise::Scalar(1.0)));
    }
    sensors
}

struct Scene {
    body: WholeBody,
    q: Vec<f64>,
    qd: Vec<f64>,
    samples: Vec<f64>,
}

fn random_scene(draw: &mut Draw, links: usize) -> Option<Scene> {
    let description = random_tree(draw, links);
    let moving = draw.below(2) == 0;
    let base = format!("l{}", draw.below(links));
    let tree = Tree::new(&description, &base, false, &[]).unwrap();
    if !moving && tree.bodies.len() == 1 {
        return None;
    }
    let sensors = random_sensors(draw, &tree, moving);
    let base = if moving { Base::Moving } else { Base::Fixed(Vector3::new(0.5, -1.0, -9.7)) };
    let dof = tree.dof();
    let body = WholeBody::new(tree, base, sensors, &Variances::default()).unwrap();
    let q = (0..dof).map(|_| 0.5 * draw.normal()).collect();
    let qd = (0..dof).map(|_| draw.normal()).collect();
    let samples = (0..body.samples()).map(|_| if draw.below(25) == 0 { f64::NAN } else { draw.normal() }).collect();
    Some(Scene { body, q, qd, samples })
}

impl Scene {
    fn posture(&self) -> Posture<'_> {
        Posture { q: &self.q, qd: &self.qd, base_rate: [0.2, -0.1, 0.3] }
    }
}

/// A5.
#[test]
fn two_methods_agree_on_random_trees() {
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(5));
    let (mut worst_mean, mut worst_variance) = (0.0_f64, 0.0_f64);
    for k in 0..100 {
        let links = if k < 10 { k + 1 } else { 1 + draw.below(200) };
        let Some(mut scene) = random_scene(&mut draw, links) else { continue };
        let mut other = scene.body.clone();
        scene
            .body
            .step(&Posture { q: &scene.q, qd: &scene.qd, base_rate: [0.2, -0.1, 0.3] }, &scene.samples, true)
            .unwrap();
        other.step_by_qr(&scene.posture(), &scene.samples, true).unwrap();
        let scale = 1.0 + other.mean().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let mean = largest_difference(scene.body.mean(), other.mean()) / scale;
        let variance = largest_relative(scene.body.variance(), other.variance());
        worst_mean = worst_mean.max(mean);
        worst_variance = worst_variance.max(variance);
        assert!(mean < 1e-8, "tree {k} of {links} links: mean {mean:e}");
        assert!(variance < 1e-6, "tree {k} of {links} links: variance {variance:e}");
    }
    println!("worst of 100 trees: mean {worst_mean:.1e}, variance {worst_variance:.1e}");
}

/// A9.
#[test]
fn a_sensor_never_raises_a_variance() {
    for name in ["chain3_fixed_L3", "seated12_moving_compact", "seated12_fixed_L2", "human48_LeftFoot_fixed_L3"] {
        let mut case = case(name);
        let all = case.samples.clone();
        let mut before: Option<Vec<f64>> = None;
        // sensors come in one after the other, in eight portions
        for portion in 0..=8 {
            let known = all.len() * portion / 8;
            for (k, sample) in case.samples.iter_mut().enumerate() {
                *sample = if k < known { all[k] } else { f64::NAN };
            }
            case.step_by_qr();
            let now = case.body.variance().to_vec();
            if let Some(before) = before {
                let growth = now.iter().zip(&before).map(|(a, b)| a / b).fold(0.0, f64::max);
                assert!(growth <= 1.0 + 1e-10, "{name}: {growth}");
            }
            before = Some(now);
        }
    }
}

/// A10: truths drawn from the model itself, measurements from them, errors against covariances.
#[test]
fn errors_are_as_large_as_the_variances_say() {
    let case = case("chain3_moving_L3");
    let rows = case.body.equations().rows().clone();
    let (equations, constraints) = (case.body.equations(), case.body.equations().constraint_rows());
    let n = equations.variables();
    let variances = Variances::default();
    let row_variance = variances.of_rows(equations).unwrap();
    let weight: Vec<f64> = row_variance.iter().map(|v| 1.0 / v).collect();
    let precision: Vec<f64> = variances.of_variables(equations).unwrap().iter().map(|v| 1.0 / v).collect();
    let mut only_model = weight.clone();
    only_model[constraints..].fill(0.0);
    let front = vec![0; n];
    let pattern = Pattern {
        unknowns: n,
        start: &rows.start,
        column: &rows.column,
        varies: &rows.varies,
        monitored: 0..0,
        front: &front,
    };
    let mut map = Map::new(&pattern);
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(10));
    let product = |x: &[f64], r: usize| -> f64 {
        (rows.start[r]..rows.start[r + 1]).map(|e| rows.value[e] * x[rows.column[e] as usize]).sum()
    };
    let (mut chi2, mut normalised) = (vec![], vec![]);
    for _ in 0..500 {
        // perturbing every right side by its own noise and solving draws from the model's density
        let mut right: Vec<f64> =
            (0..rows.len()).map(|r| -rows.offset[r] + draw.normal() * row_variance[r].sqrt()).collect();
        let mean: Vec<f64> = precision.iter().map(|p| draw.normal() / p.sqrt()).collect();
        map.solve_by_qr(
            &Numbers { value: &rows.value, right: &right, weight: &only_model, precision: &precision, mean: &mean },
            false,
        )
        .unwrap();
        let truth = map.mean().to_vec();
        for r in 0..rows.len() {
            right[r] = if r < constraints {
                -rows.offset[r]
            } else {
                product(&truth, r) + draw.normal() * row_variance[r].sqrt()
            };
        }
        let zero = vec![0.0; n];
        let numbers =
            Numbers { value: &rows.value, right: &right, weight: &weight, precision: &precision, mean: &zero };
        map.solve(&numbers, true).unwrap();
        let error: Vec<f64> = map.mean().iter().zip(&truth).map(|(m, t)| m - t).collect();
        let of_rows: f64 = (0..rows.len()).map(|r| weight[r] * product(&error, r).powi(2)).sum();
        let of_prior: f64 = precision.iter().zip(&error).map(|(p, e)| p * e * e).sum();
        chi2.push((of_rows + of_prior) / n as f64);
        normalised.push(error.iter().zip(map.variance()).map(|(e, v)| e * e / v).sum::<f64>() / n as f64);
    }
    let average = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    println!("chi2 / dim {:.4}, per variable {:.4}", average(&chi2), average(&normalised));
    assert!((0.9..=1.1).contains(&average(&chi2)));
    assert!((0.9..=1.1).contains(&average(&normalised)));
}

/// The innovations of all sensors have the spread that the model predicts for them.
#[test]
fn the_innovation_statistic_is_one_for_the_models_own_noise() {
    let case = case("chain3_moving_L3");
    let mut body = case.body.clone();
    let posture = Posture { q: &case.q, qd: &case.qd, base_rate: case.base_rate };
    body.step(&posture, &case.samples, true).unwrap();
    let (rows, constraints) = (body.equations().rows().clone(), body.equations().constraint_rows());
    let truth = body.mean().to_vec();
    let variance = Variances::default().of_rows(body.equations()).unwrap();
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(3));
    let mut statistic = vec![];
    for _ in 0..300 {
        let samples: Vec<f64> = (constraints..rows.len())
            .map(|r| {
                let entries = rows.start[r]..rows.start[r + 1];
                let exact: f64 = entries.map(|e| rows.value[e] * truth[rows.column[e] as usize]).sum();
                exact + rows.offset[r] + draw.normal() * variance[r].sqrt()
            })
            .collect();
        body.step(&posture, &samples, true).unwrap();
        let found = body.innovations(|_| true);
        let (nis, channels) = (found.nis, found.rows);
        assert!(channels > 10);
        statistic.push(nis);
    }
    let mean = statistic.iter().sum::<f64>() / statistic.len() as f64;
    println!("mean of the innovation statistic {mean:.3}");
    assert!((0.8..=1.2).contains(&mean), "{mean}");
}

/// The likelihood of a step is the density of its rows by the dense covariance of what is expected.
#[test]
fn the_likelihood_is_that_of_the_dense_covariance() {
    let case = case("chain3_moving_L3");
    let mut body = case.body.clone();
    let posture = Posture { q: &case.q, qd: &case.qd, base_rate: case.base_rate };
    body.step(&posture, &case.samples, true).unwrap();
    let prior = variances(&case.data);
    let rows = body.equations().rows().clone();
    let variance = prior.of_variables(body.equations()).unwrap();
    let mut a = DMatrix::<f64>::zeros(rows.len(), variance.len());
    let mut off = DVector::<f64>::zeros(rows.len());
    let mut covariance = DMatrix::<f64>::zeros(rows.len(), rows.len());
    for r in 0..rows.len() {
        let entries = rows.start[r]..rows.start[r + 1];
        entries.for_each(|e| a[(r, rows.column[e] as usize)] += rows.value[e]);
        let (residual, weight) = body.residual(r);
        covariance[(r, r)] = 1.0 / weight;
        off[r] = residual;
    }
    let mean = DVector::from_column_slice(body.mean());
    off += &a * (mean - DVector::repeat(variance.len(), prior.mean));
    covariance += &a * DMatrix::from_diagonal(&DVector::from_vec(variance)) * a.transpose();
    let factor = covariance.cholesky().unwrap();
    let logarithm: f64 = factor.l().diagonal().iter().map(|d| d.ln()).sum();
    let square = off.dot(&factor.solve(&off));
    let exact = -0.5 * (square + rows.len() as f64 * std::f64::consts::TAU.ln()) - logarithm;
    println!("{} against {exact}", body.log_likelihood());
    assert!((body.log_likelihood() - exact).abs() < 1e-6 * exact.abs());
}

/// A full covariance that is diagonal is the same as its diagonal; a correlated one is the same as
/// measuring whitened combinations.
#[test]
fn a_diagonal_covariance_is_the_same_as_its_variances() {
    let case = case("chain3_fixed_L3");
    let sensors = sensors(&case.data);
    let tree = case.body.equations().tree().clone();
    let base = Base::Fixed(Vector3::from(array::<3>(&case.data["gravity"])));
    let posture = Posture { q: &case.q, qd: &case.qd, base_rate: [0.0; 3] };
    let solve = |noise: &dyn Fn(&Sensor) -> Noise, samples: &[f64]| {
        let sensors = sensors.iter().map(|s| Sensor { noise: noise(s), ..s.clone() }).collect();
        let mut body = WholeBody::new(tree.clone(), base, sensors, &variances(&case.data)).unwrap();
        body.step(&posture, samples, true).unwrap();
        body
    };
    let diagonal = |s: &Sensor| match &s.noise {
        Noise::Scalar(v) => vec![*v; s.quantity.rows()],
        Noise::Diagonal(v) => v.clone(),
        Noise::Full(_) => unreachable!(),
    };
    let full = |s: &Sensor, correlation: f64| {
        let d = diagonal(s);
        let entry = |i: usize, j: usize| (d[i] * d[j]).sqrt() * if i == j { 1.0 } else { correlation };
        Noise::Full((0..d.len() * d.len()).map(|k| entry(k / d.len(), k % d.len())).collect())
    };
    let plain = solve(&|s| s.noise.clone(), &case.samples);
    let same = solve(&|s| full(s, 0.0), &case.samples);
    assert!(largest_difference(plain.mean(), same.mean()) < 1e-9);
    assert!(largest_relative(same.variance(), plain.variance()) < 1e-9);
    let correlated = solve(&|s| full(s, 0.6), &case.samples);
    assert!(largest_difference(plain.mean(), correlated.mean()) > 1e-4);
    // one missing sample takes the whole block with it
    let mut holes = case.samples.clone();
    let last = holes.len() - 1;
    holes[last - 3] = f64::NAN;
    assert_eq!(solve(&|s| full(s, 0.6), &holes).measurements(), case.samples.len() - 6);
}

/// Work and memory of a step grow linearly with the number of links.
#[test]
fn work_is_linear_in_the_number_of_links() {
    let size = |links: usize| {
        let mut draw = Draw(ChaCha8Rng::seed_from_u64(7));
        let description = random_tree(&mut draw, links);
        let tree = Tree::new(&description, "l0", false, &[]).unwrap();
        let sensors = random_sensors(&mut draw, &tree, true);
        let body = WholeBody::new(tree, Base::Moving, sensors, &Variances::default()).unwrap();
        let map = body.map();
        let before = held_bytes();
        let copy = map.clone();
        let held = held_bytes() - before;
        drop(copy);
        (map.ldl().factor_flops() as f64, map.ldl().nonzeros() as f64, held as f64)
    };
    let (small, large) = (size(50), size(200));
    println!("50 links: {small:?}, 200 links: {large:?}");
    for (a, b) in [(small.0, large.0), (small.1, large.1), (small.2, large.2)] {
        assert!(b / a < 5.0, "{a} {b}");
    }
}
