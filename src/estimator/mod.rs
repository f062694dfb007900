//! The estimators: each joins one model with one filter and is what users call.
//!
//! An [`Estimator`] takes typed, declared [`Variables`] in and out. Everything that a step changes
//! is one plain [`State`](Estimator::State), so that a host can copy, compare, store and restore it;
//! restoring a state and repeating the inputs repeats the bytes.

mod finite;
mod frozen;
pub mod human_dynamics;
pub mod lateness;
pub mod nursing_robot;
pub mod one_step;
pub mod relative_delay;
pub mod repetition;
pub mod sampled;
pub mod standstill;
pub mod unchanged;
pub mod wheel_loader;
pub mod wheelchair;
pub mod wheeled_robot;

pub use sampled::{Diagnostics, Elapsed, Machine, Outcome, Rules, Sampled};

use crate::{ParameterError, Status, Variables};
use one_step::{Belief, NO_STATES, OneStepPrediction};
use serde::{Serialize, de::DeserializeOwned};

/// An online estimator of one machine. Hosts move it between threads.
/// A host needs nothing else, whatever the machine:
///
/// ```
/// use wheelstate::estimator::wheelchair::Wheelchair;
/// use wheelstate::{Estimator, Variables};
///
/// /// Runs any estimator over samples of its inputs, in the order of their declaration; NaN is a missing sample.
/// fn run<E: Estimator>(samples: &[Vec<f64>]) -> Result<E::Outputs, Box<dyn std::error::Error>> {
///     let mut estimator = E::new(&E::Parameters::default())?;
///     let (mut inputs, mut estimates) = (E::Inputs::default(), E::Outputs::default());
///     for sample in samples {
///         inputs.read(sample);
///         let before = estimator.state().clone();
///         let status = estimator.step(&inputs, estimator.sample_period());
///         // the same state and the same sample give the same
///         estimator.restore(&before)?;
///         assert_eq!(estimator.step(&inputs, estimator.sample_period()), status);
///     }
///     estimator.outputs(&inputs, 0.0, &mut estimates);
///     Ok(estimates)
/// }
///
/// // nothing was ever measured: every estimate is a number, and not healthy
/// let estimates = run::<Wheelchair>(&vec![vec![f64::NAN; 8]; 10])?;
/// assert!(estimates.to_vec().iter().all(|value| value.is_finite()) && !estimates.diagnostics.healthy);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Estimator: Clone + Send {
    /// Name in camel case, also the FMU's model identifier.
    const NAME: &'static str;
    /// What it estimates, in one sentence.
    const DESCRIPTION: &'static str;
    /// What is fixed or tuned from outside. Has a variable `sample_period`.
    type Parameters: Variables + Default;
    /// What is measured.
    type Inputs: Variables + Default;
    /// What is estimated, for every estimate `x` also `x_std`, with the [`Diagnostics`].
    type Outputs: Variables + Default;
    /// Everything that a step changes.
    type State: Clone + Send + Serialize + DeserializeOwned;

    /// Checks the parameters and builds the estimator in its initial state.
    fn new(parameters: &Self::Parameters) -> Result<Self, ParameterError>;

    /// Time between two samples, s.
    fn sample_period(&self) -> f64;

    /// Takes one sample: time update over `dt` seconds since the sample before, then measurement
    /// update. The first sample after construction has no time update and `dt` is only nominal.
    ///
    /// NaN in a measured input is a missing sample; an unusable `dt` changes nothing and says so in
    /// the status that is returned. Never panics, never allocates.
    fn step(&mut self, inputs: &Self::Inputs, dt: f64) -> Status;

    /// The estimates `horizon >= 0` seconds after the last sample: its posterior, the mean carried
    /// forward by the model with these inputs held; what has no dynamics is simply held. Before
    /// the first sample: the initial state.
    fn outputs(&self, inputs: &Self::Inputs, horizon: f64, outputs: &mut Self::Outputs);

    /// Everything that the steps so far have changed.
    fn state(&self) -> &Self::State;

    /// Continues from a state of an estimator with equal parameters. Refuses one that cannot come
    /// from such an estimator (other sizes, values that are not finite) and is then unchanged.
    fn restore(&mut self, state: &Self::State) -> Result<(), StateError>;

    /// What the filter expects of a sample that comes `dt` seconds after the last one, and how its belief leads there:
    /// called before [`step`](Self::step) with the same arguments, and changes nothing. By default nothing.
    fn predict_one_step(&self, _inputs: &Self::Inputs, _dt: f64, into: &mut OneStepPrediction) {
        into.clear();
    }

    /// Mean and covariance of the states that can be smoothed, or why there are none.
    fn belief(&self) -> Result<Belief, &'static str> {
        Err(NO_STATES)
    }

    /// Puts a smoothed belief in the place of the filter's, for [`outputs`](Self::outputs) only: no step may follow.
    fn believe(&mut self, _belief: &Belief) {}

    /// Takes over changed tunable parameters and keeps the state.
    fn retune(&mut self, parameters: &Self::Parameters) -> Result<(), ParameterError> {
        let mut tuned = Self::new(parameters)?;
        if tuned.restore(self.state()).is_ok() {
            *self = tuned;
        }
        Ok(())
    }
}

/// A state that cannot be restored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the state does not fit this estimator: {0}")]
pub struct StateError(pub &'static str);

/// Something to be done with every estimator of this crate; see [`visit_all`].
pub trait Visitor {
    /// Called once per estimator.
    fn visit<E: Estimator + 'static>(&mut self);
}

/// The one list of estimators: adding one here puts it into the FMU library, the packer and the docs.
pub fn visit_all(visitor: &mut impl Visitor) {
    visitor.visit::<nursing_robot::NursingRobot>();
    visitor.visit::<wheel_loader::WheelLoader>();
    visitor.visit::<wheeled_robot::WheeledRobot>();
    visitor.visit::<wheelchair::Wheelchair>();
    visitor.visit::<human_dynamics::HumanDynamics>();
}
