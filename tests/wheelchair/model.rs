//! The wheelchair's model against the reference points and against differences.

use super::chairs::reference_chair;
use crate::support::{assert_close, vector_table, vector_text};
use nalgebra::{SMatrix, SVector};
use wheelstate::estimator::wheelchair::attitude::attitude;
use wheelstate::filter::discretise::{runge_kutta, transition, white_rate_noise};
use wheelstate::model::wheelchair::{
    self as model, Chair, ChairParameters, Command, ImuParameters, Output, RollingParameters, biased_gravity, gravity,
};
use wheelstate::plant::wheelchair::Body;

/// One row of a reference file: variant, then numbers by column name.
struct Point {
    variant: String,
    columns: std::rc::Rc<Vec<String>>,
    cells: Vec<f64>,
}

impl Point {
    fn get(&self, name: &str) -> f64 {
        self.cells[self.columns.iter().position(|c| c == name).unwrap_or_else(|| panic!("no column {name}"))]
    }
    fn vector<const N: usize>(&self, prefix: &str) -> SVector<f64, N> {
        SVector::from_fn(|i, _| self.get(&format!("{prefix}{}", i + 1)))
    }
    fn matrix<const M: usize, const N: usize>(&self, prefix: &str) -> SMatrix<f64, M, N> {
        SMatrix::from_fn(|i, j| self.get(&format!("{prefix}{}_{}", i + 1, j + 1)))
    }
}

fn points(name: &str) -> Vec<Point> {
    let text = vector_text(&format!("wheelchair/{name}"));
    let mut lines = text.lines();
    let columns: Vec<String> = lines.next().unwrap().split(',').skip(1).map(str::to_owned).collect();
    let columns = std::rc::Rc::new(columns);
    lines
        .map(|line| {
            let mut cells = line.split(',');
            let variant = cells.next().unwrap().to_owned();
            Point { variant, columns: columns.clone(), cells: cells.map(|c| c.parse().unwrap()).collect() }
        })
        .collect()
}

#[track_caller]
fn close<const M: usize, const N: usize>(what: &str, actual: &SMatrix<f64, M, N>, expected: &SMatrix<f64, M, N>) {
    for (k, (a, e)) in actual.iter().zip(expected.iter()).enumerate() {
        assert_close(&format!("{what}[{}, {}]", k % M, k / M), *a, *e, 1e-9, 1e-12);
    }
}

/// All rows of a Jacobian of which the first `K` are not zero.
fn whole<const K: usize, const N: usize>(rows: &SMatrix<f64, K, N>) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(|i, j| if i < K { rows[(i, j)] } else { 0.0 })
}

#[test]
fn motion_and_sensors_match_the_reference_points() {
    for point in points("fh_points.csv") {
        let chair = reference_chair(&point.variant);
        let (x, u) = (point.vector::<6>("x"), Command::new(point.get("u_f"), point.get("u_r")));
        let still = point.get("still") == 1.0;
        close(&point.variant, &model::derivative(&chair, &x, &u, still), &point.vector("f"));
        close(&point.variant, &model::output(&chair, &x, &u, still), &point.vector("h"));
    }
}

#[test]
fn jacobians_match_the_reference_points() {
    for point in points("jac_points.csv") {
        let chair = reference_chair(&point.variant);
        let (x, u) = (point.vector::<6>("x"), Command::new(point.get("u_f"), point.get("u_r")));
        let still = point.get("still") == 1.0;
        let (rate, jacobian) = model::linearise(&chair, &x, &u, still);
        let observed = model::observe(&chair, &x, &u, still);
        close(&point.variant, &whole::<5, 6>(&jacobian), &point.matrix("F"));
        close(&point.variant, &observed.jacobian, &point.matrix("H"));
        assert_eq!(rate, model::derivative(&chair, &x, &u, still));
        assert_eq!(observed.output, model::output(&chair, &x, &u, still));
        assert_eq!(observed.tilt_lever, model::tilt_lever(&chair, x[model::ALPHA]));
    }
}

