//! A machine that is not in the tree, added through the public seams alone: a road vehicle on a grade, three states.
//!
//! In the tree the same would be the files of `src/lib.rs`'s list: model, estimator, plant, a folder of `vehicles`, a
//! picture, and one line in each of the two lists. Nothing here names a file of another machine, and no file of the
//! tree knows this one.

use crate::support::median;
use nalgebra::{SMatrix, SVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use wheelstate::estimator::{Diagnostics, Elapsed, Estimator, Machine, Outcome, Rules, Sampled, StateError};
use wheelstate::filter::discretise::{runge_kutta, transition};
use wheelstate::filter::ekf::{self, Rows};
use wheelstate::filter::gaussian::Gaussian;
use wheelstate::variable::Estimate;
use wheelstate::{ParameterError, Status, Variables, variables};
use wheelstate_identify::check::Checks;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::{FitError, FitRequest, Problem, Session, Target, Task};
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::{Manoeuvres, Request, Scenario, SimulateError, Simulation};
use wheelstate_identify::solve;
use wheelstate_identify::tune::{Objective, TuneRequest};
use wheelstate_identify::vehicle::{Seat, Vehicle};

/// The model: `v' = F/m - f g - k v^2 - g sin(theta)`, `a_x = v' + g sin(theta)`.
mod model {
    use super::*;

    pub const GRAVITY: f64 = 9.80665;
    /// Speed, grade, drag coefficient over mass.
    pub type State = SVector<f64, 3>;

    variables! {
        /// The road vehicle.
        pub struct Road {
            /// Mass.
            mass: f64 = 1400.0, "kg", [1.0, 1e5];
            /// Rolling resistance coefficient.
            rolling: f64 = 0.01, "1", [0.0, 1.0];
        }
    }

    impl Road {
        pub fn specific_force(&self, x: &State, force: f64) -> f64 {
            force / self.mass - self.rolling * GRAVITY - x[2] * x[0] * x[0]
        }

        pub fn derivative(&self, x: &State, force: f64) -> State {
            State::new(self.specific_force(x, force) - GRAVITY * x[1].sin(), 0.0, 0.0)
        }

        /// Derivatives of specific force and acceleration over the state.
        pub fn gradients(&self, x: &State) -> [SMatrix<f64, 1, 3>; 2] {
            let force = SMatrix::from([[-2.0 * x[2] * x[0]], [0.0], [-x[0] * x[0]]]);
            let mut acceleration = force;
            acceleration[1] = -GRAVITY * x[1].cos();
            [force, acceleration]
        }
    }
}

variables! {
    /// Densities.
    pub struct Densities {
        /// Unmodelled acceleration.
        speed: f64 = 1e-3, "m2/s3", [0.0, 10.0], tunable, process_noise;
        /// Change of the grade.
        grade: f64 = 1e-5, "rad2/s", [0.0, 1.0], tunable, process_noise;
        /// Change of the drag.
        drag: f64 = 1e-12, "m-2.s-1", [0.0, 1.0], tunable, process_noise;
    }
}

variables! {
    /// Sensors.
    pub struct Sensors {
        /// Speed.
        speed: f64 = 0.05, "m/s", [1e-6, 10.0], tunable, measurement_noise;
        /// Accelerometer.
        accel_x: f64 = 0.05, "m/s2", [1e-6, 10.0], tunable, measurement_noise;
    }
}

variables! {
    /// The filter.
    pub struct Filter {
        /// Process noise.
        process_psd: Densities;
        /// Measurement noise.
        measurement_std: Sensors;
    }
}

variables! {
    /// Parameters.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.05, "s", [1e-4, 1.0];
        /// The vehicle.
        road: model::Road;
        /// The filter.
        filter: Filter;
    }
}

variables! {
    /// Inputs.
    pub struct Inputs {
        /// Drive force at the wheels.
        drive_force: f64 = f64::NAN, "N", [-1e5, 1e5], held;
        /// Speed.
        speed: f64 = f64::NAN, "m/s", [-100.0, 100.0], measured;
        /// Forward specific force.
        accel_x: f64 = f64::NAN, "m/s2", [-50.0, 50.0], measured;
    }
}

