//! The paths of a Rust source file as text: comments and strings out, `use` trees and inline paths in.

/// A path of a file with its line, resolved to start with the name of a crate.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Crate and modules.
    pub segments: Vec<String>,
    /// The name it gets here: its last segment, or the one behind `as`.
    pub name: String,
    /// Line of its first segment.
    pub line: usize,
    /// Whether it is re-exported by `pub use`.
    pub public: bool,
}

/// A word or a sign with its line.
#[derive(Clone, Debug, PartialEq)]
pub struct Token {
    /// Its text: an identifier, `::`, or one character.
    pub text: String,
    /// Its line, from 1.
    pub line: usize,
}

/// The tokens of a source text without comments, strings, characters and lifetimes.
pub fn tokens(text: &str) -> Vec<Token> {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut tokens = Vec::new();
    let (mut i, mut line) = (0, 1);
    // Steps over one character and counts lines.
    let step = |i: &mut usize, line: &mut usize| {
        *line += usize::from(at(*i) == '\n');
        *i += 1;
    };
    while i < chars.len() {
        let (c, next) = (at(i), at(i + 1));
        if c == '/' && next == '/' {
            while i < chars.len() && at(i) != '\n' {
                i += 1;
            }
        } else if c == '/' && next == '*' {
            let mut depth = 0;
            loop {
                match (at(i), at(i + 1)) {
                    ('/', '*') => depth += 1,
                    ('*', '/') => depth -= 1,
                    _ => {}
                }
                let pair = matches!((at(i), at(i + 1)), ('/', '*') | ('*', '/'));
                step(&mut i, &mut line);
                if pair {
                    step(&mut i, &mut line);
                }
                if depth == 0 || i >= chars.len() {
                    break;
                }
            }
        } else if c == '"' {
            step(&mut i, &mut line);
            while i < chars.len() && at(i) != '"' {
                let escape = at(i) == '\\';
                step(&mut i, &mut line);
                if escape {
                    step(&mut i, &mut line);
                }
            }
            i += 1;
        } else if c == 'r' && (next == '"' || (next == '#' && matches!(at(i + 2), '#' | '"'))) {
            let mut hashes = 0;
            i += 1;
            while at(i) == '#' {
                (hashes, i) = (hashes + 1, i + 1);
            }
            step(&mut i, &mut line);
            while i < chars.len() && !(at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#')) {
                step(&mut i, &mut line);
            }
            i += 1 + hashes;
        } else if c == '\'' {
            // A character is closed by a quote, a lifetime is not.
            if next == '\\' {
                i += 3;
                while i < chars.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            } else if at(i + 2) == '\'' {
                i += 3;
            } else {
                i += 1;
                while is_word(at(i)) {
                    i += 1;
                }
            }
        } else if is_word(c) {
            let mut word = String::new();
            while is_word(at(i)) {
                word.push(at(i));
                i += 1;
            }
            tokens.push(Token { text: word, line });
        } else if c == ':' && next == ':' {
            tokens.push(Token { text: "::".to_owned(), line });
            i += 2;
        } else {
            if !c.is_whitespace() {
                tokens.push(Token { text: c.to_string(), line });
            }
            step(&mut i, &mut line);
        }
    }
    tokens
}

/// All paths of a file that begin with `crate`, `super` or one of these crates; `module` is the file's module with
/// its crate in front.
pub fn paths(tokens: &[Token], module: &[String], crates: &[&str]) -> Vec<Path> {
    let text = |i: usize| tokens.get(i).map_or("", |token| token.text.as_str());
    let before = |i: usize| i.checked_sub(1).map_or("", text);
    let mut paths = Vec::new();
    // The modules around the place, each with the depth of braces at which it ends.
    let mut around: Vec<(String, usize)> = Vec::new();
    let mut depth = 0;
    let mut i = 0;
    while i < tokens.len() {
        let here =
            || -> Vec<String> { module.iter().cloned().chain(around.iter().map(|(name, _)| name.clone())).collect() };
        match text(i) {
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                around.retain(|(_, end)| *end <= depth);
            }
            "mod" if text(i + 2) == "{" => {
                around.push((text(i + 1).to_owned(), depth + 1));
                depth += 1;
                i += 2;
            }
            // Not what a returned `impl` captures, nor a name that is written `r#use`.
            "use" if text(i + 1) != "<" && before(i) != "#" => {
                let public = before(i) == "pub";
                let start = i + 1;
                while text(i) != ";" && i < tokens.len() {
                    i += 1;
                }
                let mut tree = Tree { tokens: &tokens[start..i], at: 0, leaves: Vec::new() };
                tree.branch(&[]);
                for (segments, name, line) in tree.leaves {
                    // A name of its own crate's root may stand without `crate` there.
                    let segments = if module.len() == 1 && around.is_empty() && public {
                        resolved(&segments, &here(), crates).or_else(|| {
                            let own = std::iter::once(module[0].clone()).chain(segments.iter().cloned());
                            Some(own.collect())
                        })
                    } else {
                        resolved(&segments, &here(), crates)
                    };
                    paths.extend(segments.map(|segments| Path { segments, name, line, public }));
                }
            }
            first if text(i + 1) == "::" && before(i) != "::" && !first.is_empty() => {
                let line = tokens[i].line;
                let mut segments = vec![first.to_owned()];
                while text(i + 1) == "::" && text(i + 2).starts_with(|c: char| c.is_alphabetic() || c == '_') {
                    segments.push(text(i + 2).to_owned());
                    i += 2;
                }
                let name = segments.last().cloned().unwrap_or_default();
                let segments = resolved(&segments, &here(), crates);
                paths.extend(segments.map(|segments| Path { segments, name, line, public: false }));
            }
            _ => {}
        }
        i += 1;
    }
    paths
}

