//! The walls between crates and modules: every path in every source file goes along an arrow of the one list, or the
//! test names file and line.
#![allow(missing_docs)]

mod arrows;
mod source;

use arrows::{CONFINED, CRATES, Crate, UNSAFE};
use source::{Path, paths, tokens};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The Rust files below a place, as text paths from the workspace's root.
fn files(place: &str) -> Vec<String> {
    let full = root().join(place);
    if full.is_file() {
        return vec![place.to_owned()];
    }
    let entries = std::fs::read_dir(&full).unwrap_or_else(|e| panic!("{place}: {e}"));
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let below = names.into_iter().map(|name| format!("{place}/{name}"));
    below.filter(|path| path.ends_with(".rs") || root().join(path).is_dir()).flat_map(|path| files(&path)).collect()
}

/// A source file with its tokens and its module, the crate in front.
struct Source {
    file: String,
    module: Vec<String>,
    tokens: Vec<source::Token>,
}

fn sources(of: &Crate) -> Vec<Source> {
    let own = files(of.source);
    let own = own
        .into_iter()
        .filter(|file| of.except.iter().all(|except| !file.starts_with(&format!("{}/{except}", of.source))));
    own.map(|file| {
        let inner = file.strip_prefix(of.source).unwrap().trim_matches('/').trim_end_matches(".rs");
        let names = inner.split('/').filter(|name| !matches!(*name, "" | "lib" | "main" | "mod"));
        let module = std::iter::once(of.name).chain(names).map(str::to_owned).collect();
        let text = std::fs::read_to_string(root().join(&file)).unwrap();
        Source { file, module, tokens: tokens(&text) }
    })
    .collect()
}

/// Names at the root of a crate that are no modules of it: re-exports and macros, with the path they stand for.
fn names(sources: &[Source], crates: &[&str]) -> BTreeMap<String, Vec<String>> {
    let mut names = BTreeMap::new();
    for source in sources {
        if source.module.len() == 1 {
            let exported = paths(&source.tokens, &source.module, crates).into_iter().filter(|path| path.public);
            names.extend(
                exported.map(|Path { segments, name, .. }| (format!("{}::{name}", source.module[0]), segments)),
            );
        }
        for window in source.tokens.windows(3) {
            if window[0].text == "macro_rules" {
                names.insert(format!("{}::{}", source.module[0], window[2].text), source.module.clone());
            }
        }
    }
    names
}

/// Everything that the tests look at.
struct Walls {
    sources: Vec<Source>,
    names: BTreeMap<String, Vec<String>>,
    /// The listed modules by their full names, with what each may use.
    arrows: BTreeMap<String, Vec<String>>,
}

impl Walls {
    fn new() -> Self {
        let crates: Vec<&str> = CRATES.iter().map(|one| one.name).collect();
        let (mut all, mut names_of_all, mut arrows) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
        for one in CRATES {
            let own = sources(one);
            names_of_all.append(&mut names(&own, &crates));
            all.extend(own);
            for (module, may_use) in one.modules {
                let may_use: Vec<String> = may_use.iter().map(|module| full(one.name, module)).collect();
                arrows.extend(expanded(one, module).into_iter().map(|module| (module, may_use.clone())));
            }
        }
        Self { sources: all, names: names_of_all, arrows }
    }

    /// The longest listed module that a path leads into; the bare crate if none is.
    fn node(&self, segments: &[String]) -> String {
        let mut segments = segments.to_vec();
        // A name of the root stands for what it re-exports.
        while segments.len() > 1
            && let Some(path) = self.names.get(&segments[..2].join("::"))
            && path[..] != segments[..2]
        {
            segments = path.iter().cloned().chain(segments[2..].iter().cloned()).collect();
        }
        let path = segments.join("::");
        let listed = self.arrows.keys().filter(|module| leads_into(&path, module));
        listed.max_by_key(|module| module.len()).unwrap_or(&segments[0]).clone()
    }
}

