//! The model and the plant against reference values, against each other (they are derived in different
//! ways) and against the balance of energy.

use crate::support::{assert_close, vector_table};
use nalgebra::Vector4;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wheelstate::model::nursing_robot::{Human, Lagrange, Lean, Planar, Position, Robot, Rolling};
use wheelstate::plant::nursing_robot::{Chassis, Command, Motion, NursingRobotPlant, Person, STEP};

fn lagrange() -> Lagrange {
    let (robot, rolling, human) = (Robot::default(), Rolling::default(), Human::default());
    Lagrange { robot, yaw_inertia: 20.0, rolling, human, mass: human.nominal_mass }
}

pub fn plant() -> NursingRobotPlant {
    let Lagrange { robot, yaw_inertia, rolling, human, mass } = lagrange();
    let chassis = Chassis {
        mass: robot.mass,
        track: robot.track,
        wheel_radius: robot.wheel_radius,
        wheel_inertia: robot.wheel_inertia,
        rotating_mass: 0.0,
        yaw_inertia,
        efficiency: 1.0,
        rolling: rolling.coefficient,
        smoothing_speed: rolling.smoothing_speed,
        torque_limit: 21.0,
        motor_lag: 0.0,
    };
    NursingRobotPlant::new(chassis, person(&human, mass))
}

/// The plant's person of `mass` kg, whose relaxed posture is upright.
pub fn person(human: &Human, mass: f64) -> Person {
    Person {
        mass,
        swaying: human.swaying_fraction,
        height: human.com_height,
        gyration: human.gyration_radius,
        stiffness: [human.stiffness_roll, human.stiffness_pitch],
        damping: [human.damping_roll, human.damping_pitch],
        rest: [0.0; 2],
    }
}

/// A random motion as in the energy check of the specification.
fn random_motion(rng: &mut ChaCha8Rng) -> Motion {
    let mut draw = |limit: f64| rng.random_range(-limit..limit);
    Motion {
        pose: [0.0, 0.0, draw(3.0)],
        sway: [draw(0.4), draw(0.4)],
        drive: [draw(1.4), draw(1.0)],
        sway_rate: [draw(2.0), draw(2.0)],
    }
}

/// P2: accelerations and energy of 20 random states, for the plant and for the model.
#[test]
fn accelerations_and_energy_match_the_reference() {
    let table = vector_table("nursing_robot/plant_rhs.csv");
    let (model, mut plant) = (lagrange(), plant());
    for row in 0..table.rows.len() {
        let at = |name: &str| table.at(row, name);
        let wheels = [at("tau_l"), at("tau_r")];
        plant.motion = Motion {
            pose: [at("x"), at("y"), at("theta")],
            sway: [at("phi_x"), at("phi_y")],
            drive: [at("v"), at("omega")],
            sway_rate: [at("phixd"), at("phiyd")],
        };
        let rates = plant.rates(&plant.motion, wheels, [0.0; 2]);
        assert_close("d_x", rates.pose[0], at("d_x"), 1e-9, 1e-9);
        assert_close("d_y", rates.pose[1], at("d_y"), 1e-9, 1e-9);
        let expected = ["d_v", "d_omega", "d_phixd", "d_phiyd"].map(at);
        let of_plant = [rates.drive[0], rates.drive[1], rates.sway_rate[0], rates.sway_rate[1]];
        let q = Position::from([at("x"), at("y"), at("theta"), at("phi_x"), at("phi_y")]);
        let nu = Vector4::new(at("v"), at("omega"), at("phixd"), at("phiyd"));
        let of_model = model.acceleration(&q, &nu, wheels, [0.0; 2]).expect("positive definite");
        for i in 0..4 {
            assert_close(&format!("plant row {row} acceleration {i}"), of_plant[i], expected[i], 1e-9, 1e-9);
            assert_close(&format!("model row {row} acceleration {i}"), of_model[i], expected[i], 1e-9, 1e-9);
        }
        let (kinetic, potential) = model.energy(&q, &nu);
        assert_close("energy of the plant", plant.energy(), at("energy"), 1e-9, 0.0);
        assert_close("energy of the model", kinetic + potential, at("energy"), 1e-9, 0.0);
    }
}

