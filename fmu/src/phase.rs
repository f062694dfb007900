//! Which FMI function may be called when (FMI 2.0.4, section 4.2.4).

use serde::{Deserialize, Serialize};

/// The states of an instance. Steps are synchronous and never discarded, so the standard's states
/// "step in progress", "step failed" and "step cancelled" do not occur; a refused call changes
/// nothing, so neither does "error".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// After `fmi2Instantiate` or `fmi2Reset`.
    Instantiated,
    /// Between `fmi2EnterInitializationMode` and `fmi2ExitInitializationMode`.
    Initialization,
    /// At a communication point ("step complete").
    Stepping,
    /// After `fmi2Terminate`.
    Terminated,
    /// After a panic: only `fmi2FreeInstance` is left.
    Fatal,
}

impl Phase {
    /// Every phase.
    pub const ALL: [Self; 5] =
        [Self::Instantiated, Self::Initialization, Self::Stepping, Self::Terminated, Self::Fatal];

    /// The name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Instantiated => "instantiated",
            Self::Initialization => "initialization mode",
            Self::Stepping => "step complete",
            Self::Terminated => "terminated",
            Self::Fatal => "fatal",
        }
    }
}

/// The functions whose use depends on the phase. Those for the four types count as one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// `fmi2SetDebugLogging`
    SetDebugLogging,
    /// `fmi2SetupExperiment`
    SetupExperiment,
    /// `fmi2EnterInitializationMode`
    EnterInitialization,
    /// `fmi2ExitInitializationMode`
    ExitInitialization,
    /// `fmi2Terminate`
    Terminate,
    /// `fmi2Reset`
    Reset,
    /// `fmi2GetReal`, `fmi2GetInteger`, `fmi2GetBoolean`, `fmi2GetString`
    Get,
    /// `fmi2SetReal`, `fmi2SetInteger`, `fmi2SetBoolean`, `fmi2SetString`
    Set,
    /// `fmi2GetFMUstate`, `fmi2SetFMUstate`, `fmi2FreeFMUstate`, `fmi2SerializedFMUstateSize`,
    /// `fmi2SerializeFMUstate`, `fmi2DeSerializeFMUstate`
    State,
    /// `fmi2GetDirectionalDerivative`
    DirectionalDerivative,
    /// `fmi2SetRealInputDerivatives`
    SetInputDerivatives,
    /// `fmi2GetRealOutputDerivatives`
    GetOutputDerivatives,
    /// `fmi2DoStep`
    DoStep,
    /// `fmi2CancelStep`
    CancelStep,
    /// `fmi2GetStatus`, `fmi2GetRealStatus`, `fmi2GetIntegerStatus`, `fmi2GetBooleanStatus`,
    /// `fmi2GetStringStatus`
    GetStatus,
}

impl Call {
    /// Every call.
    pub const ALL: [Self; 15] = [
        Self::SetDebugLogging,
        Self::SetupExperiment,
        Self::EnterInitialization,
        Self::ExitInitialization,
        Self::Terminate,
        Self::Reset,
        Self::Get,
        Self::Set,
        Self::State,
        Self::DirectionalDerivative,
        Self::SetInputDerivatives,
        Self::GetOutputDerivatives,
        Self::DoStep,
        Self::CancelStep,
        Self::GetStatus,
    ];

    /// The phases in which the call is allowed.
    pub fn phases(self) -> &'static [Phase] {
        use Phase::{Initialization, Instantiated, Stepping, Terminated};
        match self {
            Self::SetDebugLogging | Self::Reset | Self::State => &[Instantiated, Initialization, Stepping, Terminated],
            Self::SetupExperiment | Self::EnterInitialization => &[Instantiated],
            Self::ExitInitialization => &[Initialization],
            Self::Set | Self::SetInputDerivatives => &[Instantiated, Initialization, Stepping],
            Self::Get | Self::DirectionalDerivative => &[Initialization, Stepping, Terminated],
            Self::GetOutputDerivatives | Self::GetStatus => &[Stepping, Terminated],
            Self::DoStep | Self::Terminate => &[Stepping],
            Self::CancelStep => &[],
        }
    }
}