#[test]
fn discretisation_matches_the_reference_points() {
    for point in points("disc_points.csv") {
        let chair = reference_chair(&point.variant);
        let (x, u, dt) = (point.vector::<6>("x"), Command::new(point.get("u_f"), point.get("u_r")), point.get("dt"));
        let still = point.get("still") == 1.0;
        let next = runge_kutta(&x, dt, |x| model::derivative(&chair, x, &u, still));
        close("x", &next, &point.vector("xn"));
        let jacobian = model::linearise(&chair, &x, &u, still).1;
        let mut phi = whole::<5, 6>(&transition(&jacobian, dt));
        phi[(model::W, model::W)] = 1.0; // the slope's rate stays
        close("Phi", &phi, &point.matrix("Phi"));
        let q = point.matrix::<6, 6>("Q");
        for (density, position, rate) in
            [(4e-3, model::S, model::V), (4e-3, model::ALPHA, model::R), (0.5, model::XI, model::W)]
        {
            let (a, b, c) = white_rate_noise(density, dt);
            assert_close("Q", a, q[(position, position)], 1e-9, 1e-12);
            assert_close("Q", b, q[(position, rate)], 1e-9, 1e-12);
            assert_close("Q", c, q[(rate, rate)], 1e-9, 1e-12);
        }
        let mut r = SMatrix::<f64, 6, 6>::from_diagonal(&SVector::from([0.0, 0.0, 2.5e-5, 2.5e-3, 2.5e-3, 2.5e-3]));
        r.fixed_view_mut::<2, 2>(0, 0).copy_from(&model::encoder_covariance(&chair, 3e-3));
        let lever = model::tilt_lever(&chair, x[model::ALPHA]);
        let mut accelerometer = r.fixed_view_mut::<3, 3>(3, 3);
        accelerometer += lever * lever.transpose();
        close("R", &r, &point.matrix("R"));
    }
}

#[test]
fn encoder_geometry_matches_the_reference_and_inverts() {
    let mut chair = reference_chair("full");
    chair.heading_reference = 1.0;
    let table = vector_table("wheelchair/encoder.csv");
    for row in 0..table.rows.len() {
        let (right, left) = (table.at(row, "theta_r"), table.at(row, "theta_l"));
        let (travel, heading) = model::wheel_travel(&chair, right, left);
        assert_close("s_enc", travel, table.at(row, "s_enc"), 1e-9, 1e-12);
        assert_close("alpha_enc", heading, table.at(row, "alpha_enc"), 1e-9, 1e-12);
        let (back_right, back_left) = model::wheel_angles(&chair, travel, heading);
        assert_close("theta_r", back_right, right, 1e-9, 1e-12);
        assert_close("theta_l", back_left, left, 1e-9, 1e-12);
    }
}

#[test]
fn counters_unwrap_both_ways_across_their_ends() {
    for bits in [8, 12, 16, 32] {
        let range = 1_u64 << bits;
        let mut counter = model::Unwrapper::new(bits);
        let mut truth = 5_i64;
        assert_eq!(counter.update(truth as u64), truth);
        for step in (0..4000).map(|k| ((k * 7919) % (range as i64 - 3)) / 2 - (range as i64) / 4) {
            truth += step;
            assert_eq!(counter.update(truth.rem_euclid(range as i64) as u64), truth, "{bits} bits");
        }
    }
}

/// Central differences of a vector function.
fn differences<const M: usize, const N: usize>(
    x: &SVector<f64, N>,
    function: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
) -> SMatrix<f64, M, N> {
    let mut jacobian = SMatrix::<f64, M, N>::zeros();
    for k in 0..N {
        let step = 1e-5;
        let (mut up, mut down) = (*x, *x);
        up[k] += step;
        down[k] -= step;
        jacobian.set_column(k, &((function(&up) - function(&down)) / (2.0 * step)));
    }
    jacobian
}

