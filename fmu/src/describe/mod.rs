//! `modelDescription.xml` of a model, written from its declared variables.
//!
//! Inputs that may be missing are discrete: they are sampled signals, and a host that interpolated
//! between a number and NaN would lose the sample after every gap.

pub mod guid;
pub mod guide;
pub mod markdown;
pub mod page;
pub mod quantity;
pub mod schema;
pub mod signals;
pub mod start_values;
pub mod terminals;

use crate::model::{Model, Place, shown_start};
use std::collections::BTreeSet;
use std::ffi::CStr;
use std::fmt::Write as _;
use wheelstate::parameter_set::{base_unit, escape, number};
use wheelstate::variable::Kind;
use wheelstate::{Status, Variable, unit};

/// The log categories with their meaning.
pub const CATEGORIES: [(&CStr, &str); 4] = [
    (c"logStatusError", "A call was refused; nothing was changed. Reported by default."),
    (c"logStatusFatal", "An internal error; the instance is lost. Reported by default."),
    (c"logStatusDiscard", "A legal request that has no answer in this FMU. Reported by default."),
    (c"logEvents", "Initialisation, reset and restored states. Reported if logging is on."),
];

/// Variables of one causality, which is named, and how they are referred to.
type Group<'a> = (&'a [Variable], &'static str, fn(usize) -> Place);

/// The groups of a model in the order of the XML.
fn groups(model: &Model) -> [Group<'_>; 3] {
    [
        (&model.parameters, "parameter", Place::Parameter),
        (&model.inputs, "input", Place::Input),
        (&model.outputs, "output", Place::Output),
    ]
}

/// When this version was made, as `generationDateAndTime` of its FMUs: the same version gives the same bytes.
pub const MADE: &str = "2026-11-28T00:00:00Z";

/// The model description of a model.
pub fn xml(model: &Model) -> String {
    write(model, &guid::of(model), true)
}