/// Makes `crate`, `self` and `super` absolute; nothing for paths into other crates than these.
fn resolved(segments: &[String], here: &[String], crates: &[&str]) -> Option<Vec<String>> {
    let (first, rest) = segments.split_first()?;
    match first.as_str() {
        "crate" => Some(here[..1].iter().chain(rest).cloned().collect()),
        "self" => Some(here.iter().chain(rest).cloned().collect()),
        "super" => {
            let ups = segments.iter().take_while(|segment| *segment == "super").count();
            let kept = here.len().saturating_sub(ups).max(1);
            Some(here[..kept].iter().chain(&segments[ups..]).cloned().collect())
        }
        name if crates.contains(&name) => Some(segments.to_vec()),
        _ => None,
    }
}

/// A `use` tree on its way to its leaves: the whole path, the name it gets, the line.
struct Tree<'a> {
    tokens: &'a [Token],
    at: usize,
    leaves: Vec<(Vec<String>, String, usize)>,
}

impl Tree<'_> {
    fn text(&self) -> &str {
        self.tokens.get(self.at).map_or("", |token| token.text.as_str())
    }

    fn branch(&mut self, prefix: &[String]) {
        let mut path = prefix.to_vec();
        let line = self.tokens.get(self.at).map_or(0, |token| token.line);
        loop {
            match self.text().to_owned().as_str() {
                "::" => self.at += 1,
                "{" => {
                    self.at += 1;
                    while self.text() != "}" && self.at < self.tokens.len() {
                        if self.text() == "," {
                            self.at += 1;
                        } else {
                            self.branch(&path);
                        }
                    }
                    self.at += 1;
                    return;
                }
                "" | "," | "}" => break,
                "as" => {
                    self.at += 1;
                    let name = self.text().to_owned();
                    self.at += 1;
                    self.leaves.push((path, name, line));
                    return;
                }
                // `a::{self}` is `a`
                "self" if !path.is_empty() => self.at += 1,
                word => {
                    path.push(word.to_owned());
                    self.at += 1;
                }
            }
        }
        let name = path.last().cloned().unwrap_or_default();
        self.leaves.push((path, name, line));
    }
}

#[test]
fn the_scanner_sees_what_the_compiler_sees() {
    let text = r##"
// use crate::comment;
/* use crate::block; /* nested */ */
pub use crate::one::{self, two::Three, four::{Five as Six, seven}};
use super::neighbour::*;
const TEXT: &str = "crate::text::in_a_string"; const RAW: &str = r#"crate::raw "quoted""#;
fn f<'a>(x: &'a str) -> char { let y = crate::inline::call::<u8>(x); '"' }
mod tests { use super::*; fn g() { super::super::up::h() } }
fn all() -> impl Iterator<Item = u8> + use<'_> { let r#use = 1; crate::captured::run() }
fn after() { other::crate_name(); wheelstate::plant::run(); '\'' ; super::last() }
"##;
    let module = ["own", "parent", "child"].map(str::to_owned);
    let found = paths(&tokens(text), &module, &["own", "wheelstate"]);
    let found: Vec<(String, usize)> = found.iter().map(|path| (path.segments.join("::"), path.line)).collect();
    let expected = [
        ("own::one", 4),
        ("own::one::two::Three", 4),
        ("own::one::four::Five", 4),
        ("own::one::four::seven", 4),
        ("own::parent::neighbour::*", 5),
        ("own::inline::call", 7),
        ("own::parent::child::*", 8),
        ("own::parent::up::h", 8),
        ("own::captured::run", 9),
        ("wheelstate::plant::run", 10),
        ("own::parent::last", 10),
    ];
    assert_eq!(found, expected.map(|(path, line)| (path.to_owned(), line)));
}