#[track_caller]
fn same_slope<const M: usize, const N: usize>(what: &str, actual: &SMatrix<f64, M, N>, expected: &SMatrix<f64, M, N>) {
    for (k, (a, e)) in actual.iter().zip(expected.iter()).enumerate() {
        assert_close(&format!("{what}[{}, {}]", k % M, k / M), *a, *e, 1e-6, 1e-6);
    }
}

#[test]
fn jacobians_of_all_forms_are_the_derivatives_of_their_functions() {
    for point in points("jac_points.csv") {
        let chair = reference_chair(&point.variant);
        let u = Command::new(point.get("u_f"), point.get("u_r"));
        let x6 = point.vector::<6>("x");
        for still in [false, true] {
            let mut x = model::BiasedState::zeros();
            x.fixed_rows_mut::<6>(0).copy_from(&x6);
            x.fixed_rows_mut::<7>(6).copy_from(&SVector::from([0.01, -0.04, 0.03, 0.05, 0.2, 0.1, -4.0]));
            let rate = |x: &_| model::biased_derivative(&chair, x, &u, still);
            same_slope("biased F", &whole(&model::biased_linearise(&chair, &x, &u, still).1), &differences(&x, rate));
            let sensors = |x: &_| model::biased_output(&chair, x, &u, still);
            same_slope("biased H", &model::biased_observe(&chair, &x, &u, still).jacobian, &differences(&x, sensors));
            let driven = |x: &_| model::acceleration_driven(&chair, x, &u, 0.7, still);
            let (rate, jacobian) = model::acceleration_driven_linearise(&chair, &x, &u, 0.7, still);
            same_slope("driven F", &whole(&jacobian), &differences(&x, driven));
            close("driven f", &rate, &driven(&x));

            let (sa, ca) = x6[1].sin_cos();
            let tilt = x6[4].sin();
            let x =
                gravity::State::from([x6[0], x6[1], x6[2], x6[3], sa * tilt, ca * tilt, x6[5] * sa, x6[5] * ca + 0.1]);
            let rate = |x: &_| gravity::derivative(&chair, x, &u, still);
            same_slope("gravity F", &whole(&gravity::linearise(&chair, &x, &u, still).1), &differences(&x, rate));
            let sensors = |x: &_| gravity::output(&chair, x, &u, still);
            same_slope("gravity H", &gravity::observe(&chair, &x, &u, still).1, &differences(&x, sensors));

            let mut all = biased_gravity::State::zeros();
            all.fixed_rows_mut::<8>(0).copy_from(&x);
            all.fixed_rows_mut::<7>(8).copy_from(&SVector::from([0.01, -0.04, 0.03, 0.05, 0.1, -4.0, 1.5]));
            let rate = |x: &_| biased_gravity::derivative(&chair, x, &u, still);
            let jacobian = whole(&biased_gravity::linearise(&chair, &all, &u, still).1);
            same_slope("biased gravity F", &jacobian, &differences(&all, rate));
            let sensors = |x: &_| biased_gravity::output(&chair, x, &u, still);
            let jacobian = biased_gravity::observe(&chair, &all, &u, still).1;
            same_slope("biased gravity H", &jacobian, &differences(&all, sensors));
            let rate = |x: &_| biased_gravity::driven_derivative(&chair, x, &u, 0.7, still);
            let jacobian = whole(&biased_gravity::driven_linearise(&chair, &all, &u, 0.7, still).1);
            same_slope("driven gravity F", &jacobian, &differences(&all, rate));
        }
    }
}

