//! The rules that all estimators share, stated once: start, time steps and gaps, which inputs are samples, what holds
//! while an input has none, the watch over the innovations, `status` and `healthy`.
//!
//! [`Sampled`] wraps a [`Machine`], which knows one model and one filter, and makes an [`Estimator`] of it:
//!
//! | what | rule |
//! |---|---|
//! | first sample | no time update, whatever `dt` is |
//! | `dt` not positive or not finite | nothing changes at all; the step returns `bad-step skipped` |
//! | `dt` beyond [`Rules::longest_gap`] | the machine makes a new start from what it still knows; `bad-step restarted` |
//! | `measured` input NaN, infinite or out of range | no sample: its channel is left out; `missing`, `infinite`, `implausible` |
//! | `held` input likewise | the last valid value; `held-input`. Before the first 0, or NaN if it is `optional` |
//! | a force, torque or steering angle held for longer than [`HELD_BRIEFLY`] | wheelchair and wheeled robot count it as unknown |
//! | force, moment, torque or held input without any valid value so far | `never-set` |
//! | encoder, speed over ground or gyro that repeats exactly while wheels or steering must have changed it | an old sample is none: `missing` ([`repetition`](super::repetition)) |
//! | an input with noise that repeats exactly for longer than noise does | a frozen sensor: no sample (`missing`, `held-input`) |
//! | input that the parameters switch off | no sample, nothing is said unless it is infinite |
//! | no measured input has a sample | `no-measurement` |
//! | innovations of the last seconds too large | `contradicted`, not healthy: [`NisMonitor`] |
//! | nothing usable for [`LONGEST_SILENCE`], or a restart, repair or skipped sample just now | not healthy |
//! | a stored state with a number that is not finite | is refused and nothing changes |

use super::finite::all_finite;
use super::frozen::FrozenInputs;
use super::one_step::{Belief, NO_STATES, OneStepPrediction};
use super::{Estimator, StateError};
use crate::filter::nis_monitor::NisMonitor;
use crate::{ParameterError, Status, Variables};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Without anything measured that the filter could use for this long the estimates are not healthy, s.
pub const LONGEST_SILENCE: f64 = 1.0;
/// An input that is held for no longer than this is sampled more slowly than the others; then nobody knows it any more, s.
pub const HELD_BRIEFLY: f64 = 0.1;
/// As long as never, s.
pub const LONG_AGO: f64 = 1e9;

crate::variables! {
    /// What every estimator says about its last sample.
    #[derive(Copy, Serialize, Deserialize)]
    pub struct Diagnostics {
        /// Normalised innovation squared per channel of the last sample, rejected channels included; near 1 if noise and model fit, 0 if nothing was measured.
        nis: f64 = 0.0, "1", [0.0, f64::INFINITY];
        /// Number of channels in nis.
        nis_channels: i32 = 0, "1", [0, 100_000];
        /// Logarithm of the likelihood of what was measured last; 0 if nothing was.
        log_likelihood: f64 = 0.0, "1";
        /// Conditions of the last sample as bits.
        status: Status = Status::OK, "1";
        /// Whether the main estimates are usable now: measured within the last second, certain enough, and not contradicted by the measurements of the last seconds.
        healthy: bool = false, "1";
    }
}

/// How much time has passed since the sample before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Elapsed {
    /// This is the first sample: there is nothing to carry forward.
    First,
    /// So many seconds.
    Step(f64),
    /// So many seconds, more than the model can bridge.
    Gap(f64),
}

impl Elapsed {
    /// `dt` seconds since the sample before, if there was one.
    #[inline]
    fn of(started: bool, dt: f64, longest_gap: f64) -> Self {
        match started {
            false => Self::First,
            true if dt > longest_gap => Self::Gap(dt),
            true => Self::Step(dt),
        }
    }

    /// Seconds since the sample before, 0 at the first one.
    pub fn seconds(self) -> f64 {
        match self {
            Self::First => 0.0,
            Self::Step(dt) | Self::Gap(dt) => dt,
        }
    }
}

/// What a machine says about a sample that it has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Conditions that only the machine knows.
    pub status: Status,
    /// Normalised innovation squared, summed over its channels.
    pub nis: f64,
    /// Number of these channels, rejected ones included.
    pub channels: usize,
    /// Logarithm of the likelihood of the sample.
    pub log_likelihood: f64,
    /// Whether anything measured was used.
    pub used: bool,
    /// The innovations are of what the model does not claim to know, such as a wheel that spins while the filter only
    /// follows it: they are reported and contradict nothing.
    pub unmodelled: bool,
}

