//! Collects what `pack` puts into an FMU by its model's name, so that no code here knows a machine:
//!
//! - `assets/pictures/<Model>.png`, the picture that tools show;
//! - the text of the documentation page: the pages of the estimator's module and of the modules it links to, and the
//!   lines about this machine in the sections "Measured" and "Limits" of `README.md`, as HTML.

use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

type Done<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Done<()> {
    let crate_folder = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("pictures.rs"), pictures(&crate_folder.join("assets/pictures"))?)?;
    std::fs::write(out.join("guides.rs"), guides(&crate_folder)?)?;
    Ok(())
}

/// The entries of a folder by name; Cargo runs this script again when one comes or goes.
fn entries(folder: &Path) -> Done<Vec<PathBuf>> {
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut paths = std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Done<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

fn read(file: &Path) -> Done<String> {
    println!("cargo::rerun-if-changed={}", file.display());
    Ok(std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?.replace('\r', ""))
}

fn stem(path: &Path) -> &str {
    path.file_stem().and_then(|name| name.to_str()).unwrap_or_default()
}

fn pictures(folder: &Path) -> Done<String> {
    let mut list = String::from("&[\n");
    for path in entries(folder)?.iter().filter(|path| path.extension().is_some_and(|ending| ending == "png")) {
        writeln!(list, "({:?}, include_bytes!({path:?})),", stem(path))?;
    }
    Ok(list + "]\n")
}

/// A list of `Guide` literals, one per folder of the estimators.
fn guides(crate_folder: &Path) -> Done<String> {
    let source = crate_folder.join("../src");
    let readme = read(&crate_folder.join("README.md"))?;
    let mut list = String::from("&[\n");
    for folder in entries(&source.join("estimator"))? {
        let module = folder.join("mod.rs");
        if !module.is_file() {
            continue;
        }
        let machine = stem(&folder);
        let page = module_page(&read(&module)?);
        let sections: Vec<_> = sections(&page).into_iter().map(|(title, text)| (title, to_html(&text, 3))).collect();
        let mut linked = Vec::new();
        for (path, file) in links(&page, &source) {
            let page = module_page(&read(&file)?);
            linked.push((format!("{path}: {}", first_sentence(&page)), to_html(&page, 3)));
        }
        let words = machine.replace('_', " ");
        let measured = table_rows(&readme, &words);
        let limits = limits(&readme, &words);
        writeln!(
            list,
            "Guide {{ machine: {machine:?}, sections: &{sections:?}, linked: &{linked:?}, measured: &{measured:?}, limits: &{limits:?} }},"
        )?;
    }
    Ok(list + "]\n")
}

/// The `//!` lines at the head of a source file.
fn module_page(source: &str) -> String {
    let lines = source.lines().map_while(|line| line.strip_prefix("//!"));
    lines.map(|line| line.strip_prefix(' ').unwrap_or(line)).collect::<Vec<_>>().join("\n")
}

/// What stands under each heading of the first level; what comes before the first one has no heading.
fn sections(page: &str) -> Vec<(String, String)> {
    let mut list = vec![(String::new(), String::new())];
    let mut in_code = false;
    for line in page.lines() {
        in_code ^= line.starts_with("```");
        match line.strip_prefix("# ").filter(|_| !in_code) {
            Some(title) => list.push((title.to_owned(), String::new())),
            None => {
                let text = &mut list.last_mut().expect("there is one").1;
                text.push_str(line);
                text.push('\n');
            }
        }
    }
    list
}

/// The modules that a page links to by `(crate::path)`, each once, with their files.
fn links(page: &str, source: &Path) -> Vec<(String, PathBuf)> {
    let mut found: Vec<(String, PathBuf)> = Vec::new();
    for rest in page.split("](crate::").skip(1) {
        let path = rest.split(')').next().unwrap_or_default();
        let place = source.join(path.replace("::", "/"));
        let file = [place.with_extension("rs"), place.join("mod.rs")].into_iter().find(|file| file.is_file());
        if let Some(file) = file
            && !found.iter().any(|(known, _)| known == path)
        {
            found.push((path.to_owned(), file));
        }
    }
    found
}

/// The first sentence as plain text.
fn first_sentence(page: &str) -> String {
    let paragraph = page.split("\n\n").next().unwrap_or_default().replace('\n', " ");
    let end = paragraph.find(". ").unwrap_or(paragraph.len());
    paragraph[..end].trim_end_matches([':', '.']).replace(['`', '*'], "")
}

/// Markdown as HTML, headings from level `top` on. Links into the code lead nowhere from a page inside an FMU and
/// become plain text.
fn to_html(markdown: &str, top: usize) -> String {
    const LEVELS: [HeadingLevel; 6] =
        [HeadingLevel::H1, HeadingLevel::H2, HeadingLevel::H3, HeadingLevel::H4, HeadingLevel::H5, HeadingLevel::H6];
    let down = |level: HeadingLevel| LEVELS[(level as usize + top - 2).min(5)];
    let unknown = |_: pulldown_cmark::BrokenLink<'_>| Some((CowStr::from("code"), CowStr::from("")));
    let parser = Parser::new_with_broken_link_callback(markdown, Options::ENABLE_TABLES, Some(unknown));
    let mut outside = Vec::new();
    let events = parser.filter_map(|event| match event {
        Event::Start(Tag::Link { ref dest_url, .. }) => {
            outside.push(dest_url.contains("://"));
            outside.last().is_some_and(|kept| *kept).then_some(event)
        }
        Event::End(TagEnd::Link) => outside.pop().is_some_and(|kept| kept).then_some(event),
        Event::Start(Tag::Heading { level, id, classes, attrs }) => {
            Some(Event::Start(Tag::Heading { level: down(level), id, classes, attrs }))
        }
        Event::End(TagEnd::Heading(level)) => Some(Event::End(TagEnd::Heading(down(level)))),
        event => Some(event),
    });
    let mut text = String::new();
    html::push_html(&mut text, events);
    // one that is wider than the page scrolls by itself
    text.replace("<table>", "<div class=\"wide\"><table>").replace("</table>", "</table></div>")
}

/// One line of Markdown as HTML.
fn line_to_html(markdown: &str) -> String {
    to_html(markdown, 3).trim().trim_start_matches("<p>").trim_end_matches("</p>").to_owned()
}

/// What a line says about this machine, or about every FMU.
fn about<'a>(line: &'a str, machine: &str) -> Option<&'a str> {
    let own = line.get(..machine.len()).filter(|start| start.eq_ignore_ascii_case(machine));
    let rest = own
        .map(|start| &line[start.len()..])
        .or_else(|| line.to_lowercase().starts_with("every fmu").then(|| &line[9..]));
    rest?.strip_prefix(": ")
}

