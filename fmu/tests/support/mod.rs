//! A small estimator with every kind of variable, and a host that calls the C functions.
#![allow(dead_code, unsafe_code, missing_docs)]

pub mod host;

use serde::{Deserialize, Serialize};
use wheelstate::estimator::StateError;
use wheelstate::{Estimator, ParameterError, Status, Variables, choice, variables};
use wheelstate_fmu::model::Model;

choice! {
    /// Where the estimator panics.
    pub enum Fault { None = "none", Build = "build", Step = "step", Outputs = "outputs" }
}

variables! {
    /// The filter's settings.
    pub struct Filter {
        /// Time constant of the "lag" <T>.
        time_constant: f64 = 0.2, "s", [0.001, 1e3], tunable;
        /// Steady gain from the drive to the estimate.
        gain: f64 = 1.0, "m/(N.m)", [-100.0, 100.0], tunable;
        /// Number of measurement updates per sample.
        updates: i32 = 1, "1", [1, 5];
        /// Whether the measurement is used.
        use_signal: bool = true, "1", tunable;
        /// Where it panics.
        fault: Fault = Fault::None, "1", tunable;
    }
}

variables! {
    /// Parameters of the test estimator.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-6, 10.0];
        /// The filter.
        filter: Filter;
        /// Initial angle.
        initial_angle: f64 = 0.0, "rad", [-3.2, 3.2];
    }
}

variables! {
    /// Inputs of the test estimator.
    pub struct Inputs {
        /// Measured position.
        signal: f64 = f64::NAN, "m", measured;
        /// Driving torque, always there.
        drive: f64 = 0.0, "N.m";
        /// Gear.
        gear: i32 = 1, "1", [1, 4];
        /// Brake applied.
        brake: bool = false, "1";
        /// Regime announced by the host.
        regime: Fault = Fault::None, "1";
    }
}

variables! {
    /// Outputs of the test estimator.
    pub struct Outputs {
        /// Estimated position.
        position: f64 = 0.0, "m";
        /// Standard deviation of position.
        position_std: f64 = 0.0, "m";
        /// Sum of all drives taken.
        drive_sum: f64 = 0.0, "N.m";
        /// Samples taken.
        count: i32 = 0, "1";
        /// Bits.
        status: Status = Status::OK, "1";
        /// Usable.
        healthy: bool = false, "1";
        /// Regime of the last sample.
        regime_seen: Fault = Fault::None, "1";
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    pub position: f64,
    pub variance: f64,
    pub drive_sum: f64,
    pub count: i32,
    pub regime: u8,
    pub status: Status,
}

#[derive(Clone)]
pub struct Lag {
    parameters: Parameters,
    state: State,
}

impl Estimator for Lag {
    const NAME: &'static str = "TestLag";
    const DESCRIPTION: &'static str = "A first-order lag & its measurement.";
    type Parameters = Parameters;
    type Inputs = Inputs;
    type Outputs = Outputs;
    type State = State;

    fn new(parameters: &Parameters) -> Result<Self, ParameterError> {
        parameters.validate()?;
        assert!(parameters.filter.fault != Fault::Build, "injected while building");
        if parameters.filter.time_constant < parameters.sample_period {
            return Err(ParameterError {
                name: "filter.time_constant".to_owned(),
                value: parameters.filter.time_constant,
                unit: "s",
                reason: format!("is shorter than sample_period = {} s", parameters.sample_period),
            });
        }
        let state = State {
            position: parameters.initial_angle,
            variance: 1.0,
            drive_sum: 0.0,
            count: 0,
            regime: 0,
            status: Status::OK,
        };
        Ok(Self { parameters: parameters.clone(), state })
    }

    fn sample_period(&self) -> f64 {
        self.parameters.sample_period
    }

    fn step(&mut self, inputs: &Inputs, dt: f64) -> Status {
        let filter = &self.parameters.filter;
        assert!(filter.fault != Fault::Step, "injected while stepping: 100 %s done");
        let state = &mut self.state;
        if state.count > 0 {
            let decay = (-dt / filter.time_constant).exp();
            state.position = filter.gain * inputs.drive + decay * (state.position - filter.gain * inputs.drive);
            state.variance = decay * decay * state.variance + 1e-3 * dt;
        }
        state.status = Status::OK;
        if inputs.signal.is_finite() && filter.use_signal {
            for _ in 0..filter.updates {
                let gain = state.variance / (state.variance + 0.01);
                state.position += gain * (inputs.signal - state.position);
                state.variance *= 1.0 - gain;
            }
        } else {
            state.status |= Status::MISSING;
        }
        state.drive_sum += inputs.drive * if inputs.brake { 0.0 } else { f64::from(inputs.gear) };
        state.regime = wheelstate::variable::Value::to_number(inputs.regime) as u8;
        state.count += 1;
        state.status
    }

    fn outputs(&self, inputs: &Inputs, ahead: f64, outputs: &mut Outputs) {
        let filter = &self.parameters.filter;
        assert!(filter.fault != Fault::Outputs, "injected while reading outputs");
        let decay = if self.state.count > 0 { (-ahead / filter.time_constant).exp() } else { 1.0 };
        outputs.position = filter.gain * inputs.drive + decay * (self.state.position - filter.gain * inputs.drive);
        if self.state.count == 0 {
            outputs.position = self.state.position;
        }
        outputs.position_std = self.state.variance.sqrt();
        outputs.drive_sum = self.state.drive_sum;
        outputs.count = self.state.count;
        outputs.status = self.state.status;
        outputs.healthy = self.state.count > 0;
        outputs.regime_seen = wheelstate::variable::Value::from_number(f64::from(self.state.regime));
    }

    fn state(&self) -> &State {
        &self.state
    }

    fn restore(&mut self, state: &State) -> Result<(), StateError> {
        if !(state.position.is_finite() && state.variance >= 0.0 && state.drive_sum.is_finite()) {
            return Err(StateError("it has values that are not finite"));
        }
        self.state = state.clone();
        Ok(())
    }
}

/// The test model as a catalogue.
pub fn catalogue(wanted: &dyn Fn(&str) -> bool) -> Vec<Model> {
    if wanted(Lag::NAME) { vec![Model::of::<Lag>()] } else { Vec::new() }
}

/// A deterministic pseudo-random number in 0..1.
pub fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 53) as f64
}
