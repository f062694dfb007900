//! What a fit says to people and programs: the table, the parameter set, the HTML page.

mod html;
mod plot;
mod residuals;
mod ssv;
mod table;

pub use html::{HtmlError, html};
pub use plot::PlotError;
pub use residuals::residuals;
pub use ssv::ssv;
pub use table::{start_values, table};
