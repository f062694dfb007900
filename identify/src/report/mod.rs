//! What a fit says to people and programs: the table, the parameter set, the HTML page; and the page of a run.

mod chart;
mod html;
mod plot;
mod residuals;
mod run;
mod ssv;
mod table;

pub use html::{HtmlError, html};
pub use plot::PlotError;
pub use residuals::residuals;
pub use run::run;
pub use ssv::ssv;
pub use table::{each_log, start_values, table};