/// What the shell must know of a machine.
#[derive(Clone, Debug)]
pub struct Rules {
    /// Time between two samples, s.
    pub sample_period: f64,
    /// Longest step that the model bridges, s.
    pub longest_gap: f64,
    /// Inputs whose plausible magnitude is a parameter and narrower than their declaration: name and largest value.
    pub limits: Vec<(&'static str, f64)>,
    /// Inputs that the parameters switch off.
    pub unused: Vec<String>,
}

/// One machine's model and filter, without the rules that all machines share.
pub trait Machine: Clone + Send {
    /// Name in camel case, also the FMU's model identifier.
    const NAME: &'static str;
    /// What it estimates, in one sentence.
    const DESCRIPTION: &'static str;
    /// What is fixed or tuned from outside. Has a variable `sample_period`.
    type Parameters: Variables + Default;
    /// What is measured; every input is declared `measured` or `held`.
    type Inputs: Variables + Default;
    /// What is estimated.
    type Outputs: Variables + Default + AsMut<Diagnostics>;
    /// Everything that a sample changes.
    type State: Clone + Send + Serialize + DeserializeOwned;

    /// From parameters within their declared ranges: the machine and its state before the first sample.
    fn new(parameters: &Self::Parameters) -> Result<(Self, Self::State), ParameterError>;

    /// What the shell must know.
    fn rules(parameters: &Self::Parameters) -> Rules;

    /// Takes one sample: time update over `elapsed`, then measurement update. NaN in a measured input is a missing
    /// sample; held inputs are numbers (but for an `optional` one that was never set), and `screened` says whether one
    /// of them is an old one ([`Status::HELD_INPUT`]) or was never set. Never panics, never allocates.
    fn sample(&mut self, state: &mut Self::State, inputs: &Self::Inputs, screened: Status, elapsed: Elapsed)
    -> Outcome;

    /// The estimates `horizon >= 0` seconds after the last sample: its posterior, the mean carried forward by the
    /// model with these inputs held. Leaves the diagnostics alone.
    fn estimates(&self, state: &Self::State, inputs: &Self::Inputs, horizon: f64, outputs: &mut Self::Outputs);

    /// What the filter expects of a sample, before it is taken, and how its belief leads there. By default nothing.
    fn predict_one_step(
        &self,
        _state: &Self::State,
        _inputs: &Self::Inputs,
        _screened: Status,
        _elapsed: Elapsed,
        _into: &mut OneStepPrediction,
    ) {
    }

    /// Mean and covariance of the states that can be smoothed, or why there are none.
    fn belief(&self, _state: &Self::State) -> Result<Belief, &'static str> {
        Err(NO_STATES)
    }

    /// Puts a smoothed belief in the place of the filter's, for [`estimates`](Self::estimates).
    fn believe(&self, _state: &mut Self::State, _belief: &Belief) {}

    /// Whether these estimates are certain and plausible enough to be used.
    fn usable(&self, state: &Self::State, outputs: &Self::Outputs) -> bool;

    /// Whether a state can have come from this machine; its numbers are finite.
    fn check(&self, state: &Self::State) -> Result<(), StateError>;
}

/// What becomes of one input.
#[derive(Clone, Copy, Debug)]
struct Channel {
    low: f64,
    high: f64,
    /// Its last valid value holds.
    held: bool,
    /// What a held input has before its first valid value.
    unset: f64,
    used: bool,
    /// Where its last valid value is kept, for those that hold it or must tell that they never had one.
    slot: Option<usize>,
}

impl Channel {
    /// What is taken instead of a value that is no sample, where the last valid one is `known`; says why.
    #[cold]
    fn substitute(&self, value: f64, known: Option<f64>, status: &mut Status) -> f64 {
        status.raise_if(value.is_infinite(), Status::INFINITE);
        status.raise_if(value.is_finite(), Status::IMPLAUSIBLE);
        status.raise_if(self.slot.is_some() && known.is_none(), Status::NEVER_SET);
        if self.held {
            status.raise_if(known.is_some(), Status::HELD_INPUT);
            known.unwrap_or(self.unset)
        } else {
            status.raise_if(value.is_nan(), Status::MISSING);
            f64::NAN
        }
    }
}

/// Everything that a step changes.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct State<S> {
    /// The machine's part.
    pub machine: S,
    started: bool,
    /// Last valid values of the inputs that are held or must have been set.
    last: Vec<Option<f64>>,
    frozen: FrozenInputs,
    /// Time since anything measured was used, s.
    silent: f64,
    monitor: NisMonitor,
    diagnostics: Diagnostics,
}