/// The full names of a module of the list: several if it stands for the folders of a folder.
fn expanded(of: &Crate, module: &str) -> Vec<String> {
    let Some(outer) = module.strip_suffix("::*") else { return vec![full(of.name, module)] };
    let folder = root().join(of.source).join(outer.replace("::", "/"));
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let folders = entries.filter(|entry| entry.path().is_dir());
    folders.map(|entry| full(of.name, &format!("{outer}::{}", entry.file_name().display()))).collect()
}

/// A module as it stands in the list, with the crate's name in front if it is of this crate.
fn full(of: &str, module: &str) -> String {
    let foreign = CRATES.iter().any(|one| one.name != of && leads_into(module, one.name));
    match (module, foreign) {
        ("", _) => of.to_owned(),
        (_, true) => module.to_owned(),
        (_, false) => format!("{of}::{module}"),
    }
}

/// Whether a path is this module or something in it.
fn leads_into(path: &str, module: &str) -> bool {
    path.strip_prefix(module).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
}

#[test]
fn every_import_goes_along_an_arrow_of_the_list() {
    let crates: Vec<&str> = CRATES.iter().map(|one| one.name).collect();
    let walls = Walls::new();
    let mut broken = Vec::new();
    for Source { file, module, tokens } in &walls.sources {
        let from = walls.node(module);
        let Some(may_use) = walls.arrows.get(&from) else {
            // The root of a crate names its own modules; any other module must be listed.
            if module.len() > 1 {
                broken.push(format!("{file}: {from} is not in the list of modules"));
            }
            continue;
        };
        for path in paths(tokens, module, &crates) {
            let to = walls.node(&path.segments);
            // Another crate may be allowed as a whole.
            let allows = |one: &String| *one == to || (*one != module[0] && leads_into(&to, one));
            if to != from && !may_use.iter().any(allows) {
                broken.push(format!("{file}:{}: {from} -> {to} is not an arrow of tests/walls/arrows.rs", path.line));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn the_list_of_arrows_has_no_circle() {
    let mut arrows = Walls::new().arrows;
    // The root of a crate holds its modules together, and what it defines itself stands below them.
    for may_use in arrows.values_mut() {
        may_use.retain(|to| CRATES.iter().all(|one| one.name != to));
    }
    // Takes away what uses nothing that is left, until nothing is left.
    while !arrows.is_empty() {
        let left: Vec<String> = arrows.keys().cloned().collect();
        let waits = |to: &String| left.contains(to);
        let before = arrows.len();
        arrows.retain(|_, to| to.iter().any(waits));
        assert!(arrows.len() < before, "these are part of a circle or use one: {arrows:#?}");
    }
}

#[test]
fn crates_from_outside_stay_where_they_belong() {
    let walls = Walls::new();
    for Source { file, module, tokens } in &walls.sources {
        let from = walls.node(module);
        for window in tokens.windows(2).filter(|window| window[1].text == "::") {
            let confined = CONFINED.iter().find(|(name, _)| *name == window[0].text);
            let Some((name, homes)) = confined else { continue };
            // `self::csv`, `crate::csv` and the like are modules of that name.
            let own = module.len() == 1 || homes.iter().any(|home| leads_into(&from, home));
            assert!(own, "{file}:{}: {from} names {name}, which belongs to {}", window[0].line, homes.join(", "));
        }
    }
}

#[test]
fn unsafe_code_stands_at_the_c_boundaries_only() {
    let sources = Walls::new().sources;
    let uses = |source: &&Source| source.tokens.iter().find(|token| token.text == "unsafe").map(|token| token.line);
    for source in sources.iter().filter(|source| !UNSAFE.iter().any(|place| source.file.starts_with(place))) {
        assert_eq!(uses(&source), None, "{}: unsafe code belongs in {}", source.file, UNSAFE.join(" or "));
    }
    for place in UNSAFE {
        let any = sources.iter().filter(|source| source.file.starts_with(place)).any(|source| uses(&source).is_some());
        assert!(any, "{place} has no unsafe code any more");
    }
}
