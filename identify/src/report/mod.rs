//! What a fit says: the file, the table, the parameter set, the HTML page.

pub mod fit;

pub use fit::{
    CorrelationPair, Covariance, FORMAT_VERSION, FitReport, LogEntry, Parameter, SignalFit, Trace, Validation, Verdict,
};
