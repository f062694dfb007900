//! The mass and sway filters against reference vectors, sample by sample.

use crate::support::{Table, assert_close, vector_table};
use wheelstate::Estimator;
use wheelstate::estimator::nursing_robot::mass::{MassEstimator, MassSample};
use wheelstate::estimator::nursing_robot::sway::{SwayBelief, SwayEstimator, SwaySample};
use wheelstate::estimator::nursing_robot::{Inputs, Law, NursingRobot, Outputs, Parameters, SwayModel};

const DT: f64 = 0.01;

fn drive_force(p: &Parameters, log: &Table, row: usize) -> f64 {
    p.robot.drive_force(log.at(row, "tau_l"), log.at(row, "tau_r"))
}

/// M1: estimate, covariance, forgetting, error, regressor and status of every sample.
fn mass_follows(name: &str, law: Law, compensate: bool) {
    let log = vector_table("nursing_robot/input_log.csv");
    let expected = vector_table(&format!("nursing_robot/{name}.csv"));
    let mut p = Parameters::default();
    (p.mass.law, p.mass.compensate_sway) = (law, compensate);
    let estimator = MassEstimator::new(&p);
    let mut state = estimator.start();
    for row in 0..log.rows.len() {
        let sample =
            MassSample { force: drive_force(&p, &log, row), speed: log.at(row, "v"), specific_force: f64::NAN };
        let status = estimator.step(&mut state, &sample, DT);
        let rls = &state.rls;
        let check = |column: &str, value: f64| {
            let reference = expected.at(row, column);
            assert_close(&format!("{name} row {row} {column}"), value, reference, 1e-9, 1e-9);
        };
        assert_eq!(status as i32, expected.at(row, "status") as i32, "{name} row {row} status");
        check("m_h", if rls.valid { rls.estimate } else { f64::NAN });
        check("H", rls.covariance);
        check("lambda", rls.forgetting);
        check("eps", rls.innovation);
        check("E", state.regressor);
        check("y", state.measurement);
    }
}

#[test]
fn mass_with_exponential_forgetting_and_sway_compensation_matches_the_reference() {
    mass_follows("taffrls_exp_comp", Law::Exponential, true);
}

#[test]
fn mass_with_threshold_forgetting_and_sway_compensation_matches_the_reference() {
    mass_follows("taffrls_pw_comp", Law::Threshold, true);
}

#[test]
fn mass_with_exponential_forgetting_and_plain_regressor_matches_the_reference() {
    mass_follows("taffrls_exp_plain", Law::Exponential, false);
}

#[test]
fn mass_with_fixed_forgetting_and_plain_regressor_matches_the_reference() {
    mass_follows("taffrls_ffrls_plain", Law::Fixed, false);
}

