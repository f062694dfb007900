//! Any estimator behind one object-safe face, all values as flat `f64`.

use std::any::Any;
use wheelstate::estimator::StateError;
use wheelstate::{Estimator, ParameterError, Variables};

/// The state of an estimator whose type is forgotten.
pub type Saved = Box<dyn Any + Send>;

/// An estimator as the FMU sees it. Slices are in the order of the declarations; after its own parameters there may
/// stand others, which it leaves alone.
pub trait Machine: Send {
    /// Starts anew with these parameters.
    fn build(&mut self, parameters: &[f64]) -> Result<(), ParameterError>;
    /// Takes over changed tunable parameters and keeps the state.
    fn retune(&mut self, parameters: &[f64]) -> Result<(), ParameterError>;
    /// Time between two samples, s; 0 before [`build`](Self::build).
    fn sample_period(&self) -> f64;
    /// Takes over inputs, which hold until others come.
    fn hold(&mut self, inputs: &[f64]);
    /// The held inputs.
    fn held(&self, inputs: &mut [f64]);
    /// Takes one sample of the held inputs, `sample_period` after the one before.
    fn step(&mut self);
    /// Forms the estimates `horizon` seconds after the last sample.
    fn predict(&mut self, horizon: f64);
    /// The estimates last formed.
    fn outputs(&self, outputs: &mut [f64]);
    /// Copies the state into `slot`, reusing what is there; `None` before [`build`](Self::build).
    fn save(&self, slot: &mut Option<Saved>);
    /// Continues from a state of an estimator with equal parameters.
    fn load(&mut self, saved: &Saved) -> Result<(), StateError>;
    /// The state as bytes.
    fn encode(&self, saved: &Saved) -> Result<Vec<u8>, StateError>;
    /// A state from bytes, once it has proved to fit an estimator with these parameters.
    fn decode(&self, parameters: &[f64], bytes: &[u8]) -> Result<Saved, StateError>;
}

/// The one implementation of [`Machine`].
pub struct Typed<E: Estimator> {
    estimator: Option<E>,
    inputs: E::Inputs,
    outputs: E::Outputs,
}

impl<E: Estimator> Default for Typed<E> {
    fn default() -> Self {
        Self { estimator: None, inputs: E::Inputs::default(), outputs: E::Outputs::default() }
    }
}

const FOREIGN: StateError = StateError("it belongs to another model");
const GARBLED: StateError = StateError("its bytes are not a state of this model");

fn parameters<E: Estimator>(flat: &[f64]) -> E::Parameters {
    let mut parameters = E::Parameters::default();
    parameters.read(&flat[..E::Parameters::COUNT]);
    parameters
}

impl<E: Estimator + 'static> Machine for Typed<E> {
    fn build(&mut self, flat: &[f64]) -> Result<(), ParameterError> {
        self.estimator = Some(E::new(&parameters::<E>(flat))?);
        Ok(())
    }

    fn retune(&mut self, flat: &[f64]) -> Result<(), ParameterError> {
        match &mut self.estimator {
            Some(estimator) => estimator.retune(&parameters::<E>(flat)),
            None => self.build(flat),
        }
    }

    fn sample_period(&self) -> f64 {
        self.estimator.as_ref().map_or(0.0, E::sample_period)
    }

    fn hold(&mut self, inputs: &[f64]) {
        self.inputs.read(inputs);
    }

    fn held(&self, inputs: &mut [f64]) {
        self.inputs.write(inputs);
    }

    fn step(&mut self) {
        if let Some(estimator) = &mut self.estimator {
            let period = estimator.sample_period();
            estimator.step(&self.inputs, period);
        }
    }

    fn predict(&mut self, horizon: f64) {
        if let Some(estimator) = &self.estimator {
            estimator.outputs(&self.inputs, horizon, &mut self.outputs);
        }
    }

    fn outputs(&self, outputs: &mut [f64]) {
        self.outputs.write(outputs);
    }

    fn save(&self, slot: &mut Option<Saved>) {
        let Some(state) = self.estimator.as_ref().map(E::state) else {
            *slot = None;
            return;
        };
        match slot.as_mut().and_then(|saved| saved.downcast_mut::<E::State>()) {
            Some(saved) => saved.clone_from(state),
            None => *slot = Some(Box::new(state.clone())),
        }
    }

    fn load(&mut self, saved: &Saved) -> Result<(), StateError> {
        let state = saved.downcast_ref::<E::State>().ok_or(FOREIGN)?;
        self.estimator.as_mut().ok_or(StateError("there is no estimator yet"))?.restore(state)
    }

    fn encode(&self, saved: &Saved) -> Result<Vec<u8>, StateError> {
        let state = saved.downcast_ref::<E::State>().ok_or(FOREIGN)?;
        postcard::to_stdvec(state).map_err(|_| StateError("it cannot be serialised"))
    }

    fn decode(&self, flat: &[f64], bytes: &[u8]) -> Result<Saved, StateError> {
        let (state, rest) = postcard::take_from_bytes::<E::State>(bytes).map_err(|_| GARBLED)?;
        if !rest.is_empty() {
            return Err(GARBLED);
        }
        let mut trial =
            E::new(&parameters::<E>(flat)).map_err(|_| StateError("its parameters are refused by the model"))?;
        trial.restore(&state)?;
        Ok(Box::new(state))
    }
}