/// The model description; without `starts` those of the parameters are blank.
fn write(model: &Model, guid: &str, starts: bool) -> String {
    let mut text = String::with_capacity(64 << 10);
    let version = env!("CARGO_PKG_VERSION");
    let _ = writeln!(
        text,
        r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{guid}" description="{about}" author="The wheelstate authors" version="{version}" copyright="Copyright (c) 2026 The wheelstate authors" license="MIT OR Apache-2.0" generationTool="wheelstate {version}" generationDateAndTime="{MADE}" variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true" maxOutputDerivativeOrder="1" canRunAsynchronuously="false" canBeInstantiatedOnlyOncePerProcess="false" canNotUseMemoryManagementFunctions="true" canGetAndSetFMUstate="true" canSerializeFMUstate="true" providesDirectionalDerivative="false"/>"#,
        name = model.name,
        about = escape(model.description),
    );
    write_units(&mut text, model);
    write_types(&mut text, model);
    text.push_str("  <LogCategories>\n");
    for (name, about) in CATEGORIES {
        let _ = writeln!(text, r#"    <Category name="{}" description="{about}"/>"#, name.to_string_lossy());
    }
    text.push_str("  </LogCategories>\n");
    let _ = writeln!(
        text,
        r#"  <DefaultExperiment startTime="0" stopTime="10" tolerance="1e-6" stepSize="{}"/>"#,
        if starts { number(model.sample_period()) } else { String::new() }
    );
    text.push_str("  <ModelVariables>\n");
    for (list, causality, place) in groups(model) {
        for (index, variable) in list.iter().enumerate() {
            write_variable(&mut text, variable, causality, place(index).reference(), starts);
        }
    }
    text.push_str("  </ModelVariables>\n");
    write_structure(&mut text, model);
    text.push_str("</fmiModelDescription>\n");
    text
}

fn write_units(text: &mut String, model: &Model) {
    let mut names: BTreeSet<&str> =
        groups(model).iter().flat_map(|(list, ..)| *list).filter(|v| v.kind == Kind::Real).map(|v| v.unit).collect();
    names.insert("s");
    text.push_str("  <UnitDefinitions>\n");
    for name in names {
        let _ = write!(text, r#"    <Unit name="{}">"#, escape(name));
        if let Some(unit) = unit::parse(name) {
            text.push_str(&base_unit("", unit));
        }
        if let Some((display, factor)) = unit::display(name) {
            let _ = write!(text, r#"<DisplayUnit name="{display}" factor="{}"/>"#, number(factor));
        }
        text.push_str("</Unit>\n");
    }
    text.push_str("  </UnitDefinitions>\n");
}

/// The type of an enumeration: the variable's name in camel case.
fn type_name(variable: &Variable) -> String {
    let words = variable.name.split(['.', '_']);
    let mut name: String = words.map(|word| word[..1].to_uppercase() + &word[1..]).collect();
    name.push_str("Choice");
    name
}

fn write_types(text: &mut String, model: &Model) {
    let mut types = String::new();
    for variable in groups(model).iter().flat_map(|(list, ..)| *list) {
        let Kind::Choice(items) = variable.kind else { continue };
        let _ = writeln!(types, r#"    <SimpleType name="{}"><Enumeration>"#, type_name(variable));
        for (i, item) in items.iter().enumerate() {
            let _ = writeln!(types, r#"      <Item name="{}" value="{}"/>"#, escape(item), i + 1);
        }
        types.push_str("    </Enumeration></SimpleType>\n");
    }
    if !types.is_empty() {
        let _ = write!(text, "  <TypeDefinitions>\n{types}  </TypeDefinitions>\n");
    }
}

/// The description with what a user of this variable must know besides.
pub fn description(variable: &Variable) -> String {
    let mut text = variable.description.to_string();
    // a description that speaks of it itself says more
    if variable.may_be_missing() && !text.contains("NaN") && !text.contains("missing") {
        text.push_str(if variable.held { " NaN: the last value holds." } else { " NaN: no sample at this instant." });
    }
    if variable.name == "status" {
        text.push_str(" Sum of:");
        for (i, (bit, word, _)) in Status::ALL.iter().enumerate() {
            let _ = write!(text, "{} {} {word}", if i == 0 { "" } else { "," }, 1_u32 << bit);
        }
        text.push('.');
    }
    text
}

fn write_variable(text: &mut String, variable: &Variable, causality: &str, reference: u32, starts: bool) {
    let parameter = causality == "parameter";
    let variability = match (parameter, variable.tunable, variable.kind) {
        (true, false, _) => "fixed",
        (true, true, _) => "tunable",
        (false, _, Kind::Real) if !variable.may_be_missing() => "continuous",
        _ => "discrete",
    };
    let initial = match causality {
        "parameter" => r#" initial="exact""#,
        "output" => r#" initial="calculated""#,
        _ => "",
    };
    let _ = write!(
        text,
        r#"    <ScalarVariable name="{}" valueReference="{reference}" description="{}" causality="{causality}" variability="{variability}"{initial}><"#,
        variable.name,
        escape(&description(variable)),
    );
    match variable.kind {
        Kind::Real => {
            text.push_str("Real");
            if let Some(quantity) = quantity::name(variable.unit) {
                let _ = write!(text, r#" quantity="{quantity}""#);
            }
            let _ = write!(text, r#" unit="{}""#, escape(variable.unit));
            if let Some((display, _)) = unit::display(variable.unit) {
                let _ = write!(text, r#" displayUnit="{display}""#);
            }
        }
        Kind::Integer | Kind::Code(_) => text.push_str("Integer"),
        Kind::Boolean => text.push_str("Boolean"),
        Kind::Choice(_) => {
            let _ = write!(text, r#"Enumeration declaredType="{}""#, type_name(variable));
        }
    }
    if matches!(variable.kind, Kind::Real | Kind::Integer | Kind::Code(_)) {
        let whole = variable.kind != Kind::Real;
        // an input that may be missing takes any number
        let any = (f64::NEG_INFINITY, f64::INFINITY);
        let (low, high) = if variable.may_be_missing() { any } else { variable.range };
        for (name, bound, free) in [("min", low, i32::MIN), ("max", high, i32::MAX)] {
            if bound.is_finite() && !(whole && bound == f64::from(free)) {
                let _ = write!(text, r#" {name}="{}""#, number(bound));
            }
        }
    }
    if variable.kind == Kind::Real && (!parameter || starts) {
        let _ = write!(text, r#" nominal="{}""#, number(quantity::nominal(variable.unit, variable.start)));
    }
    if causality != "output" {
        let start = match variable.kind {
            _ if parameter && !starts => String::new(),
            Kind::Boolean => (variable.start != 0.0).to_string(),
            Kind::Choice(_) => number(variable.start + 1.0),
            _ => number(shown_start(variable)),
        };
        let _ = write!(text, r#" start="{start}""#);
    }
    text.push_str("/></ScalarVariable>\n");
}

/// Outputs change in `fmi2DoStep` only, so at a communication point they depend on no input; before
/// the first sample they may depend on every parameter.
fn write_structure(text: &mut String, model: &Model) {
    let first = model.parameters.len() + model.inputs.len();
    let indices = || (1..=model.outputs.len()).map(|i| first + i);
    text.push_str("  <ModelStructure>\n    <Outputs>\n");
    for index in indices() {
        let _ = writeln!(text, r#"      <Unknown index="{index}" dependencies=""/>"#);
    }
    text.push_str("    </Outputs>\n    <InitialUnknowns>\n");
    for index in indices() {
        let _ = writeln!(text, r#"      <Unknown index="{index}"/>"#);
    }
    text.push_str("    </InitialUnknowns>\n  </ModelStructure>\n");
}
