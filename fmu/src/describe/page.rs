//! `documentation/index.html` of a model: what a person opens who has the FMU in a tool. Drawn and written from the
//! declared variables and from the [guide]; readable without scripts, in light and in dark.

use super::description;
use super::guide::{self, Guide};
use super::signals::{families, is_std, svg};
use crate::clock::MOST_SAMPLES;
use crate::model::{Model, range_text};
use std::fmt::Write as _;
use wheelstate::parameter_set::{escape, number};
use wheelstate::unit::display;
use wheelstate::variable::Kind;
use wheelstate::{Status, Variable};

const STYLE: &str = include_str!("../../assets/page.css");

/// Lists of variables longer than this are folded by family.
const LONG: usize = 24;

/// The documentation page.
pub fn html(model: &Model) -> String {
    let guide = guide::of(model);
    let mut page = Page { text: String::with_capacity(128 << 10), contents: Vec::new() };
    set_first(&mut page, model);
    run(&mut page, model);
    if let Some(guide) = guide {
        explain(&mut page, guide);
    }
    status(&mut page);
    if let Some(guide) = guide {
        figures(&mut page, guide);
    }
    hosts(&mut page, model);
    page.heading("inputs", "Inputs");
    variables(&mut page, &model.inputs, '_', Columns::Input);
    page.heading("outputs", "Outputs");
    variables(&mut page, &model.outputs, '_', Columns::Output);
    page.heading("parameters", "Parameters");
    page.text.push_str(
        "<p>A fixed parameter is set before the end of the initialisation, a tunable one at any time. A value outside its range\n\
         is refused with a message that names it. Parameters that do not fit each other are refused at the end of the initialisation.</p>\n",
    );
    variables(&mut page, &model.parameters, '.', Columns::Parameter);

    let links: Vec<_> = page.contents.iter().map(|(id, title)| format!("<a href=\"#{id}\">{title}</a>")).collect();
    format!(
        r#"<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"/><meta name="viewport" content="width=device-width"/><title>{name}</title><style>{STYLE}</style></head><body>
<h1>{name}</h1>
<div class="about">{about}</div>
<p>FMI 2.0 co-simulation, wheelstate {version}. SI units and radians; frames with x forward, y left, z up. Licence: MIT or Apache 2.0
(<a href="licenses/license.txt">licenses</a>).</p>
<figure>{signals}<figcaption>Inputs and outputs. Every estimate <code>x</code> has its standard deviation <code>x_std</code>.</figcaption></figure>
<nav>{links}</nav>
{text}</body></html>
"#,
        name = model.name,
        about = guide.map_or_else(|| format!("<p>{}.</p>", escape(model.description)), |guide| guide.introduction()),
        version = env!("CARGO_PKG_VERSION"),
        signals = svg(model),
        links = links.join(" "),
        text = page.text,
    )
}

/// The page as it grows, with the headings so far.
struct Page {
    text: String,
    contents: Vec<(String, String)>,
}

impl Page {
    fn heading(&mut self, id: &str, title: &str) {
        let _ = writeln!(self.text, "<h2 id=\"{id}\">{title}</h2>");
        self.contents.push((id.to_owned(), title.to_owned()));
    }

    /// A table with these columns; `rows` writes its rows.
    fn table(&mut self, columns: &[&str], rows: impl FnOnce(&mut String)) {
        let head: String = columns.iter().map(|column| format!("<th>{column}</th>")).collect();
        let _ = writeln!(self.text, "<div class=\"wide\"><table><tr>{head}</tr>");
        rows(&mut self.text);
        self.text.push_str("</table></div>\n");
    }
}

fn set_first(page: &mut Page, model: &Model) {
    let first: Vec<_> = model.parameters.iter().filter(|variable| variable.essential).collect();
    if !first.is_empty() {
        page.heading("first", "Set these first");
        page.table(Columns::Parameter.titles(), |text| {
            first.iter().for_each(|v| Columns::Parameter.row(text, v, false))
        });
    }
}

fn run(page: &mut Page, model: &Model) {
    let (name, period) = (model.name, number(model.sample_period()));
    page.heading("run", "Run it over a log");
    let _ = write!(
        page.text,
        r#"<pre>import fmpy

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
"#
    );
}

/// What the estimator does, what it cannot, how to tune it, and the equations.
fn explain(page: &mut Page, guide: &Guide) {
    for (title, text) in guide.sections.iter().filter(|(title, _)| !title.is_empty()) {
        page.heading(&title.to_lowercase().replace(' ', "-"), title);
        page.text.push_str(text);
    }
    page.heading("equations", "Equations");
    for (sentence, text) in guide.linked {
        let open = if sentence.starts_with("model::") { " open=\"open\"" } else { "" };
        let _ = writeln!(page.text, "<details{open}><summary>{}</summary>{text}</details>", escape(sentence));
    }
}

fn status(page: &mut Page) {
    page.heading("status", "Bits of status");
    page.table(&["Value", "Word", "Meaning"], |text| {
        for (bit, word, meaning) in Status::ALL {
            let _ =
                writeln!(text, "<tr><td>{}</td><td>{word}</td><td>{}</td></tr>", 1_u32 << bit, escape(meaning.trim()));
        }
    });
}

