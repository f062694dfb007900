//! The reference experiment that every FMU carries: inputs, and the outputs that its library gave for them, so that a
//! user can prove on another host that nothing was lost on the way. The layout is that of FMI-LS-REF.

use super::PackError;
use crate::describe::quantity;
use crate::instance::Instance;
use crate::model::{Model, Place, Type};
use std::fmt::Write as _;
use wheelstate::Variable;
use wheelstate::parameter_set::number;

/// Folder of the layered standard.
pub const FOLDER: &str = "extra/org.fmi-standard.fmi-ls-ref";
/// The experiment.
pub const EXPERIMENTS: &str = "experiments.xml";
const INPUT: &str = "reference_in.csv";
const OUTPUT: &str = "reference_out.csv";

/// Largest deviation allowed, relative to the larger of 1 and the value: other platforms round sines, exponentials and
/// the like in other ways, by some 1e-16, which a filter may amplify.
const TOLERANCE: f64 = 1e-6;

const STEPS: usize = 200;

/// Amplitude of the inputs beside what is usual.
const SIZE: f64 = 0.3;

/// In every 13th row half of the samples are missing.
const GAP: usize = 13;

/// Inputs of every row: slow oscillations, small beside what a machine usually does, so that no estimator loses track.
fn inputs(model: &Model) -> Vec<Vec<f64>> {
    let signal = |i: usize, variable: &Variable, row: usize| {
        if variable.may_be_missing() && row % GAP == GAP - 1 && (row / GAP + i).is_multiple_of(2) {
            return f64::NAN;
        }
        if Type::of(variable.kind) != Type::Real {
            return variable.start;
        }
        let phase = 0.7 * i as f64 + row as f64 * (0.02 + 0.003 * (i % 7) as f64);
        let start = if variable.start.is_nan() { 0.0 } else { variable.start };
        let value = start + SIZE * quantity::nominal(variable.unit, 0.0) * phase.sin();
        (value * 1e6).round() / 1e6
    };
    let row = |row: usize| model.inputs.iter().enumerate().map(|(i, variable)| signal(i, variable, row)).collect();
    (0..STEPS).map(row).collect()
}