/// A sentence from its beginning.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The lines of a section of the README.
fn section<'a>(readme: &'a str, title: &str) -> impl Iterator<Item = &'a str> {
    let heading = format!("## {title}");
    readme.lines().skip_while(move |line| *line != heading).skip(1).take_while(|line| !line.starts_with("## "))
}

/// The rows about this machine in the tables of "Measured": what, and the other cells behind the heads of their columns.
fn table_rows(readme: &str, machine: &str) -> Vec<[String; 2]> {
    let (mut rows, mut heads, mut last) = (Vec::new(), Vec::new(), Vec::new());
    for line in section(readme, "Measured") {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        if line.starts_with("|---") {
            heads = last;
        } else if let Some(what) = cells.first().and_then(|what| about(what, machine)) {
            let others = heads.iter().zip(&cells).skip(1).filter(|(_, cell)| !cell.is_empty());
            let others: Vec<_> = others
                .map(|(head, cell)| if *head == "measured" { (*cell).to_owned() } else { format!("{head}: {cell}") })
                .collect();
            rows.push([line_to_html(what), line_to_html(&others.join("; "))]);
        }
        last = cells;
    }
    rows
}

/// The items about this machine in "Limits".
fn limits(readme: &str, machine: &str) -> Vec<String> {
    let text = section(readme, "Limits").collect::<Vec<_>>().join("\n");
    let items = text.split("\n- ").map(|item| item.trim().trim_start_matches("- ").replace('\n', " "));
    items.filter_map(|item| about(&item, machine).map(|text| line_to_html(&capital(text)))).collect()
}
