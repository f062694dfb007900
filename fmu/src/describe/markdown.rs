//! The list of all variables in Markdown, as kept in `fmu/VARIABLES.md`.

use super::page::{start, unit};
use crate::model::{Model, range_text};
use std::fmt::Write as _;
use wheelstate::{Status, Variable};

/// Inputs, outputs and parameters of the models, and the bits of `status`.
pub fn variables(models: &[Model]) -> String {
    let mut text = String::from(
        "# Variables of the FMUs\n\n\
         Written from the declarations in `src/estimator`; `cargo test -p wheelstate-fmu variables` holds the two\n\
         together and rewrites this file when WHEELSTATE_UPDATE is set. NaN in an input marked *measured*\n\
         means \"no sample\", in one marked *held* that its last value holds; both begin as never set.\n",
    );
    for model in models {
        let _ = write!(text, "\n## {}\n\n{}.\n", model.name, model.description.trim_end_matches('.'));
        section(&mut text, "Inputs", &model.inputs, input);
        section(&mut text, "Outputs", &model.outputs, |_| String::new());
        section(&mut text, "Parameters", &model.parameters, |v| {
            let change = if v.tunable { ", tunable" } else { "" };
            format!("{} ({}{change})", start(v), range_text(v))
        });
    }
    text.push_str("\n## Bits of status\n\n| value | word | meaning |\n|---|---|---|\n");
    for (bit, word, meaning) in Status::ALL {
        let _ = writeln!(text, "| {} | {word} | {} |", 1_u32 << bit, meaning.trim());
    }
    text
}

fn input(variable: &Variable) -> String {
    match (variable.measured, variable.held) {
        (true, _) => "measured".to_owned(),
        (_, true) => "held".to_owned(),
        _ => start(variable),
    }
}

fn section(text: &mut String, title: &str, list: &[Variable], note: impl Fn(&Variable) -> String) {
    let notes: Vec<_> = list.iter().map(note).collect();
    let noted = notes.iter().any(|note| !note.is_empty());
    let (head, rule) = if noted { ("| start |", "|---|") } else { ("|", "|") };
    let _ = write!(text, "\n### {title}\n\n| name | unit {head} meaning |\n|---|---{rule}---|\n");
    for (variable, note) in list.iter().zip(notes) {
        let note = if noted { format!(" {note} |") } else { String::new() };
        let meaning = variable.description.replace('|', "\\|");
        let _ = writeln!(text, "| `{}` | {} |{note} {meaning} |", variable.name, unit(variable));
    }
}
