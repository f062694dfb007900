//! Parameter sets (SSP 1.0 `.ssv`): the one that every FMU carries, a preset to copy and edit, and those that a user
//! brings to have them baked in.

use super::fit::{Baked, parse, taken, unknown};
use super::{PackError, read};
use crate::model::{Model, check_parameter};
use roxmltree::{Document, Node};
use std::path::Path;
use wheelstate::parameter_set::{Entry, Value, write};
use wheelstate::unit;
use wheelstate::variable::Kind;

/// The parameter set of the model's start values. Enumerations are left out: they stand at their start values, and
/// several hosts refuse a set that names one.
pub fn text(model: &Model) -> String {
    let entries = model.parameters.iter().filter_map(|variable| {
        let value = match variable.kind {
            Kind::Real => Value::Real(variable.start, variable.unit),
            Kind::Integer | Kind::Code(_) => Value::Integer(variable.start as i32),
            Kind::Boolean => Value::Boolean(variable.start != 0.0),
            Kind::Choice(_) => return None,
        };
        Some(Entry { name: &variable.name, description: &variable.description, value })
    });
    write(model.name, entries)
}

/// A parameter set that a user brings.
#[derive(Clone, Debug)]
pub struct ParameterSet {
    /// Where it came from, for messages.
    pub source: String,
    /// Its name; sets that this project writes are named after their model.
    pub name: String,
    parameters: Vec<Parameter>,
}

#[derive(Clone, Debug)]
struct Parameter {
    name: String,
    /// `Real`, `Integer`, `Boolean`, `Enumeration` or another type.
    class: String,
    value: String,
    unit: Option<String>,
}

const NAMESPACE: &str = "http://ssp-standard.org/SSP1/SystemStructureParameterValues";

impl ParameterSet {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, PackError> {
        read(path, Self::parse)
    }

    /// Reads the text of an SSV 1.0 parameter set; errors begin with `source`.
    pub fn parse(source: &str, text: &str) -> Result<Self, PackError> {
        let refuse = |what: String| PackError(format!("{source}: {what}"));
        let document = Document::parse(text).map_err(|error| refuse(format!("not readable as XML: {error}")))?;
        let root = document.root_element();
        if !root.has_tag_name((NAMESPACE, "ParameterSet")) {
            return Err(refuse("its root is not an ssv:ParameterSet of SSP 1.0".to_owned()));
        }
        let mut parameters = Vec::new();
        for node in root.descendants().filter(|node| node.has_tag_name((NAMESPACE, "Parameter"))) {
            let line = document.text_pos_at(node.range().start).row;
            let broken = |what: &str| refuse(format!("line {line}: {what}"));
            let name = node.attribute("name").ok_or_else(|| broken("a parameter without a name"))?;
            let value = node.children().find(Node::is_element).ok_or_else(|| broken("a parameter without a value"))?;
            let text = value.attribute("value").ok_or_else(|| broken("a value without its attribute value"))?;
            parameters.push(Parameter {
                name: name.to_owned(),
                class: value.tag_name().name().to_owned(),
                value: text.trim().to_owned(),
                unit: value.attribute("unit").map(str::to_owned),
            });
        }
        let name = root.attribute("name").unwrap_or_default().to_owned();
        Ok(Self { source: source.to_owned(), name, parameters })
    }

    /// Puts its values into the model's start values, all or none.
    pub fn bake(&self, model: &mut Model) -> Result<Baked, PackError> {
        let refuse = |what: String| PackError(format!("{}: {what}", self.source));
        if !self.parameters.iter().any(|parameter| model.parameter(&parameter.name).is_some()) {
            return Err(refuse(format!("none of its parameters is one of {}", model.name)));
        }
        let (mut baked, mut values, mut foreign) = (Baked::default(), Vec::new(), Vec::new());
        for parameter in &self.parameters {
            let Some((index, _)) = model.parameter(&parameter.name) else {
                foreign.push(parameter.name.as_str());
                continue;
            };
            let value = parameter.value(model, index).map_err(|what| refuse(format!("{}: {what}", parameter.name)))?;
            check_parameter(&model.parameters[index], value).map_err(&refuse)?;
            values.push((index, value));
            if value != model.parameters[index].start {
                baked.taken.push(taken(model, index, value));
            }
        }
        baked.warnings.extend(unknown(&foreign, self.parameters.len()));
        model.bake(&values).map_err(|error| refuse(format!("the model refuses these values together: {error}")))?;
        Ok(baked)
    }
}

impl Parameter {
    /// The value in the unit that the model declares.
    fn value(&self, model: &Model, index: usize) -> Result<f64, String> {
        let variable = &model.parameters[index];
        let fits = match variable.kind {
            Kind::Real => matches!(self.class.as_str(), "Real" | "Integer"),
            Kind::Integer | Kind::Code(_) => self.class == "Integer",
            Kind::Boolean => self.class == "Boolean",
            Kind::Choice(_) => self.class == "Enumeration",
        };
        if !fits {
            return Err(format!("its value is of type {}", self.class));
        }
        let text = match (variable.kind, self.value.as_str()) {
            (Kind::Boolean, "1") => "true",
            (Kind::Boolean, "0") => "false",
            (_, text) => text,
        };
        let value = parse(variable, text)?;
        let Some(unit) = self.unit.as_deref().filter(|unit| *unit != variable.unit) else { return Ok(value) };
        match (unit::parse(unit), unit::parse(variable.unit)) {
            (Some(given), Some(own)) if given.exponents == own.exponents => Ok(value * given.factor / own.factor),
            _ => Err(format!("its unit is {unit}; {} is expected", variable.unit)),
        }
    }
}