impl<S: Clone> Clone for State<S> {
    fn clone(&self) -> Self {
        Self { machine: self.machine.clone(), last: self.last.clone(), frozen: self.frozen.clone(), ..*self }
    }

    /// Into memory that is there already.
    fn clone_from(&mut self, other: &Self) {
        self.machine.clone_from(&other.machine);
        self.last.clone_from(&other.last);
        self.frozen.clone_from(&other.frozen);
        (self.started, self.silent, self.monitor) = (other.started, other.silent, other.monitor);
        self.diagnostics = other.diagnostics;
    }
}

/// A [`Machine`] under the rules of this [module](self).
#[derive(Clone, Debug)]
pub struct Sampled<M: Machine> {
    machine: M,
    sample_period: f64,
    longest_gap: f64,
    channels: Vec<Channel>,
    /// The inputs of the last sample, as given and screened, for the outputs; none after [`restore`](Estimator::restore).
    taken: Option<[M::Inputs; 2]>,
    state: State<M::State>,
}

impl AsMut<Diagnostics> for Diagnostics {
    fn as_mut(&mut self) -> &mut Diagnostics {
        self
    }
}

impl<M: Machine> Sampled<M> {
    /// The machine within.
    pub fn machine(&self) -> &M {
        &self.machine
    }

    /// Takes out of the inputs what is no sample; what was wrong with them. `is_frozen` is given the number of an input with its value,
    /// `remember` the slot of an input with its value, if that is valid, and returns its last valid value.
    fn screen(
        channels: &[Channel],
        inputs: &mut M::Inputs,
        mut is_frozen: impl FnMut(usize, f64) -> bool,
        mut remember: impl FnMut(usize, Option<f64>) -> Option<f64>,
    ) -> Status {
        let (mut status, mut measured) = (Status::OK, false);
        let mut channels = channels.iter().enumerate();
        inputs.map(&mut |value| {
            let Some((number, channel)) = channels.next() else { return value };
            if !channel.used {
                status.raise_if(value.is_infinite(), Status::INFINITE);
                return f64::NAN;
            }
            let within = value >= channel.low && value <= channel.high;
            let value = if within && is_frozen(number, value) { f64::NAN } else { value };
            let valid = within && !value.is_nan();
            let known = channel.slot.and_then(|slot| remember(slot, valid.then_some(value)));
            if !valid {
                return channel.substitute(value, known, &mut status);
            }
            measured |= !channel.held;
            value
        });
        status.raise_if(!measured, Status::NO_MEASUREMENT);
        status
    }

    /// Inputs that are not those of the last sample, without what is no sample.
    #[cold]
    fn screened(&self, inputs: &M::Inputs) -> M::Inputs {
        let mut screened = inputs.clone();
        let State { last, frozen, .. } = &self.state;
        let is_frozen = |number, value| frozen.repeats(number, value);
        Self::screen(&self.channels, &mut screened, is_frozen, |slot, value| value.or(last[slot]));
        screened
    }
}

/// How each declared input is screened.
fn channels<I: Variables>(rules: &Rules) -> Vec<Channel> {
    let mut slots = 0..I::COUNT;
    I::declare()
        .into_iter()
        .map(|input| {
            let (low, high) = rules
                .limits
                .iter()
                .find(|(name, _)| *name == input.name)
                .map_or(input.range, |(_, limit)| (-limit, *limit));
            let used = !rules.unused.contains(&input.name);
            let acts = matches!(input.unit, "N" | "N.m");
            let slot = if used && (input.held || acts) { slots.next() } else { None };
            let unset = if input.optional { f64::NAN } else { 0.0 };
            Channel { low, high, held: input.held, unset, used, slot }
        })
        .collect()
}

impl<M: Machine> Estimator for Sampled<M> {
    const NAME: &'static str = M::NAME;
    const DESCRIPTION: &'static str = M::DESCRIPTION;
    type Parameters = M::Parameters;
    type Inputs = M::Inputs;
    type Outputs = M::Outputs;
    type State = State<M::State>;

    fn new(parameters: &M::Parameters) -> Result<Self, ParameterError> {
        parameters.validate()?;
        let (machine, state) = M::new(parameters)?;
        let rules = M::rules(parameters);
        let channels = channels::<M::Inputs>(&rules);
        let state = State {
            machine: state,
            started: false,
            last: vec![None; channels.iter().filter(|channel| channel.slot.is_some()).count()],
            frozen: FrozenInputs::new(channels.len()),
            silent: LONG_AGO,
            monitor: NisMonitor::default(),
            diagnostics: Diagnostics::default(),
        };
        let Rules { sample_period, longest_gap, .. } = rules;
        Ok(Self { machine, sample_period, longest_gap, channels, taken: None, state })
    }