/// The Lagrangian model and the plant agree under active hip torques too, and so does the planar model.
#[test]
fn the_model_equals_the_plant_that_is_derived_another_way() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (model, mut plant) = (lagrange(), plant());
    let planar = Planar::new(&model.robot, &model.rolling, &model.human, model.mass);
    for _ in 0..200 {
        plant.motion = random_motion(&mut rng);
        let mut draw = |limit: f64| rng.random_range(-limit..limit);
        let (wheels, hip) = ([draw(20.0), draw(20.0)], [draw(50.0), draw(50.0)]);
        let rates = plant.rates(&plant.motion, wheels, hip);
        let Motion { pose, sway, drive, sway_rate } = plant.motion;
        let q = Position::from([pose[0], pose[1], pose[2], sway[0], sway[1]]);
        let nu = Vector4::new(drive[0], drive[1], sway_rate[0], sway_rate[1]);
        let expected = model.acceleration(&q, &nu, wheels, hip).expect("positive definite");
        for (i, value) in [rates.drive[0], rates.drive[1], rates.sway_rate[0], rates.sway_rate[1]].iter().enumerate() {
            assert_close("acceleration", *value, expected[i], 1e-10, 1e-10);
        }

        // Without roll, turning and moment the planar equations hold exactly, also for a given yaw rate.
        plant.motion.sway[0] = 0.0;
        plant.motion.sway_rate[0] = 0.0;
        let Motion { sway, drive, sway_rate, .. } = plant.motion;
        let force = model.robot.drive_force(wheels[0], wheels[1]) - planar.rolling_resistance(drive[0]);
        let (v_dot, phi_ddot) = planar.acceleration(force, &Lean::new(sway[1]), sway_rate[1], drive[1], hip[1]);
        let rates = plant.rates(&plant.motion, wheels, [0.0, hip[1]]);
        assert_close("v'", v_dot, rates.drive[0], 1e-12, 1e-12);
        assert_close("phi''", phi_ddot, rates.sway_rate[1], 1e-12, 1e-12);
        plant.torque = wheels;
        let truth = plant.forces([0.0, hip[1]]);
        assert_close(
            "F_phi",
            planar.sway_force(&Lean::new(sway[1]), sway_rate[1], phi_ddot, drive[1]),
            truth.sway_force,
            1e-10,
            1e-10,
        );
        // F = F_f + Mt v' + F_phi
        assert_close("force balance", force, planar.inertial_mass * v_dot + truth.sway_force, 1e-10, 1e-10);
    }
}

/// P1: no torque, no step in which energy grows; without losses none in which it changes.
#[test]
fn energy_never_grows_without_drive() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..50 {
        let mut lossy = plant();
        lossy.motion = random_motion(&mut rng);
        let mut lossless = lossy.clone();
        lossless.chassis.rolling = 0.0;
        lossless.person.damping = [0.0; 2];
        let (start, mut last) = (lossless.energy(), lossy.energy());
        for _ in 0..(5.0 / STEP) as usize {
            lossy.advance(&Command::Torque([0.0; 2]), [0.0; 2]);
            lossless.advance(&Command::Torque([0.0; 2]), [0.0; 2]);
            let now = lossy.energy();
            assert!(now - last <= 1e-9, "energy grew by {:e} J", now - last);
            last = now;
        }
        assert_close("lossless energy", lossless.energy(), start, 1e-9, 0.0);
    }
}

/// `M' - 2 V` is skew: `V(q, q') q'` does no work that the kinetic energy does not show.
#[test]
fn coriolis_matrix_is_skew_to_the_change_of_inertia() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let model = lagrange();
    for _ in 0..50 {
        let mut draw = || rng.random_range(-1.0..1.0);
        let q = Position::from_fn(|_, _| draw());
        let q_dot = Position::from_fn(|_, _| draw());
        let h = 1e-6;
        let rate = (model.inertia(&(q + q_dot * h)).0 - model.inertia(&(q - q_dot * h)).0) / (2.0 * h);
        let skew = rate - model.coriolis(&model.inertia(&q).1, &q_dot) * 2.0;
        assert!((skew + skew.transpose()).amax() < 1e-7, "{:e}", (skew + skew.transpose()).amax());
    }
}

/// The sum of angles that spares sines and cosines agrees with them to rounding, near and far.
#[test]
fn a_lean_that_moves_keeps_its_sine_and_cosine() {
    for k in -400..400 {
        let from = f64::from(k) * 0.01;
        for j in -200..200 {
            let to = from + f64::from(j) * 0.001;
            let lean = Lean::new(from).moved_to(to);
            assert!((lean.sin - to.sin()).abs() < 1e-15 && (lean.cos - to.cos()).abs() < 1e-15, "{from} to {to}");
        }
    }
}