/// U1: mean, variances, noise, scale, innovation, forces and status of every sample.
fn sway_follows(name: &str, change: impl Fn(&mut Parameters)) {
    let log = vector_table("nursing_robot/input_log.csv");
    let expected = vector_table(&format!("nursing_robot/{name}.csv"));
    let mut p = Parameters::default();
    change(&mut p);
    let estimator = SwayEstimator::new(&p).expect("a swaying body");
    let mut state = estimator.start();
    for row in 0..log.rows.len() {
        let force = drive_force(&p, &log, row);
        let channels = [log.at(row, "v"), log.at(row, "phi_y"), log.at(row, "gyro_y")];
        let sample = SwaySample { force, yaw_rate: log.at(row, "omega"), channels };
        let done = estimator.step(&mut state, &sample, log.at(row, "m_h_true"), DT);
        let check = |column: &str, value: f64| {
            let reference = expected.at(row, column);
            assert_close(&format!("{name} row {row} {column}"), value, reference, 1e-7, 1e-7);
        };
        assert_eq!(done.status as i32, expected.at(row, "status") as i32, "{name} row {row} status");
        let (mean, variance): (Vec<f64>, Vec<f64>) = match &state.belief {
            SwayBelief::Two(b) => (b.mean.iter().copied().collect(), b.covariance.diagonal().iter().copied().collect()),
            SwayBelief::Three(b) => {
                (b.mean.iter().copied().collect(), b.covariance.diagonal().iter().copied().collect())
            }
            SwayBelief::Four(b) => {
                (b.mean.iter().copied().collect(), b.covariance.diagonal().iter().copied().collect())
            }
        };
        for (i, (mean, variance)) in mean.into_iter().zip(variance).enumerate() {
            check(&format!("x{i}"), mean);
            // Variances are small: compared relative to themselves.
            let column = format!("P{i}{i}");
            assert_close(&format!("{name} row {row} {column}"), variance, expected.at(row, &column), 1e-7, 1e-15);
        }
        for (i, noise) in state.noise.variance.iter().enumerate() {
            let column = format!("R{i}");
            if expected.columns.contains(&column) {
                assert_close(&format!("{name} row {row} {column}"), *noise, expected.at(row, &column), 1e-7, 1e-15);
            }
        }
        check("kq", state.scale.scale);
        check("nis", done.innovation.nis);
        let estimate = estimator.estimate(&state, f64::NAN, 0.0);
        check("F_phi", estimate.force.value);
        check("tau_hip", estimate.torque.value);
    }
}

#[test]
fn sway_with_the_printed_model_matches_the_reference() {
    sway_follows("ukf_paper_raw", |p| (p.sway.model, p.sway.adaptive) = (SwayModel::PaperRaw, false));
}

#[test]
fn sway_with_the_printed_model_in_corrected_units_matches_the_reference() {
    sway_follows("ukf_paper", |p| (p.sway.model, p.sway.adaptive) = (SwayModel::Paper, false));
}

#[test]
fn sway_with_the_sound_model_and_fixed_noise_matches_the_reference() {
    sway_follows("ukf_sound_fixed", |p| {
        (p.sway.model, p.sway.adaptive, p.sway.process_psd.hip_torque) = (SwayModel::Sound, false, 2.0);
    });
}

#[test]
fn sway_with_the_sound_model_and_adapted_noise_matches_the_reference() {
    sway_follows("ukf_sound_adaptive", |p| p.sway.model = SwayModel::Auto);
}

#[test]
fn sway_with_tilt_and_tilt_rate_matches_the_reference() {
    sway_follows("ukf_sound_d_imu", |p| (p.sway.use_tilt, p.sway.use_tilt_rate) = (true, true));
}

/// The whole estimator as declared gives the masses of the reference, whatever the sway filter does.
#[test]
fn the_estimator_as_declared_gives_the_reference_masses() {
    let log = vector_table("nursing_robot/input_log.csv");
    let expected = vector_table("nursing_robot/taffrls_exp_comp.csv");
    let mut estimator = NursingRobot::new(&Parameters::default()).unwrap();
    let mut out = Outputs::default();
    for row in 0..log.rows.len() {
        let inputs = Inputs {
            torque_left: log.at(row, "tau_l"),
            torque_right: log.at(row, "tau_r"),
            speed: log.at(row, "v"),
            yaw_rate: log.at(row, "omega"),
            ..Inputs::default()
        };
        estimator.step(&inputs, DT);
        estimator.outputs(&inputs, 0.0, &mut out);
        let mass = expected.at(row, "m_h");
        assert_eq!(out.mass_valid, mass.is_finite(), "row {row}");
        assert_close(&format!("row {row}"), out.load_mass.value, if mass.is_nan() { 70.0 } else { mass }, 1e-9, 1e-9);
        assert_eq!(out.mass_status as i32, expected.at(row, "status") as i32, "row {row}");
        assert_close("forgetting", out.forgetting_factor, expected.at(row, "lambda"), 1e-9, 1e-9);
    }
}
