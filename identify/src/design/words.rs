//! A plan as a table for people.

use super::{Candidate, Plan, Promise};
use crate::check::short;
use std::collections::BTreeSet;

/// The table: one column per candidate, the best first, one row per setting and parameter; then the best one driven more
/// often, and what there is to know.
pub fn table(plan: &Plan) -> String {
    let candidates = &plan.candidates;
    let row = |head: &str, now: &str, of: &dyn Fn(&Candidate) -> String| {
        [head.to_owned(), now.to_owned()].into_iter().chain(candidates.iter().map(of)).collect::<Vec<_>>()
    };
    let mut rows = vec![row("", "now", &|c| c.scenario.clone())];
    rows.push(row("duration [s]", "", &|c| short(c.duration)));
    for name in candidates.iter().flat_map(|c| c.settings.keys()).collect::<BTreeSet<_>>() {
        rows.push(row(name, "", &|c| c.settings.get(name).map_or("-".to_owned(), |value| short(*value))));
    }
    for (index, parameter) in plan.parameters.iter().enumerate() {
        let now = parameter.std_error.map_or("unknown".to_owned(), short);
        rows.push(row(&head(plan, index), &now, &|c| words(&c.promises[index])));
    }
    let percent = 100.0 * plan.probability;
    let mut text =
        format!("standard errors now, and of a fit with one drive more: median (range of {percent:.0} % of drives)\n");
    text += &columns(&rows);
    text.push('\n');
    let Some(best) = candidates.first().filter(|_| plan.helps) else {
        text += "no manoeuvre makes these standard errors noticeably smaller\n";
        return text + &notes(plan);
    };
    text += &format!("drive next: {}\n", named(best));
    if !plan.repeats.is_empty() {
        let times = |n: usize| if n == 1 { "once".to_owned() } else { format!("{n} times") };
        let mut rows = vec![vec![String::new(), times(1)], vec!["duration [s]".to_owned(), short(best.duration)]];
        rows[0].extend(plan.repeats.iter().map(|repeat| times(repeat.times)));
        rows[1].extend(plan.repeats.iter().map(|repeat| short(repeat.duration)));
        for index in 0..plan.parameters.len() {
            let mut row = vec![head(plan, index), words(&best.promises[index])];
            row.extend(plan.repeats.iter().map(|repeat| words(&repeat.promises[index])));
            rows.push(row);
        }
        text += &columns(&rows);
    }
    text + &notes(plan)
}

fn notes(plan: &Plan) -> String {
    plan.notes.iter().map(|note| format!("note: {note}\n")).collect()
}

fn head(plan: &Plan, index: usize) -> String {
    let parameter = &plan.parameters[index];
    if parameter.unit == "1" { parameter.name.clone() } else { format!("{} [{}]", parameter.name, parameter.unit) }
}

fn words(promise: &Option<Promise>) -> String {
    let Some(p) = promise else { return "unknown".to_owned() };
    let doubt = if p.identified < 0.5 { "?" } else { "" };
    format!("{}{doubt} ({}..{})", short(p.std_error), short(p.low), short(p.high))
}

fn columns(rows: &[Vec<String>]) -> String {
    let widths: Vec<usize> =
        (0..rows[0].len()).map(|column| rows.iter().map(|row| row[column].len()).max().unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        text += &format!("{:<first$}", row[0], first = widths[0]);
        row.iter().zip(&widths).skip(1).for_each(|(cell, width)| text += &format!("  {cell:>width$}"));
        text.push('\n');
    }
    text
}

fn named(candidate: &Candidate) -> String {
    let each = candidate.settings.iter().map(|(name, value)| format!("{name}={}", short(*value)));
    let settings: Vec<String> = each.collect();
    let with = if settings.is_empty() { String::new() } else { format!(" with {}", settings.join(" ")) };
    format!("{}{with}, {} s", candidate.scenario, short(candidate.duration))
}
