//! Parameters from a parameter set (SSP 1.0 `.ssv`), such as `identify fit --ssv` and `pack` write.

use super::Parameters;
use roxmltree::{Document, Node};
use wheelstate::Variable;
use wheelstate::unit;
use wheelstate::variable::Kind;

const NAMESPACE: &str = "http://ssp-standard.org/SSP1/SystemStructureParameterValues";

/// The values of a set's text for a machine with these parameters; the error is the reason.
pub(super) fn parse(text: &str, declared: &[Variable]) -> Result<Parameters, String> {
    let document = Document::parse(text).map_err(|error| format!("not readable as XML: {error}"))?;
    let root = document.root_element();
    if !root.has_tag_name((NAMESPACE, "ParameterSet")) {
        return Err("its root is not an ssv:ParameterSet of SSP 1.0".to_owned());
    }
    let (mut all, mut foreign, mut count) = (Parameters::default(), Vec::new(), 0);
    for node in root.descendants().filter(|node| node.has_tag_name((NAMESPACE, "Parameter"))) {
        let line = document.text_pos_at(node.range().start).row;
        let name = node.attribute("name").ok_or_else(|| format!("line {line}: a parameter without a name"))?;
        count += 1;
        let Some(variable) = declared.iter().find(|variable| variable.name == name) else {
            foreign.push(name);
            continue;
        };
        let value = node.children().find(Node::is_element).ok_or("a parameter without a value".to_owned());
        let number =
            value.and_then(|value| of(variable, value)).map_err(|what| format!("line {line}: {name}: {what}"))?;
        variable.check(number).map_err(|error| error.to_string())?;
        all.values.push((name.to_owned(), number));
    }
    if all.values.is_empty() {
        return Err("none of its parameters is one of this estimator".to_owned());
    }
    if let [first, ..] = foreign.as_slice() {
        let more = foreign.len();
        all.notes.push(format!("{first}: the estimator has no such parameter ({more} of {count} are unknown)"));
    }
    Ok(all)
}

/// A value in the unit that the estimator declares.
fn of(variable: &Variable, node: Node) -> Result<f64, String> {
    let class = node.tag_name().name();
    let fits = match variable.kind {
        Kind::Real => matches!(class, "Real" | "Integer"),
        Kind::Integer | Kind::Code(_) => class == "Integer",
        Kind::Boolean => class == "Boolean",
        Kind::Choice(_) => class == "Enumeration",
    };
    if !fits {
        return Err(format!("its value is of type {class}"));
    }
    let text = node.attribute("value").ok_or("a value without its attribute value")?.trim();
    let number = match (variable.kind, text) {
        (Kind::Boolean, "true") => 1.0,
        (Kind::Boolean, "false") => 0.0,
        (Kind::Choice(choices), word) => {
            let place = choices.iter().position(|choice| *choice == word);
            place.map(|place| place as f64).ok_or_else(|| format!("'{word}' is none of {}", choices.join(", ")))?
        }
        (_, text) => text.parse().map_err(|_| format!("'{}' is not a number", text.escape_debug()))?,
    };
    let Some(given) = node.attribute("unit").filter(|unit| *unit != variable.unit) else { return Ok(number) };
    match (unit::parse(given), unit::parse(variable.unit)) {
        (Some(from), Some(to)) if from.exponents == to.exponents => Ok(number * from.factor / to.factor),
        _ => Err(format!("its unit is {given}; {} is expected", variable.unit)),
    }
}