/// The same pose in both forms moves and reads the same.
#[test]
fn gravity_form_agrees_with_heading_and_slope() {
    for point in points("fh_points.csv").iter().filter(|p| p.variant == "full_rich" || p.variant == "full") {
        let chair = reference_chair(&point.variant);
        let u = Command::new(point.get("u_f"), point.get("u_r"));
        let x = point.vector::<6>("x");
        let still = point.get("still") == 1.0;
        let ((sa, ca), (sx, cx)) = (x[1].sin_cos(), x[4].sin_cos());
        let g = gravity::State::from([x[0], x[1], x[2], x[3], sa * sx, ca * sx, x[5] * sa, x[5] * ca]);
        // Less what the tilt's rate does in second order through the sensor's lever.
        let (p, q, [dx, dy, dz]) = (g[gravity::WR], -g[gravity::WP], chair.lever());
        let centripetal = [0.0, 0.0, 0.0, p * q * dy - dx * q * q, p * q * dx - dy * p * p, -dz * (p * p + q * q)];
        let expected = model::output(&chair, &x, &u, still) - Output::from(centripetal);
        close("h", &gravity::output(&chair, &g, &u, still), &expected);
        let (f, fg) = (model::derivative(&chair, &x, &u, still), gravity::derivative(&chair, &g, &u, still));
        for k in 0..4 {
            assert_close("motion", fg[k], f[k], 1e-12, 1e-12);
        }
        // d/dt of sin(alpha) sin(xi) and cos(alpha) sin(xi)
        assert_close("gx'", fg[4], x[3] * ca * sx + x[5] * sa * cx, 1e-12, 1e-12);
        assert_close("gy'", fg[5], -x[3] * sa * sx + x[5] * ca * cx, 1e-12, 1e-12);
    }
}

/// The plant shares no code with the model, so that nothing but this keeps their chairs alike.
#[test]
fn the_plant_is_by_default_the_chair_that_the_estimator_knows() {
    let (plant, chair) = (Body::default(), ChairParameters::default());
    let (rolling, imu) = (RollingParameters::default(), ImuParameters::default());
    let model = Chair::new(chair, rolling, imu);
    for (name, plant, model) in [
        ("mass", plant.mass, chair.mass),
        ("yaw_inertia", plant.yaw_inertia, chair.yaw_inertia),
        ("com_ahead", plant.com_ahead, chair.com_ahead),
        ("drag", plant.drag, chair.drag),
        ("yaw_drag", plant.yaw_drag, chair.yaw_drag),
        ("yaw_friction", plant.yaw_friction, chair.yaw_friction),
        ("rolling_coefficient", plant.rolling_coefficient, rolling.coefficient),
        ("smoothing_speed", plant.smoothing_speed, rolling.smoothing_speed),
        ("smoothing_yaw_rate", plant.smoothing_yaw_rate, rolling.smoothing_yaw_rate),
        ("wheel_radius", plant.wheel_radius, chair.wheel_radius),
        ("wheel_inertia", plant.wheel_inertia, chair.wheel_inertia),
        ("track", plant.track, chair.track()),
        ("gravity", plant.gravity, model.gravity),
    ] {
        assert_eq!(plant, model, "{name}");
    }
    assert_eq!(plant.imu, model.lever());
}

/// The heading of a tilt too small to see is unknown, whatever the mean says.
#[test]
fn attitude_of_flat_ground_claims_nothing() {
    let mut x = gravity::State::zeros();
    let covariance = SMatrix::from_diagonal(&SVector::from([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-4, 1e-4]));
    let flat = attitude(&x, &covariance);
    assert_close("heading std", flat.heading.std, std::f64::consts::PI / 3.0_f64.sqrt(), 1e-12, 0.0);
    assert!(flat.slope.std >= 1e-3 && flat.slope.value == 0.0);
    x[gravity::GX] = 0.08;
    let climbing = attitude(&x, &covariance);
    assert_close("heading", climbing.heading.value, std::f64::consts::FRAC_PI_2, 1e-12, 0.0);
    assert_close("heading std", climbing.heading.std, 1e-3 / 0.08, 1e-9, 0.0);
    assert_close("pitch", climbing.pitch.value, 0.08_f64.asin(), 1e-12, 0.0);
}
