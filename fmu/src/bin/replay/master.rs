//! The co-simulation master: one instance, one step per row of the log.

use crate::messages::reason;
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{CoSimulation, Common, InstanceCS};
use fmi::fmi2::schema::{Causality, ScalarVariableElement};
use fmi::traits::FmiImport;
use std::path::Path;
use wheelstate::variable::Kind;
use wheelstate_fmu::model::{Model, models};
use wheelstate_log::progress::Progress;
use wheelstate_log::{Channel, Log};

/// Rows between two looks at the progress bar.
const STRIDE: usize = 1000;

#[derive(Clone, Copy, PartialEq)]
enum Class {
    Real,
    Whole,
    Boolean,
}

/// A variable of the FMU.
struct Entry {
    name: String,
    reference: u32,
    class: Class,
    causality: Causality,
    start: f64,
}

/// Runs the FMU over the log and gives its outputs at the start and at the end of every row.
pub fn run(path: &Path, log: &Log, settings: &[String], progress: &Progress) -> Result<Log, String> {
    let shown = path.display();
    let fmu: Fmi2Import = fmi::import::from_path(path).map_err(|error| format!("{shown}: {error}"))?;
    let entries = entries(&fmu);
    let name = fmu.model_description().model_name.clone();
    let known = models(&|model| model == name).pop();
    let mut instance =
        fmu.instantiate_cs("replay", false, false).map_err(|error| format!("{shown}: {}", reason(error)))?;

    let mut period_given = false;
    for text in settings {
        let (entry, value) = setting(&entries, known.as_ref(), text)?;
        period_given |= entry.name == "sample_period";
        set(&mut instance, entry, value).map_err(|why| format!("--set {text}: {why}"))?;
    }
    if let Some(entry) = entries.iter().find(|entry| entry.name == "sample_period").filter(|_| !period_given) {
        let (own, rows) = (entry.start, period(log));
        if rows > 1.01 * own {
            // round off what writing the times left behind
            let rows = (rows * 1e9).round() / 1e9;
            eprintln!("sample_period = {rows} s, the distance of the rows (the FMU's own is {own} s)");
            set(&mut instance, entry, rows)?;
        } else if rows < 0.99 * own {
            eprintln!("note: sample_period = {own} s, so not every row is used (they are {rows} s apart)");
        }
    }
    let inputs = inputs(&entries, log);
    let refused = |what: &str, error| format!("{shown}: {what}: {}", reason(error));
    let start = log.time[0];
    instance.setup_experiment(None, start, None).map_err(|error| refused("set-up", error))?;
    apply(&mut instance, &inputs, log, 0)?;
    instance.enter_initialization_mode().map_err(|error| refused("initialisation", error))?;
    instance.exit_initialization_mode().map_err(|error| refused("initialisation", error))?;

    let outputs: Vec<_> = entries.iter().filter(|entry| entry.causality == Causality::Output).collect();
    let mut time = vec![start];
    let mut columns = vec![Vec::with_capacity(log.len() + 1); outputs.len()];
    record(&mut instance, &outputs, &mut columns)?;
    progress.start("running the FMU", log.len() as u64);
    let last = period(log);
    for (row, &begin) in log.time.iter().enumerate() {
        apply(&mut instance, &inputs, log, row)?;
        let end = log.time.get(row + 1).copied().unwrap_or(begin + last);
        instance
            .do_step(begin, end - begin, true)
            .map_err(|error| format!("{}: {}", place(log, row), reason(error)))?;
        time.push(end);
        record(&mut instance, &outputs, &mut columns)?;
        if row % STRIDE == STRIDE - 1 {
            progress.advance(STRIDE as u64);
        }
    }
    progress.finish();
    instance.terminate().map_err(|error| refused("end", error))?;
    let channel = |(entry, values): (&&Entry, Vec<f64>)| Channel { name: entry.name.clone(), values: values.into() };
    let channels = outputs.iter().zip(columns).map(channel).collect();
    Ok(Log { time: time.into(), channels, ..Log::default() })
}

/// The median time between two rows, s.
fn period(log: &Log) -> f64 {
    let mut gaps: Vec<_> = log.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    gaps[gaps.len() / 2]
}

/// The place of a row, for messages.
fn place(log: &Log, row: usize) -> String {
    format!("{}: sample {} at {} s", log.source, row + 1, log.time[row])
}

