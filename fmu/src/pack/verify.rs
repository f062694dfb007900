//! `pack verify`: runs the reference experiment of an FMU with its library, as a host would.

use super::PackError;
use super::library::own_folders;
use super::reference::{EXPERIMENTS, FOLDER};
use crate::abi::Imported;
use crate::model::Type;
use roxmltree::{Document, Node};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// How an FMU did.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Largest deviation from the reference, relative to the larger of 1 and the value.
    pub deviation: f64,
    /// The output with that deviation.
    pub worst: String,
    /// What the experiment allows.
    pub tolerance: f64,
    /// Steps that were taken.
    pub steps: usize,
}

impl Verdict {
    /// Whether the FMU is as it was packed.
    pub fn is_good(&self) -> bool {
        self.deviation <= self.tolerance
    }
}

/// A folder that goes away with its content.
struct Unpacked(PathBuf);

impl Drop for Unpacked {
    fn drop(&mut self) {
        // what cannot be removed is the system's to clean up
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Unpacks an FMU, loads the library of this platform and runs the experiment.
pub fn run(fmu: &Path) -> Result<Verdict, PackError> {
    let refuse = |why: String| PackError(format!("{}: {why}", fmu.display()));
    let folder = unpack(fmu).map_err(&refuse)?;
    experiment(&folder.0).map_err(&refuse)
}

fn unpack(fmu: &Path) -> Result<Unpacked, String> {
    let file = std::fs::File::open(fmu).map_err(|error| error.to_string())?;
    let mut archive = ZipArchive::new(file).map_err(|error| format!("it is not a zip archive: {error}"))?;
    let stem = fmu.file_stem().unwrap_or_default().to_string_lossy();
    let folder = std::env::temp_dir().join(format!("wheelstate-verify-{}-{stem}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let unpacked = Unpacked(folder);
    archive.extract(&unpacked.0).map_err(|error| format!("it cannot be unpacked: {error}"))?;
    Ok(unpacked)
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Result<&'a str, String> {
    node.attribute(name).ok_or_else(|| format!("{} has no attribute {name}", node.tag_name().name()))
}

fn experiment(folder: &Path) -> Result<Verdict, String> {
    let description = read(&folder.join("modelDescription.xml"))?;
    let description = Document::parse(&description).map_err(|error| format!("modelDescription.xml: {error}"))?;
    let root = description.root_element();
    let element =
        |node: Node<'_, '_>, name: &str| node.children().find(|child| child.has_tag_name(name)).map(|n| n.id());
    let slave =
        element(root, "CoSimulation").and_then(|id| description.get_node(id)).ok_or("it is for no co-simulation")?;
    let identifier = attribute(slave, "modelIdentifier")?;
    let guid = attribute(root, "guid")?;

    let base = folder.join(FOLDER);
    let text = read(&base.join(EXPERIMENTS))?;
    let document = Document::parse(&text).map_err(|error| format!("{EXPERIMENTS}: {error}"))?;
    let tag = |name: &'static str| {
        document
            .descendants()
            .find(|node| node.has_tag_name(name))
            .ok_or_else(|| format!("{EXPERIMENTS} has no {name}"))
    };
    let plan = tag("Experiment")?;
    let value = |name: &str| {
        let text = attribute(plan, name)?;
        text.parse::<f64>().map_err(|_| format!("{EXPERIMENTS}: {name} = '{text}' is not a number"))
    };
    let (start, stop, size, tolerance) =
        (value("startTime")?, value("stopTime")?, value("stepSize")?, value("tolerance")?);
    let table = |name| Table::read(&base.join(attribute(tag(name)?, "source")?));
    let (stimuli, expected) = (table("Stimuli")?, table("References")?);

    let mut library = None;
    for (name, ending) in own_folders() {
        let path = folder.join("binaries").join(name).join(format!("{identifier}{ending}"));
        library = library.or(path.is_file().then_some(path));
    }
    let library = library.ok_or("it has no library for this platform")?;
    let resources = format!("file://{}", folder.join("resources").display());
    let instance = Imported::new(&library, guid, &resources)?;
    let variables = |names: &[String]| names.iter().map(|name| variable(root, name)).collect::<Result<Vec<_>, _>>();
    let inputs = variables(&stimuli.names)?;
    let outputs = variables(&expected.names)?;
    let reals: Vec<_> = (0..inputs.len()).filter(|i| inputs[*i].0 == Type::Real).collect();
    let references: Vec<_> = reals.iter().map(|i| inputs[*i].1).collect();
    let set = |row: usize| {
        let row = stimuli.rows.get(row).or(stimuli.rows.last()).ok_or("there are no inputs")?;
        instance.set(&references, &reals.iter().map(|i| row[*i]).collect::<Vec<_>>())
    };
    instance.start(start, stop)?;
    set(0)?;
    instance.call("fmi2ExitInitializationMode")?;
    let mut verdict = Verdict { deviation: 0.0, worst: String::new(), tolerance, steps: expected.rows.len() - 1 };
    for (k, row) in expected.rows.iter().enumerate() {
        if k > 0 {
            set(k - 1)?;
            instance.step(start + (k - 1) as f64 * size, size)?;
        }
        for ((name, (class, reference)), wanted) in expected.names.iter().zip(&outputs).zip(row) {
            let got = instance.get(*class, *reference)?;
            let deviation = (got - wanted).abs() / wanted.abs().max(1.0);
            // what is no number deviates, too
            if deviation.is_nan() || deviation > verdict.deviation {
                (verdict.deviation, verdict.worst) = (deviation, name.clone());
            }
        }
    }
    instance.call("fmi2Terminate")?;
    Ok(verdict)
}

/// Type and value reference of a variable.
fn variable(root: Node<'_, '_>, name: &str) -> Result<(Type, u32), String> {
    let mut variables = root.descendants().filter(|node| node.has_tag_name("ScalarVariable"));
    let node = variables.find(|node| node.attribute("name") == Some(name));
    let node = node.ok_or_else(|| format!("modelDescription.xml has no variable {name}"))?;
    let kinds = node.children().find_map(|child| match child.tag_name().name() {
        "Real" => Some(Type::Real),
        "Integer" | "Enumeration" => Some(Type::Integer),
        "Boolean" => Some(Type::Boolean),
        _ => None,
    });
    let reference = attribute(node, "valueReference")?.parse().map_err(|_| format!("{name}: valueReference"))?;
    Ok((kinds.ok_or_else(|| format!("{name} has no type"))?, reference))
}

/// A table of numbers; the first column is the time and is left out.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path) -> Result<Self, String> {
        let text = read(path)?;
        let mut lines = text.lines();
        let names: Vec<_> = lines.next().unwrap_or_default().split(',').skip(1).map(str::to_owned).collect();
        let mut rows = Vec::new();
        for (number, line) in lines.enumerate() {
            let row: Result<Vec<f64>, _> = line.split(',').skip(1).map(str::parse).collect();
            let row = row.ok().filter(|row| row.len() == names.len());
            rows.push(row.ok_or_else(|| format!("{}: line {} is not a row of numbers", path.display(), number + 2))?);
        }
        if rows.is_empty() { Err(format!("{} is empty", path.display())) } else { Ok(Self { names, rows }) }
    }
}
