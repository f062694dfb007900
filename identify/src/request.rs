//! What a fit is asked for, besides the logs.

/// Loss of the regression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Loss {
    /// Least squares.
    Ls,
    /// Huber: quadratic for small residuals, linear beyond 1.345 standard deviations.
    #[default]
    Huber,
    /// Least absolute values.
    L1,
}

impl Loss {
    /// The word on the command line and in `fit.json`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ls => "ls",
            Self::Huber => "huber",
            Self::L1 => "l1",
        }
    }
}

/// Settings of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitRequest {
    /// Start values by FMU name (`--params`); checked against the declarations.
    pub start: Vec<(String, f64)>,
    /// Known values by FMU name (`--set`); checked against the declarations, they win over `start`.
    pub settings: Vec<(String, f64)>,
    /// Parameters to fit (`--only`); empty means the vehicle's usual ones.
    pub only: Vec<String>,
    /// Loss.
    pub loss: Loss,
    /// Refine the regression by output error.
    pub refine: bool,
    /// Subtract the estimated bias of the regressions (`--correct`).
    pub correct: bool,
}