variables! {
    /// Outputs.
    pub struct Outputs {
        /// Speed.
        speed_estimate: Estimate = Estimate::NONE, "m/s";
        /// Grade of the road.
        grade: Estimate = Estimate::NONE, "rad";
        /// What every estimator says.
        @flat diagnostics: Diagnostics;
    }
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct State {
    belief: Gaussian<3>,
    force: f64,
}

#[derive(Clone)]
struct RoadMachine {
    parameters: Parameters,
}

impl RoadMachine {
    fn predict(&self, state: &mut State, dt: f64) {
        let (road, force, q) = (&self.parameters.road, state.force, &self.parameters.filter.process_psd);
        let [_, gradient] = road.gradients(&state.belief.mean);
        let mean = runge_kutta(&state.belief.mean, dt, |x| road.derivative(x, force));
        ekf::predict(&mut state.belief, mean, &transition(&gradient, dt));
        for (k, density) in [q.speed, q.grade, q.drag].into_iter().enumerate() {
            state.belief.inflate(k, density * dt);
        }
    }
}

impl Machine for RoadMachine {
    const NAME: &'static str = "RoadVehicle";
    const DESCRIPTION: &'static str = "Speed and grade of a road vehicle";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<(Self, State), ParameterError> {
        let std = SVector::from([5.0, 0.05, 5e-5]);
        let belief = Gaussian::independent(SVector::from([0.0, 0.0, 3e-4]), &std);
        Ok((Self { parameters: parameters.clone() }, State { belief, force: 0.0 }))
    }

    fn rules(parameters: &Parameters) -> Rules {
        let (sample_period, longest_gap) = (parameters.sample_period, 2.0);
        Rules { sample_period, longest_gap, limits: Vec::new(), unused: Vec::new() }
    }

    fn sample(&mut self, state: &mut State, inputs: &Inputs, _: Status, elapsed: Elapsed) -> Outcome {
        match elapsed {
            Elapsed::First => {}
            Elapsed::Step(dt) => self.predict(state, dt),
            Elapsed::Gap(_) => state.belief.reset_state(0, state.belief.mean[0], 100.0),
        }
        state.force = inputs.drive_force;
        let (road, x) = (&self.parameters.road, state.belief.mean);
        let [force_gradient, _] = road.gradients(&x);
        let r = &self.parameters.filter.measurement_std;
        let rows = Rows {
            innovation: SVector::from([inputs.speed - x[0], inputs.accel_x - road.specific_force(&x, state.force)]),
            jacobian: SMatrix::from_rows(&[SMatrix::from([[1.0], [0.0], [0.0]]), force_gradient]),
            noise: SMatrix::from_diagonal(&SVector::from([r.speed * r.speed, r.accel_x * r.accel_x])),
            used: [inputs.speed.is_finite(), inputs.accel_x.is_finite()],
        };
        let Ok(innovation) = ekf::correct(&mut state.belief, &rows, None) else { return Outcome::default() };
        Outcome {
            status: Status::OK,
            nis: innovation.nis,
            channels: innovation.dof,
            log_likelihood: innovation.log_likelihood,
            used: innovation.used_count() > 0,
            ..Outcome::default()
        }
    }

    fn estimates(&self, state: &State, inputs: &Inputs, horizon: f64, outputs: &mut Outputs) {
        let derivative = |x: &model::State| self.parameters.road.derivative(x, inputs.drive_force);
        let mean = runge_kutta(&state.belief.mean, horizon, derivative);
        outputs.speed_estimate = Estimate::new(mean[0], state.belief.std(0));
        outputs.grade = Estimate::new(mean[1], state.belief.std(1));
    }

    fn usable(&self, _: &State, outputs: &Outputs) -> bool {
        outputs.grade.std < 0.05
    }

    fn check(&self, state: &State) -> Result<(), StateError> {
        if state.belief.is_valid() { Ok(()) } else { Err(StateError("it holds a negative variance")) }
    }
}

type RoadVehicle = Sampled<RoadMachine>;