    fn sample_period(&self) -> f64 {
        self.sample_period
    }

    fn step(&mut self, inputs: &M::Inputs, dt: f64) -> Status {
        if self.state.started && !(dt > 0.0 && dt.is_finite()) {
            return Status::BAD_STEP | Status::SKIPPED;
        }
        let [given, screened] = self.taken.get_or_insert_with(Default::default);
        given.clone_from(inputs);
        screened.clone_from(inputs);
        let State { last, frozen, .. } = &mut self.state;
        let is_frozen = |number, value| frozen.follow(number, value);
        let mut status = Self::screen(&self.channels, screened, is_frozen, |slot, value| {
            last[slot] = value.or(last[slot]);
            last[slot]
        });
        frozen.finish();
        let elapsed = Elapsed::of(self.state.started, dt, self.longest_gap);
        let outcome = self.machine.sample(&mut self.state.machine, screened, status, elapsed);
        status |= outcome.status;
        status.raise_if(matches!(elapsed, Elapsed::Gap(_)), Status::BAD_STEP | Status::RESTARTED);

        let state = &mut self.state;
        state.started = true;
        state.silent = if outcome.used { 0.0 } else { (state.silent + elapsed.seconds()).min(LONG_AGO) };
        let nis = if outcome.channels > 0 { (outcome.nis / outcome.channels as f64).min(f64::MAX) } else { 0.0 };
        if outcome.channels > 0 && !outcome.unmodelled {
            state.monitor.update(nis, elapsed.seconds());
        }
        status.raise_if(state.monitor.contradicted(), Status::CONTRADICTED);
        state.diagnostics = Diagnostics {
            nis,
            nis_channels: outcome.channels as i32,
            log_likelihood: outcome.log_likelihood.clamp(f64::MIN, f64::MAX),
            status,
            healthy: false,
        };
        status
    }

    fn outputs(&self, inputs: &M::Inputs, horizon: f64, outputs: &mut M::Outputs) {
        let state = &self.state;
        // NaN is no horizon either.
        let horizon = if state.started && horizon > 0.0 { horizon.min(self.longest_gap) } else { 0.0 };
        let others;
        let screened = match &self.taken {
            Some([given, screened]) if inputs.same(given) => screened,
            _ => {
                others = self.screened(inputs);
                &others
            }
        };
        self.machine.estimates(&state.machine, screened, horizon, outputs);
        let disturbed = Status::RESTARTED | Status::RECOVERED | Status::BAD_STEP | Status::SKIPPED;
        let healthy = state.started
            && state.silent <= LONGEST_SILENCE
            && !state.monitor.contradicted()
            && !state.diagnostics.status.intersects(disturbed)
            && self.machine.usable(&state.machine, outputs);
        *outputs.as_mut() = Diagnostics { healthy, ..state.diagnostics };
    }

    fn predict_one_step(&self, inputs: &M::Inputs, dt: f64, into: &mut OneStepPrediction) {
        into.clear();
        let State { machine, started, last, frozen, .. } = &self.state;
        if *started && !(dt > 0.0 && dt.is_finite()) {
            return;
        }
        let mut screened = inputs.clone();
        let is_frozen = |number, value| frozen.repeats(number, value);
        let status = Self::screen(&self.channels, &mut screened, is_frozen, |slot, value| value.or(last[slot]));
        let elapsed = Elapsed::of(*started, dt, self.longest_gap);
        self.machine.predict_one_step(machine, &screened, status, elapsed, into);
    }

    fn belief(&self) -> Result<Belief, &'static str> {
        self.machine.belief(&self.state.machine)
    }

    fn believe(&mut self, belief: &Belief) {
        self.machine.believe(&mut self.state.machine, belief);
    }

    fn state(&self) -> &Self::State {
        &self.state
    }

    fn restore(&mut self, state: &Self::State) -> Result<(), StateError> {
        if !all_finite(state) {
            return Err(StateError("it holds a number that is not finite"));
        }
        let seen = state.monitor.is_valid() && state.frozen.is_valid(self.channels.len());
        if state.last.len() != self.state.last.len() || !seen {
            return Err(StateError("it is of an estimator with other inputs"));
        }
        self.machine.check(&state.machine)?;
        self.state.clone_from(state);
        self.taken = None;
        Ok(())
    }
}
