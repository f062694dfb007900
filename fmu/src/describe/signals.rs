//! The picture of a model's signals, drawn from the declaration: inputs on the left, outputs on the right.

use super::page::unit;
use crate::model::Model;
use std::fmt::Write as _;
use wheelstate::Variable;
use wheelstate::parameter_set::escape;

/// Lists longer than this are drawn by families.
const MOST_LINES: usize = 30;
/// Height of a line, width of a half with its names, and of the block between the halves, px.
const LINE: usize = 22;
const HALF: usize = 330;
const BLOCK: usize = 200;

/// Neighbours in a list whose names begin alike: `q_*` stands for `q_neck_x`, `q_neck_y` and so on.
pub struct Family<'a> {
    /// What the names have in common, with `*` for the rest; the name itself if there is but one.
    pub name: String,
    /// The members.
    pub members: Vec<&'a Variable>,
}

impl Family<'_> {
    /// Its unit, with the number of its members if there are several.
    pub fn note(&self) -> String {
        let first = unit(self.members[0]);
        match self.members.len() {
            1 => first.to_owned(),
            count if self.members.iter().all(|member| unit(member) == first) => format!("{count} × {first}"),
            count => format!("{count} variables"),
        }
    }
}

/// A list in families of neighbours with the same first word, a standard deviation in that of its estimate.
pub fn families(list: &[Variable], separator: char) -> Vec<Family<'_>> {
    let first = |name: &str| name.split(separator).next().unwrap_or_default().to_owned();
    let mut families: Vec<Family<'_>> = Vec::new();
    for variable in list {
        match families.last_mut() {
            Some(family) if first(&family.members[0].name) == first(&variable.name) => family.members.push(variable),
            _ => families.push(Family { name: String::new(), members: vec![variable] }),
        }
    }
    for family in &mut families {
        family.name = common_name(&family.members, separator);
    }
    families
}

fn common_name(members: &[&Variable], separator: char) -> String {
    let [only] = members else {
        let words: Vec<Vec<&str>> = members.iter().map(|v| v.name.split(separator).collect()).collect();
        let same = |i: &usize| words.iter().all(|other| other.len() > i + 1 && other[*i] == words[0][*i]);
        let common = (0..words[0].len()).take_while(same).count();
        // one member's name may be the beginning of the others'
        let (common, between) = if common == 0 { (1, "") } else { (common, &*separator.to_string()) };
        return words[0][..common].join(&separator.to_string()) + between + "*";
    };
    only.name.clone()
}

/// A line of the picture: name, and unit or number of members.
fn lines(list: &[Variable]) -> Vec<(String, String)> {
    let signals: Vec<Variable> = list.iter().filter(|v| !is_std(v, list)).cloned().collect();
    if signals.len() <= MOST_LINES {
        return signals.iter().map(|v| (v.name.clone(), unit(v).to_owned())).collect();
    }
    families(&signals, '_').iter().map(|family| (family.name.clone(), family.note())).collect()
}

/// Whether a variable is the standard deviation of another one in the list, which stands for both.
pub fn is_std(variable: &Variable, list: &[Variable]) -> bool {
    variable.name.strip_suffix("_std").is_some_and(|name| list.iter().any(|other| other.name == name))
}

/// The picture as SVG, in the colours of the text around it.
pub fn svg(model: &Model) -> String {
    let (inputs, outputs) = (lines(&model.inputs), lines(&model.outputs));
    let rows = inputs.len().max(outputs.len());
    let (width, height) = (2 * HALF + BLOCK, (rows + 1) * LINE + 8);
    let mut svg = format!(
        r#"<svg viewBox="0 0 {width} {height}" role="img" aria-label="Signals of {name}"><rect x="{HALF}" y="2" width="{BLOCK}" height="{block}" rx="8" class="block"/><text x="{middle}" y="{centre}" text-anchor="middle" class="title">{name}</text>"#,
        name = model.name,
        block = height - 4,
        middle = width / 2,
        centre = height / 2 + 6,
    );
    let mut side = |lines: &[(String, String)], input: bool| {
        // the shorter list stands in the middle
        let top = (rows - lines.len()) * LINE / 2;
        for (i, (name, note)) in lines.iter().enumerate() {
            let y = top + (i + 1) * LINE;
            let (line, text, anchor) = match input {
                true => ((HALF - 26, HALF), HALF - 34, "end"),
                false => ((HALF + BLOCK, HALF + BLOCK + 26), HALF + BLOCK + 34, "start"),
            };
            let _ = write!(
                svg,
                r#"<path d="M{from} {y}H{to}m-6 -4l6 4l-6 4" class="arrow"/><text x="{text}" y="{base}" text-anchor="{anchor}">{name} <tspan class="unit">{note}</tspan></text>"#,
                from = line.0,
                to = line.1,
                base = y + 5,
                name = escape(name),
                note = escape(if note == "1" { "" } else { note }),
            );
        }
    };
    side(&inputs, true);
    side(&outputs, false);
    svg + "</svg>"
}
