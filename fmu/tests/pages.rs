//! The documentation pages of the FMUs, and that pages and guides speak of variables that exist.

use std::path::Path;
use wheelstate_fmu::describe::{guide, page};
use wheelstate_fmu::model::{Model, models};

fn all() -> Vec<Model> {
    models(&|_| true)
}

/// A file of the repository.
fn text(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The `//!` lines of a machine's module.
fn module_page(model: &Model) -> String {
    let source = text(&format!("src/estimator/{}/mod.rs", model.command_name().replace('-', "_")));
    source.lines().map_while(|line| line.strip_prefix("//!")).map(|line| format!("{line}\n")).collect()
}

/// What stands between backticks.
fn code(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Whether a word of prose is the name of a variable with a group, perhaps with `*` or with a value.
fn is_name(word: &str) -> bool {
    let name = word.split(" = ").next().unwrap_or_default();
    let plain = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_lowercase() || "_*".contains(c));
    const FILES: [&str; 10] = ["rs", "py", "md", "json", "toml", "csv", "sh", "html", "txt", "log"];
    name.contains('.')
        && name.split('.').all(plain)
        && !FILES.iter().any(|ending| name.ends_with(&format!(".{ending}")))
}

/// Whether a model has a variable of this name; `*` stands for anything.
fn exists(model: &Model, word: &str) -> bool {
    let name = word.split(" = ").next().unwrap_or_default();
    let lists = [&model.parameters, &model.inputs, &model.outputs];
    let mut names = lists.into_iter().flatten().map(|variable| variable.name.as_str());
    match name.split_once('*') {
        Some((head, tail)) => names.any(|known| known.starts_with(head) && known.ends_with(tail)),
        None => names.any(|known| known == name || known.starts_with(&format!("{name}."))),
    }
}

#[test]
fn every_machines_page_has_the_same_headings_in_the_same_order() {
    for model in all() {
        let guide = guide::of(&model).unwrap_or_else(|| panic!("{} has no page", model.name));
        let headings: Vec<_> =
            guide.sections.iter().map(|(title, _)| *title).filter(|title| !title.is_empty()).collect();
        let wanted = ["Model", "What cannot be observed", "Noise and defaults", "How to tune", "Sources and errata"];
        assert_eq!(headings, wanted, "{}", model.name);
        assert!(
            guide.linked.iter().any(|(_, text)| text.contains("<pre>") || text.contains("<table>")),
            "{}",
            model.name
        );
        assert!(guide.measured.len() >= 3 && guide.limits.len() >= 3, "{}: {guide:?}", model.name);
    }
}

#[test]
fn pages_and_guides_name_only_variables_that_there_are() {
    for model in all() {
        for word in code(&module_page(&model)).filter(|word| is_name(word)) {
            assert!(exists(&model, word), "the page of {} speaks of {word}", model.name);
        }
    }
    for guide in ["README.md", "fmu/README.md", "identify/README.md"] {
        let text = text(guide);
        let prose: String = text.split("```").step_by(2).collect();
        for word in code(&prose).filter(|word| is_name(word)) {
            assert!(all().iter().any(|model| exists(model, word)), "{guide} speaks of {word}");
        }
    }
}

#[test]
fn the_guide_says_to_set_first_what_the_declarations_call_essential() {
    let guide = text("fmu/README.md");
    for model in all() {
        let row = guide.lines().find(|line| line.starts_with(&format!("| `{}` |", model.name))).unwrap();
        let named: Vec<_> = code(row.split(" | ").nth(1).unwrap()).collect();
        let essential = model.parameters.iter().filter(|variable| variable.essential);
        let essential: Vec<_> = essential.map(|variable| variable.name.as_str()).collect();
        assert_eq!(essential[0], "sample_period");
        assert_eq!(named, essential[1..], "{}", model.name);
        assert!((8..=12).contains(&essential.len()), "{}: {}", model.name, essential.len());
    }
}

#[test]
fn a_page_is_well_formed_shows_all_and_needs_nothing_from_outside() {
    for model in all() {
        let html = page::html(&model);
        let document = html.strip_prefix("<!DOCTYPE html>\n").unwrap();
        let document = roxmltree::Document::parse(document).unwrap_or_else(|error| panic!("{}: {error}", model.name));
        let ids: Vec<_> = document.descendants().filter_map(|node| node.attribute("id")).collect();
        for node in document.descendants() {
            let name = node.tag_name().name();
            assert!(!["script", "link", "iframe"].contains(&name) && node.attribute("src").is_none(), "{name}");
            if let Some(place) = node.attribute("href").and_then(|target| target.strip_prefix('#')) {
                assert!(ids.contains(&place), "{}: nothing is called {place}", model.name);
            }
        }
        let cells: Vec<_> =
            document.descendants().filter(|node| node.has_tag_name("td")).filter_map(|node| node.text()).collect();
        for variable in [&model.inputs, &model.outputs, &model.parameters].into_iter().flatten() {
            assert!(cells.contains(&variable.name.as_str()), "{}: {}", model.name, variable.name);
        }
        assert!(
            html.contains("prefers-color-scheme:dark") && document.descendants().any(|node| node.has_tag_name("svg"))
        );
        assert!(!html.contains("](") && !html.contains("<p>#"), "{}: Markdown is left", model.name);
    }
}

#[test]
fn a_model_from_elsewhere_has_a_page_without_a_guide() {
    let mut model = all().remove(0);
    model.name = "Elsewhere";
    let html = page::html(&model);
    assert!(guide::of(&model).is_none());
    assert!(html.contains("Bits of status") && !html.contains("How to tune"));
}
