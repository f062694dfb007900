//! Names in messages: those that are not there, and the ones that may have been meant.

/// What to say about a name that is not there: the most similar ones, or all if they are few.
pub fn hint(name: &str, names: &[&str]) -> String {
    let mut ranked: Vec<_> = names.iter().map(|candidate| (distance(name, candidate), *candidate)).collect();
    ranked.sort();
    let near: Vec<_> = ranked.iter().filter(|(d, _)| *d <= 1 + name.chars().count() / 4).take(3).collect();
    match near.as_slice() {
        [] if names.is_empty() => "it has no columns".to_owned(),
        [] => format!("there are {}", listed(names.iter().copied())),
        near => {
            let words: Vec<_> = near.iter().map(|(_, candidate)| quoted(candidate)).collect();
            format!("did you mean {}?", words.join(" or "))
        }
    }
}

/// The most similar of some names, if any is similar at all.
pub fn nearest<'a>(name: &str, names: &[&'a str]) -> Option<&'a str> {
    let ranked = names.iter().map(|candidate| (distance(name, candidate), *candidate)).min();
    ranked.filter(|(d, _)| *d <= 1 + name.chars().count() / 4).map(|(_, candidate)| candidate)
}

/// Whether a name fits a pattern in which one `*` may stand for any text.
pub fn fits(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        Some((head, tail)) => name.len() >= head.len() + tail.len() && name.starts_with(head) && name.ends_with(tail),
        None => pattern == name,
    }
}

/// Edits between two names, case ignored; 1 if one contains the other, which is no mere letter.
pub(super) fn distance(a: &str, b: &str) -> usize {
    let (a, b) = (a.to_lowercase(), b.to_lowercase());
    if a == b {
        return 0;
    }
    if a.len().min(b.len()) > 1 && (a.contains(&b) || b.contains(&a)) {
        return 1;
    }
    let b: Vec<char> = b.chars().take(80).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().take(80).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// A text from a file, short and without control characters, for an error message.
pub fn quoted(text: &str) -> String {
    let escaped: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    format!("'{escaped}{}'", if text.chars().count() > 40 { "..." } else { "" })
}

/// Some of the names, for an error message that must stay one line.
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.into_iter().collect();
    let shown: Vec<_> = names.iter().take(12).map(|name| quoted(name).trim_matches('\'').to_owned()).collect();
    let rest = names.len().saturating_sub(shown.len());
    shown.join(", ") + &(if rest > 0 { format!(" and {rest} more") } else { String::new() })
}