/// Truth: its own equations, with air drag in its usual form.
fn simulate(request: &Request) -> Result<Log, SimulateError> {
    if request.scenario != "hills" {
        return Err(SimulateError::unknown(&request.scenario, SCENARIOS));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(request.seed);
    let mut noise = |std: f64| {
        let draw: f64 = StandardNormal.sample(&mut rng);
        std * draw
    };
    let (mass, rolling, half_rho_cda, h) = (1523.0, 0.012, 0.42, 0.05);
    let mut times = Vec::new();
    let mut columns: [Vec<f64>; 4] = Default::default();
    let mut v: f64 = 12.0;
    for k in 0..2400 {
        let t = h * f64::from(k);
        let grade = if t < 60.0 { 0.0 } else { 0.04 * (0.1 * (t - 60.0)).sin() };
        let force = 900.0 + 1500.0 * (0.35 * t).sin() + 700.0 * (0.9 * t).sin();
        let push = (force - half_rho_cda * v * v) / mass - rolling * 9.80665;
        times.push(t);
        let sample = [force, v + noise(0.05), push + noise(0.05), grade];
        columns.iter_mut().zip(sample).for_each(|(column, value)| column.push(value));
        v += h * (push - 9.80665 * grade.sin());
    }
    let mut log = Log { source: "hills".into(), time: times.into(), ..Log::default() };
    for (name, values) in ["drive_force", "speed", "accel_x", "true_grade"].into_iter().zip(columns) {
        log.push(name, values);
    }
    Ok(log)
}

const SCENARIOS: &[Scenario] = &[Scenario { name: "hills", about: "flat, then hills" }];

/// Over windows of a second, `F = m a_x + m f g + m k v^2`, with what the accelerometer feels on any grade.
fn estimate(task: &Task, session: &mut Session) -> Result<(), FitError> {
    let mut rows = solve::Rows::new("force balance", "N", 3);
    for log in task.logs {
        let (force, speed, accel) = (log.require("drive_force")?, log.require("speed")?, log.require("accel_x")?);
        for window in (0..log.len()).step_by(20).filter(|start| start + 20 <= log.len()) {
            let mean = |of: &dyn Fn(usize) -> f64| (window..window + 20).map(of).sum::<f64>() / 20.0;
            let row = [mean(&|k| accel[k]), model::GRAVITY, mean(&|k| speed[k] * speed[k])];
            rows.push(&row, mean(&|k| force[k]), window as u32);
        }
    }
    let unknowns = ["m", "m f", "m k"].map(|name| solve::Unknown::within(name, 0.0, 1e5)).into();
    let regression =
        solve::Regression { name: "force balance".into(), unknowns, groups: vec![rows], constraints: Vec::new() };
    if let Some(fit) = session.solve(&regression, &["road.mass", "road.rolling"])? {
        session.estimate("road.mass", fit, |theta| theta[0]);
        session.estimate("road.rolling", fit, |theta| theta[1] / theta[0]);
    }
    Ok(())
}

static VEHICLE: Vehicle = Vehicle {
    name: "road-vehicle",
    about: "Road vehicle",
    estimator: Seat::of::<RoadVehicle>(),
    problem: Problem {
        targets: |_| {
            let declared = Parameters::declare();
            ["road.mass", "road.rolling"].map(|name| Target::declared(&declared, name, true)).into()
        },
        outliers: &[],
        estimate,
        validate: |_| Vec::new(),
    },
    checks: Checks::NONE,
    simulation: Simulation {
        scenarios: SCENARIOS,
        run: simulate,
        companions: |_| Ok(Vec::new()),
        manoeuvres: Manoeuvres::NONE,
    },
    needed: &[&["speed"]],
    noise_floors: |_| Vec::new(),
    body_tree: false,
};

fn hills(seed: u64) -> Log {
    VEHICLE.simulate(&Request { scenario: "hills".into(), seed, settings: Vec::new() }).unwrap()
}

#[test]
fn a_sixth_machine_is_simulated_fitted_and_tuned_from_outside_the_tree() {
    let fit = VEHICLE.fit(&[hills(1)], &FitRequest::default(), &Progress::none()).unwrap();
    let (mass, rolling) = (&fit.parameters["road.mass"], &fit.parameters["road.rolling"]);
    println!("mass {} +- {}, rolling {} +- {}", mass.value, mass.std_error, rolling.value, rolling.std_error);
    assert!((mass.value / 1523.0 - 1.0).abs() < 0.01 && (rolling.value - 0.012).abs() < 0.002);
    assert_eq!(fit.vehicle, "road-vehicle");

    let request = TuneRequest {
        objective: Objective::Nll,
        population: 8,
        iterations: 4,
        settings: vec![("road.mass".into(), mass.value), ("road.rolling".into(), rolling.value)],
        ..TuneRequest::default()
    };
    let tuned = VEHICLE.tune(&[hills(1)], &[hills(2)], &request, &Progress::none()).unwrap();
    assert!(tuned.tuning.best <= tuned.tuning.start);
    assert!(tuned.fit.parameters.keys().all(|name| name.starts_with("filter.")), "{:?}", tuned.fit.parameters.keys());
}

/// Under the shared rules without a line of its own: the grade is found, units are checked, health is said.
#[test]
fn a_sixth_machine_estimates_under_the_shared_rules() {
    let (log, mut parameters) = (hills(3), Parameters::default());
    parameters.set("road.mass", 1523.0).unwrap();
    parameters.set("road.rolling", 0.012).unwrap();
    let run = |scale: f64| {
        let (mut estimator, mut out) = (RoadVehicle::new(&parameters).unwrap(), Outputs::default());
        let mut errors = Vec::new();
        let mut contradicted = false;
        for k in 0..log.len() {
            let at = |name: &str| log.channel(name).unwrap()[k];
            let inputs = Inputs { drive_force: at("drive_force"), speed: at("speed"), accel_x: scale * at("accel_x") };
            contradicted |= estimator.step(&inputs, 0.05).contains(Status::CONTRADICTED);
            estimator.outputs(&inputs, 0.0, &mut out);
            if k > 200 {
                errors.push((out.grade.value - at("true_grade")).abs());
            }
        }
        (median(&errors), contradicted, out.diagnostics.healthy)
    };
    let (error, contradicted, healthy) = run(1.0);
    assert!(error < 0.01 && !contradicted && healthy, "{error} {contradicted} {healthy}");
    let (_, contradicted, healthy) = run(9.80665);
    assert!(contradicted && !healthy, "an accelerometer in other units");
}
