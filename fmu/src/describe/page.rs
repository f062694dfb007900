//! `documentation/index.html` of a model, written from its declared variables.

use super::description;
use crate::clock::MOST_SAMPLES;
use crate::model::{Model, range_text};
use std::fmt::Write as _;
use wheelstate::parameter_set::{escape, number};
use wheelstate::unit::display;
use wheelstate::variable::Kind;
use wheelstate::{Status, Variable};

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:62em;margin:2em auto;padding:0 1em;color:#1c2a33}\
h1,h2{line-height:1.2}h2{margin-top:2em;border-bottom:1px solid #cfd8dc}table{border-collapse:collapse;width:100%;font-size:14px}\
th,td{text-align:left;vertical-align:top;padding:.3em .6em;border-bottom:1px solid #e3e9ec}th{background:#eef3f5}\
td:first-child,code{font-family:ui-monospace,monospace;font-size:.93em}pre{background:#f4f7f8;padding:1em;overflow:auto}";

/// The documentation page.
pub fn html(model: &Model) -> String {
    let (name, about) = (model.name, escape(model.description));
    let period = number(model.sample_period());
    let mut page = format!(
        r#"<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{name}</title><style>{STYLE}</style></head><body>
<h1>{name}</h1>
<p>{about}</p>
<p>FMI 2.0 co-simulation, wheelstate {version}. SI units. Licence: MIT or Apache 2.0 (<a href="licenses/">licenses</a>).</p>
<h2>Run it over a log</h2>
<pre>import fmpy

log = fmpy.read_csv("log.csv")     # columns: time and the inputs below; nan = no sample
result = fmpy.simulate_fmu(
    "{name}.fmu",
    input=log,
    start_time=log["time"][0],
    stop_time=log["time"][-1],
    output_interval={period},       # fmpy would otherwise record at most 1000 points
    start_values={{"sample_period": {period}}},
)</pre>
<p>Set <code>sample_period</code> to the time between two rows of the log. Inputs without a column keep their start values.</p>
<p>fmpy searches the rows of discrete inputs anew at every step, so that time grows with the square of a log's length. For more than
some thousand rows, {period} s apart, set the inputs after each step instead; the results are the same:</p>
<pre id="long-logs">import fmpy

log = fmpy.read_csv("log.csv")
fmu = "{name}.fmu"
variables = {{v.name: v.valueReference for v in fmpy.read_model_description(fmu).modelVariables}}
names = [name for name in log.dtype.names if name in variables]
references = [variables[name] for name in names]
rows = iter(log[names].tolist())
first = dict(zip(names, next(rows)))

def feed(time, recorder):
    row = next(rows, None)
    if row is not None:
        recorder.fmu.setReal(references, row)
    return True

start, period = log["time"][0], {period}
result = fmpy.simulate_fmu(fmu, start_time=start, stop_time=start + len(log) * period, output_interval=period,
                           start_values=first, step_finished=feed)</pre>
<p>fmpy compares times relative to their size: times that count from 1970 are too large for it. Let the log begin near 0.</p>
<h2>Other hosts</h2>
<ul>
<li>A host that knows no NaN (OMSimulator): set <code>missing_value</code> to a number that no sensor gives, and send that.</li>
<li>A host that sets every input whether connected or not: switch the others off with <code>use.*</code>.</li>
<li>A host that cannot set enumerations (FMI.jl, libcosim): choose when packing, <code>pack {name} --set parameter=choice</code>.</li>
<li>SSP: <code>resources/{name}.ssv</code> is a parameter set with all start values, to be copied and edited;
<code>pack {name} --params edited.ssv</code> writes it into the FMU.</li>
<li>Is this FMU what was packed? <code>pack verify {name}.fmu</code>, or <code>python verify.py {name}.fmu</code> with the script in
<code>extra/org.fmi-standard.fmi-ls-ref</code>, runs the reference experiment that stands beside it.</li>
</ul>
<h2>Time and samples</h2>
<p>Sample instants are the start time plus whole multiples of <code>sample_period</code>. A step from t over h takes every sample
instant in [t, t + h) in order, with the inputs as last set, or extrapolated with their derivatives where the host gave them
(<code>fmi2SetRealInputDerivatives</code>, order 1, for the next step). A sample is a time update since the sample before and then
the measurement update. The outputs at t + h are the estimates of the last sample carried forward to t + h by the model, with the
inputs of that sample held; nothing of this is fed back. Before the first sample they are the initial state. Any step size works, and
any start time. A step that would pass the stop time, or take more than {most} samples, is refused.</p>
<h2>Missing samples</h2>
<p>NaN in an input that allows it means that this channel has no sample at this instant. An infinite value counts as missing too
and raises a bit of <code>status</code>. An input that allows it is missing until the host sets it, whatever start value the XML
must state. For a host that knows no NaN, <code>missing_value</code> is the number that it sends instead; for one that sets every
input, <code>use.*</code> switches off the sensors that the machine does not have. Estimates never become NaN: what has no value
yet holds its start value and is flagged.</p>
<h2>State</h2>
<p>States can be copied, restored, written as bytes and read back, also in another process and before initialisation. Repeating the
same steps from a state repeats the results bit for bit.</p>
"#,
        version = env!("CARGO_PKG_VERSION"),
        most = MOST_SAMPLES,
    );
    table(&mut page, "Inputs", &model.inputs, true, false);
    table(&mut page, "Outputs", &model.outputs, false, false);
    page.push_str("<h2>Bits of status</h2>\n<table><tr><th>Value</th><th>Word</th><th>Meaning</th></tr>\n");
    for (bit, word, meaning) in Status::ALL {
        let _ = writeln!(page, "<tr><td>{}</td><td>{word}</td><td>{}</td></tr>", 1_u32 << bit, escape(meaning.trim()));
    }
    page.push_str("</table>\n");
    table(&mut page, "Parameters", &model.parameters, true, true);
    page.push_str(
        "<p>A fixed parameter is set before the end of the initialisation, a tunable one at any time. A value outside its range\n\
         is refused with a message that names it. Parameters that do not fit each other are refused at the end of the initialisation.</p>\n\
         </body></html>\n",
    );
    page
}

fn table(page: &mut String, title: &str, list: &[Variable], starts: bool, changes: bool) {
    let _ = write!(page, "<h2>{title}</h2>\n<table><tr><th>Name</th><th>Unit</th>");
    for (column, shown) in [("Start", starts), ("Allowed", changes), ("Change", changes)] {
        if shown {
            let _ = write!(page, "<th>{column}</th>");
        }
    }
    page.push_str("<th>Meaning</th></tr>\n");
    for variable in list {
        let _ = write!(page, "<tr><td>{}</td><td>{}</td>", variable.name, escape(unit(variable)));
        if starts {
            let _ = write!(page, "<td>{}</td>", escape(&start(variable)));
        }
        if changes {
            let change = if variable.tunable { "tunable" } else { "fixed" };
            let _ = write!(page, "<td>{}</td><td>{change}</td>", escape(&range_text(variable)));
        }
        let _ = writeln!(page, "<td>{}</td></tr>", escape(&description(variable)));
    }
    page.push_str("</table>\n");
}

/// What stands in a table as the unit.
pub(super) fn unit(variable: &Variable) -> &str {
    match variable.kind {
        Kind::Real => variable.unit,
        Kind::Integer | Kind::Code(_) => "integer",
        Kind::Boolean => "boolean",
        Kind::Choice(_) => "choice",
    }
}

/// The start value in words.
pub(super) fn start(variable: &Variable) -> String {
    if variable.start.is_nan() {
        return "missing".to_owned();
    }
    match variable.kind {
        Kind::Boolean => (variable.start != 0.0).to_string(),
        Kind::Choice(items) => items.get(variable.start as usize).copied().unwrap_or_default().to_owned(),
        _ => match display(variable.unit) {
            Some((shown, factor)) if variable.start != 0.0 && variable.start.is_finite() => {
                format!("{} ({:.4} {shown})", number(variable.start), variable.start * factor)
            }
            _ => number(variable.start),
        },
    }
}