/// The outputs at every communication point, as FMI numbers them.
fn outputs(model: &Model, inputs: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, String> {
    let text = |refusal: crate::refusal::Refusal| refusal.message;
    let period = model.sample_period();
    let mut instance = Instance::new(model.clone(), "");
    let (references, reals) = real_inputs(model);
    let set = |instance: &mut Instance, row: &[f64]| {
        let values: Vec<_> = reals.iter().map(|i| row[*i]).collect();
        instance.set(Type::Real, &references, |i| values[i]).map_err(text)
    };
    let read = |instance: &mut Instance| {
        let mut values = vec![0.0; model.outputs.len()];
        for (i, variable) in model.outputs.iter().enumerate() {
            let reference = Place::Output(i).reference();
            instance.get(Type::of(variable.kind), &[reference], |_, value| values[i] = value).map_err(text)?;
        }
        Ok::<_, String>(values)
    };
    instance.setup(0.0, None).map_err(text)?;
    instance.enter_initialization();
    set(&mut instance, &inputs[0])?;
    instance.exit_initialization().map_err(text)?;
    let mut rows = vec![read(&mut instance)?];
    for (k, row) in inputs.iter().enumerate() {
        set(&mut instance, row)?;
        instance.do_step(k as f64 * period, period).map_err(text)?;
        rows.push(read(&mut instance)?);
    }
    Ok(rows)
}

/// References and numbers of the inputs that are Real; others keep their starts.
fn real_inputs(model: &Model) -> (Vec<u32>, Vec<usize>) {
    let reals = (0..model.inputs.len()).filter(|i| Type::of(model.inputs[*i].kind) == Type::Real);
    reals.map(|i| (Place::Input(i).reference(), i)).unzip()
}

fn csv(model_period: f64, list: &[Variable], rows: &[Vec<f64>]) -> String {
    let mut text = String::from("time");
    for variable in list {
        let _ = write!(text, ",{}", variable.name);
    }
    text.push('\n');
    for (k, row) in rows.iter().enumerate() {
        text.push_str(&number(k as f64 * model_period));
        for value in row {
            text.push(',');
            // not as XML spells it: this is how fmpy and most others read it
            text.push_str(&if value.is_nan() { "nan".to_owned() } else { number(*value) });
        }
        text.push('\n');
    }
    text
}

/// The files of the experiment with their paths in the FMU.
pub fn files(model: &Model) -> Result<Vec<(String, String)>, PackError> {
    let period = model.sample_period();
    let inputs = inputs(model);
    let failed = |why| PackError(format!("{}: the reference experiment: {why}", model.name));
    let outputs = outputs(model, &inputs).map_err(failed)?;
    let stop = number(STEPS as f64 * period);
    let name = model.name;
    let experiments = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<Experiments>
  <Experiment name="reference" description="Slow signals with missing samples; the outputs of the library that was packed." startTime="0" stopTime="{stop}" stepSize="{}" tolerance="{}">
    <Stimuli source="{INPUT}"/>
    <References source="{OUTPUT}"/>
  </Experiment>
</Experiments>
"#,
        number(period),
        number(TOLERANCE),
    );
    let manifest = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-alpha.1" fmi-ls:fmi-ls-description="Layered Standard providing information on related files included in an FMU.">
  <Related type="application/xml" source="{EXPERIMENTS}" role="experiment/smoke-test" description="Run it with: pack verify {name}.fmu, or python verify.py {name}.fmu"/>
  <Related type="text/csv" source="{INPUT}" role="other" description="Inputs of the experiment; nan is a missing sample."/>
  <Related type="text/csv" source="{OUTPUT}" role="result" description="Outputs of the experiment at every communication point."/>
  <Related type="text/x-python" source="verify.py" role="other" description="Runs the experiment in fmpy."/>
  <Related type="application/x-ssp-parameter-set" source="../../resources/{name}.ssv" role="parameter" description="The start values of all parameters."/>
</fmiReferences>
"#
    );
    let csv_in = csv(period, &model.inputs, &inputs);
    let csv_out = csv(period, &model.outputs, &outputs);
    let script = include_str!("../../assets/verify.py").to_owned();
    let files = [
        (EXPERIMENTS, experiments),
        ("fmi-ls-manifest.xml", manifest),
        (INPUT, csv_in),
        (OUTPUT, csv_out),
        ("verify.py", script),
    ];
    Ok(files.map(|(name, text)| (format!("{FOLDER}/{name}"), text)).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::models;

    /// Other platforms round sines and the like in other ways; what that does to the outputs stays within what the
    /// experiment allows, for inputs that differ by a thousand such roundings do.
    #[test]
    fn the_experiment_forgives_the_rounding_of_other_platforms() {
        for model in models(&|_| true) {
            let plain = inputs(&model);
            let moved: Vec<Vec<f64>> = (plain.iter().enumerate())
                .map(|(k, row)| {
                    row.iter().map(|value| value * (1.0 + if k % 2 == 0 { 1e-13 } else { -1e-13 })).collect()
                })
                .collect();
            let (plain, moved) = (outputs(&model, &plain).unwrap(), outputs(&model, &moved).unwrap());
            let mut worst = (0.0, "");
            for (one, other) in plain.iter().zip(&moved) {
                for ((a, b), variable) in one.iter().zip(other).zip(&model.outputs) {
                    let deviation = (a - b).abs() / b.abs().max(1.0);
                    if deviation > worst.0 {
                        worst = (deviation, &variable.name);
                    }
                }
            }
            assert!(worst.0 < 0.1 * TOLERANCE, "{}: {:.1e} of {}", model.name, worst.0, worst.1);
        }
    }

    #[test]
    fn the_experiment_moves_the_outputs() {
        for model in models(&|_| true) {
            let rows = outputs(&model, &inputs(&model)).unwrap();
            let still = |i: &usize| rows.iter().all(|row| row[*i] == rows[0][*i]);
            let moving = (0..model.outputs.len()).filter(|i| !still(i)).count();
            assert!(moving >= 5, "{}: {moving} of {}", model.name, model.outputs.len());
        }
    }
}