/// What was measured, and what the estimator cannot do.
fn figures(page: &mut Page, guide: &Guide) {
    page.heading("measured", "Measured");
    page.text
        .push_str("<p>Medians, and 95th percentiles where two numbers stand; with the test that shows them.</p>\n");
    page.table(&["What", "Measured"], |text| {
        for [what, measured] in guide.measured {
            let _ = writeln!(text, "<tr><td class=\"prose\">{what}</td><td>{measured}</td></tr>");
        }
    });
    page.heading("limits", "Limits");
    let items: String = guide.limits.iter().map(|limit| format!("<li>{limit}</li>\n")).collect();
    let _ = writeln!(page.text, "<ul>\n{items}</ul>");
}

fn hosts(page: &mut Page, model: &Model) {
    let name = model.name;
    page.heading("hosts", "Other hosts");
    let _ = write!(
        page.text,
        r#"<ul>
<li>A host without NaN (OMSimulator): set <code>missing_value</code> to a number that no sensor gives, and send that.</li>
<li>A host that sets every input whether connected or not: switch the others off with <code>use.*</code>.</li>
<li>A host that cannot set enumerations (FMI.jl, libcosim): choose when packing, <code>pack {name} --set parameter=choice</code>.</li>
<li>SSP: <code>resources/{name}.ssv</code> is a parameter set with all start values, to be copied and edited;
<code>pack {name} --params edited.ssv</code> writes it into the FMU.</li>
<li>Is this FMU what was packed? <code>pack verify {name}.fmu</code>, or <code>python verify.py {name}.fmu</code> with the script in
<code>extra/org.fmi-standard.fmi-ls-ref</code>, runs the reference experiment that stands beside it.</li>
</ul>
"#
    );
    page.heading("time", "Time and samples");
    let _ = write!(
        page.text,
        r#"<p>Sample instants are the start time plus whole multiples of <code>sample_period</code>. A step from t over h takes every sample
instant in [t, t + h) in order, with the inputs as last set, or extrapolated with their derivatives where the host gave them
(<code>fmi2SetRealInputDerivatives</code>, order 1, for the next step). A sample is a time update since the sample before and then
the measurement update. The outputs at t + h are the estimates of the last sample carried forward to t + h by the model, with the
inputs of that sample held; nothing of this is fed back. Before the first sample they are the initial state. Any step size works, and
any start time. A step that would pass the stop time, or take more than {most} samples, is refused.</p>
"#,
        most = MOST_SAMPLES
    );
    page.heading("missing", "Missing samples");
    page.text.push_str(r#"<p>NaN in an input that allows it means that this channel has no sample at this instant. An infinite value counts as missing too
and raises a bit of <code>status</code>. An input that allows it is missing until the host sets it, whatever start value the XML
must state. For a host without NaN, <code>missing_value</code> is the number that it sends instead; for one that sets every
input, <code>use.*</code> switches off the sensors that the machine does not have. Estimates never become NaN: what has no value
yet holds its start value and is flagged.</p>
"#);
    page.heading("state", "State");
    page.text.push_str(r#"<p>States can be copied, restored, written as bytes and read back, also in another process and before initialisation. Repeating the
same steps from a state repeats the results bit for bit.</p>
"#);
}

/// Which columns a list of variables has.
#[derive(Clone, Copy, PartialEq)]
enum Columns {
    Input,
    Output,
    Parameter,
}

impl Columns {
    fn titles(self) -> &'static [&'static str] {
        match self {
            Self::Input => &["Name", "Unit", "Start", "Meaning"],
            Self::Output => &["Name", "Standard deviation", "Unit", "Meaning"],
            Self::Parameter => &["Name", "Unit", "Start", "Allowed", "Change", "Meaning"],
        }
    }

    fn row(self, text: &mut String, variable: &Variable, has_std: bool) {
        let name = &variable.name;
        let _ = write!(text, "<tr><td>{name}</td>");
        if self == Self::Output {
            let std = if has_std { format!("{name}_std") } else { String::new() };
            let _ = write!(text, "<td>{std}</td>");
        }
        let _ = write!(text, "<td>{}</td>", escape(unit(variable)));
        if self != Self::Output {
            let _ = write!(text, "<td>{}</td>", escape(&start(variable)));
        }
        if self == Self::Parameter {
            let change = if variable.tunable { "tunable" } else { "fixed" };
            let _ = write!(text, "<td>{}</td><td>{change}</td>", escape(&range_text(variable)));
        }
        let _ = writeln!(text, "<td>{}</td></tr>", escape(&description(variable)));
    }
}

/// Tables of a list of variables. In a long list neighbours whose names begin alike are folded.
fn variables(page: &mut Page, list: &[Variable], separator: char, columns: Columns) {
    // an output and its standard deviation share a row
    let pairs = columns == Columns::Output;
    let shown: Vec<Variable> = list.iter().filter(|v| !(pairs && is_std(v, list))).cloned().collect();
    let has_std = |v: &Variable| pairs && list.iter().any(|other| other.name.strip_suffix("_std") == Some(&v.name));
    let table = |page: &mut Page, members: &[&Variable]| {
        page.table(columns.titles(), |text| members.iter().for_each(|v| columns.row(text, v, has_std(v))));
    };
    if shown.len() <= LONG {
        return table(page, &shown.iter().collect::<Vec<_>>());
    }
    let families = families(&shown, separator);
    let (single, folded): (Vec<_>, Vec<_>) = families.into_iter().partition(|family| family.members.len() == 1);
    let single: Vec<&Variable> = single.into_iter().flat_map(|family| family.members).collect();
    if !single.is_empty() {
        table(page, &single);
    }
    for family in folded {
        let _ = writeln!(page.text, "<details><summary><code>{}</code> {}</summary>", family.name, family.note());
        table(page, &family.members);
        page.text.push_str("</details>\n");
    }
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
