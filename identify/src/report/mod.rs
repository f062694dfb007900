//! What a fit says: the file, the table, the parameter set, the HTML page.

pub mod fit;
mod html;
mod plot;
mod ssv;
mod table;

pub use fit::{
    CorrelationPair, Covariance, FORMAT_VERSION, FitReport, LogEntry, Parameter, SignalFit, Trace, Validation, Verdict,
};
pub use html::{HtmlError, html};
pub use plot::PlotError;
pub use ssv::ssv;
pub use table::{start_values, table};
