//! A parameter set (SSP 1.0 `.ssv`) with all parameters of a model: a preset to copy and edit.

use crate::describe::{escape, number};
use crate::model::Model;
use std::fmt::Write as _;
use wheelstate::variable::Kind;

/// The parameter set of the model's start values.
pub fn text(model: &Model) -> String {
    let mut text = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" name="{}">
  <ssv:Parameters>
"#,
        model.name
    );
    for variable in &model.parameters {
        let value = match variable.kind {
            Kind::Real => format!(r#"<ssv:Real value="{}"/>"#, number(variable.start)),
            Kind::Integer => format!(r#"<ssv:Integer value="{}"/>"#, number(variable.start)),
            Kind::Boolean => format!(r#"<ssv:Boolean value="{}"/>"#, variable.start != 0.0),
            Kind::Choice(items) => {
                let item = items.get(variable.start as usize).copied().unwrap_or_default();
                format!(r#"<ssv:Enumeration value="{}"/>"#, escape(item))
            }
        };
        let (name, about) = (&variable.name, escape(&variable.description));
        let _ = writeln!(text, r#"    <ssv:Parameter name="{name}" description="{about}">{value}</ssv:Parameter>"#);
    }
    text.push_str("  </ssv:Parameters>\n</ssv:ParameterSet>\n");
    text
}