fn entries(fmu: &Fmi2Import) -> Vec<Entry> {
    let entry = |variable: &fmi::fmi2::schema::ScalarVariable| {
        let (class, start) = match &variable.elem {
            ScalarVariableElement::Real(real) => (Class::Real, real.start),
            ScalarVariableElement::Integer(integer) => (Class::Whole, integer.start.map(f64::from)),
            ScalarVariableElement::Boolean(boolean) => (Class::Boolean, boolean.start.map(|b| f64::from(u8::from(b)))),
            ScalarVariableElement::Enumeration => (Class::Whole, None),
            ScalarVariableElement::String => return None,
        };
        Some(Entry {
            name: variable.name.clone(),
            reference: variable.value_reference,
            class,
            causality: variable.causality.clone(),
            start: start.unwrap_or(f64::NAN),
        })
    };
    fmu.model_description().get_model_variables().filter_map(entry).collect()
}

/// The input variables with the columns of the log that they are read from.
fn inputs<'a>(entries: &'a [Entry], log: &Log) -> Vec<(&'a Entry, usize)> {
    let (mut found, mut absent) = (Vec::new(), Vec::new());
    for entry in entries.iter().filter(|entry| entry.causality == Causality::Input) {
        match log.channels.iter().position(|channel| channel.name == entry.name) {
            Some(column) => found.push((entry, column)),
            None => absent.push(entry.name.as_str()),
        }
    }
    if !absent.is_empty() {
        eprintln!("note: the log has no column for {}: they keep their start values", absent.join(", "));
    }
    found
}

/// Reads `name=value`; choices may be named if the FMU is of a model that this program knows.
fn setting<'a>(entries: &'a [Entry], known: Option<&Model>, text: &str) -> Result<(&'a Entry, f64), String> {
    let parts = text.split_once('=').map(|(name, word)| (name.trim(), word.trim()));
    let Some((name, word)) = parts.filter(|(name, word)| !name.is_empty() && !word.is_empty()) else {
        return Err(format!("--set {text}: name=value is expected, as in sample_period=0.02"));
    };
    let settable = |entry: &&Entry| matches!(entry.causality, Causality::Parameter | Causality::Input);
    let Some(entry) = entries.iter().filter(settable).find(|entry| entry.name == name) else {
        return Err(format!("--set {text}: the FMU has no parameter or input '{name}'"));
    };
    let kind = known.and_then(|model| model.parameter(name)).map(|(_, variable)| variable.kind);
    if let Some(Kind::Choice(items)) = kind
        && word.parse::<f64>().is_err()
    {
        let index = items.iter().position(|item| *item == word);
        let index = index.ok_or_else(|| format!("--set {text}: '{word}' is none of {}", items.join(", ")))?;
        return Ok((entry, (index + 1) as f64));
    }
    let value = match word {
        "true" => Some(1.0),
        "false" => Some(0.0),
        _ => word.parse().ok(),
    };
    value.map(|value| (entry, value)).ok_or_else(|| format!("--set {text}: '{}' is not a number", word.escape_debug()))
}

fn set(instance: &mut InstanceCS, entry: &Entry, value: f64) -> Result<(), String> {
    if entry.class != Class::Real && value.fract() != 0.0 {
        return Err(format!("{} = {value} is not a whole number", entry.name));
    }
    let result = match entry.class {
        Class::Real => instance.set_real(&[entry.reference], &[value]),
        Class::Whole => instance.set_integer(&[entry.reference], &[value as i32]),
        Class::Boolean => instance.set_boolean(&[entry.reference], &[i32::from(value != 0.0)]),
    };
    result.map(drop).map_err(reason)
}

fn apply(instance: &mut InstanceCS, inputs: &[(&Entry, usize)], log: &Log, row: usize) -> Result<(), String> {
    for (entry, column) in inputs {
        set(instance, entry, log.channels[*column].values[row]).map_err(|why| format!("{}: {why}", place(log, row)))?;
    }
    Ok(())
}

fn record(instance: &mut InstanceCS, outputs: &[&Entry], columns: &mut [Vec<f64>]) -> Result<(), String> {
    for (entry, column) in outputs.iter().zip(columns) {
        let (mut real, mut whole) = ([0.0], [0]);
        let got = match entry.class {
            Class::Real => instance.get_real(&[entry.reference], &mut real),
            Class::Whole => instance.get_integer(&[entry.reference], &mut whole),
            Class::Boolean => instance.get_boolean(&[entry.reference], &mut whole),
        };
        got.map_err(|error| format!("{}: {}", entry.name, reason(error)))?;
        column.push(if entry.class == Class::Real { real[0] } else { f64::from(whole[0]) });
    }
    Ok(())
}
