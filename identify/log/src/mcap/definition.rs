//! Message definitions of ROS: which fields follow each other in a message.

use std::collections::HashMap;

/// Messages are nested at most so deep.
const DEEPEST: usize = 24;
/// Elements of lists of unknown length that can be named: of numbers, and of messages.
const ELEMENTS: (usize, usize) = (64, 8);
/// No more fields of one topic can be named.
const MOST: usize = 20_000;

/// A plain number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    /// A time or duration of ROS 1: seconds and nanoseconds in 32 bits each.
    Seconds,
    /// The same with a sign.
    SignedSeconds,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Self::Bool,
            "int8" => Self::I8,
            "byte" | "char" | "uint8" | "octet" => Self::U8,
            "int16" => Self::I16,
            "uint16" => Self::U16,
            "int32" => Self::I32,
            "uint32" => Self::U32,
            "int64" => Self::I64,
            "uint64" => Self::U64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            "time" => Self::Seconds,
            "duration" => Self::SignedSeconds,
            _ => return None,
        })
    }
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Number(Number),
    Text,
    /// Text of wide characters, whose layout depends on the middleware.
    WideText,
    /// The message at this place of [`Definition::messages`].
    Message(usize),
}

/// How often.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Count {
    One,
    Fixed(usize),
    /// As often as a number in front of it says.
    Told,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    pub name: String,
    pub kind: Kind,
    pub count: Count,
}

/// A message type with all types that it is made of; the first is itself.
#[derive(Clone, Debug, Default)]
pub struct Definition {
    pub messages: Vec<Vec<Field>>,
}

impl Definition {
    /// Parses a recorded definition: the type's own fields, then those of other types, each below a line of `=` and a
    /// line `MSG: package/Type`. `standard` knows types that the record leaves out.
    pub fn parse(name: &str, text: &str, standard: impl Fn(&str) -> Option<&'static str>) -> Result<Self, String> {
        let mut texts: HashMap<String, &str> = HashMap::new();
        let mut parts = text.split("\n=====").map(|part| part.trim_start_matches('='));
        let own = parts.next().unwrap_or_default();
        for part in parts {
            let (head, body) = part.trim_start().split_once('\n').unwrap_or((part.trim(), ""));
            if let Some(name) = head.trim().strip_prefix("MSG:") {
                texts.insert(short(name.trim()), body);
            }
        }
        let mut parser = Parser { texts, standard, places: HashMap::new(), definition: Self::default() };
        parser.message(&short(name), Some(own), 0)?;
        Ok(parser.definition)
    }

    /// The fields that hold numbers: `twist.linear.x`, `position[0]`.
    pub fn leaves(&self) -> Vec<String> {
        let mut leaves = Vec::new();
        self.collect(0, "", &mut leaves);
        leaves
    }

    fn collect(&self, message: usize, path: &str, leaves: &mut Vec<String>) {
        for field in &self.messages[message] {
            let name = if path.is_empty() { field.name.clone() } else { format!("{path}.{}", field.name) };
            let is_number = matches!(field.kind, Kind::Number(_));
            let elements = match field.count {
                Count::One => None,
                Count::Fixed(count) => Some(count.min(ELEMENTS.0)),
                Count::Told => Some(if is_number { ELEMENTS.0 } else { ELEMENTS.1 }),
            };
            let names = match elements {
                None => vec![name],
                Some(count) => (0..count).map(|k| format!("{name}[{k}]")).collect(),
            };
            for name in names {
                match field.kind {
                    _ if leaves.len() >= MOST => return,
                    Kind::Number(_) => leaves.push(name),
                    Kind::Message(inner) => self.collect(inner, &name, leaves),
                    Kind::Text | Kind::WideText => {}
                }
            }
        }
    }
}

/// `package/Type` of `package/msg/Type`.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

struct Parser<'a, S> {
    texts: HashMap<String, &'a str>,
    standard: S,
    /// Places of messages that are known; `None` while they are being read.
    places: HashMap<String, Option<usize>>,
    definition: Definition,
}

impl<S: Fn(&str) -> Option<&'static str>> Parser<'_, S> {
    fn message(&mut self, name: &str, own: Option<&str>, depth: usize) -> Result<usize, String> {
        match self.places.get(name) {
            Some(Some(place)) => return Ok(*place),
            Some(None) => return Err(format!("type {name} holds itself")),
            None => {}
        }
        if depth > DEEPEST {
            return Err(format!("type {name} is nested too deep"));
        }
        let text = own.or_else(|| self.texts.get(name).copied()).or_else(|| (self.standard)(name));
        let text = text.ok_or_else(|| format!("type {name} is not defined"))?.to_owned();
        self.places.insert(name.to_owned(), None);
        let place = self.definition.messages.len();
        self.definition.messages.push(Vec::new());
        let package = name.split_once('/').map_or("", |(package, _)| package).to_owned();
        let mut fields = Vec::new();
        for line in text.lines() {
            let line = line.split_once('#').map_or(line, |(line, _)| line).trim();
            if line.is_empty() || line.starts_with("MSG:") {
                continue;
            }
            let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
                return Err(format!("'{}' in type {name} is not a field", line.escape_debug()));
            };
            let field = rest.split_whitespace().next().unwrap_or_default();
            // Constants have a value, fields may have a default one without an equals sign.
            if rest.contains('=') {
                continue;
            }
            fields.push(self.field(kind, field, &package, depth)?);
        }
        self.definition.messages[place] = fields;
        self.places.insert(name.to_owned(), Some(place));
        Ok(place)
    }

    fn field(&mut self, kind: &str, name: &str, package: &str, depth: usize) -> Result<Field, String> {
        let (kind, count) = match kind.split_once('[') {
            None => (kind, Count::One),
            Some((kind, rest)) => {
                let inner = rest.strip_suffix(']').ok_or_else(|| format!("'{kind}[{rest}' is not a type"))?;
                match inner.parse() {
                    Ok(count) => (kind, Count::Fixed(count)),
                    // Empty, or `<=n`: as many as the message says.
                    Err(_) => (kind, Count::Told),
                }
            }
        };
        // Bounded texts: `string<=10`.
        let plain = kind.split_once("<=").map_or(kind, |(kind, _)| kind);
        let kind = match (plain, Number::named(plain)) {
            (_, Some(number)) => Kind::Number(number),
            ("string", _) => Kind::Text,
            ("wstring", _) => Kind::WideText,
            ("Header", _) => Kind::Message(self.message("std_msgs/Header", None, depth + 1)?),
            (other, _) if other.contains('/') => Kind::Message(self.message(&short(other), None, depth + 1)?),
            (other, _) => Kind::Message(self.message(&format!("{package}/{other}"), None, depth + 1)?),
        };
        Ok(Field { name: name.to_owned(), kind, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_types_arrays_constants_and_defaults_are_understood() {
        let text = "# a comment\nuint8 MODE=3\nstring<=8 label \"a # b\"\nfloat64[2] pair\nint32[] list\nInner inner\n\
                    other_msgs/msg/Point point\n\
                    ================================================================================\n\
                    MSG: some_msgs/Inner\nbool flag true\n\
                    ================================================================================\n\
                    MSG: other_msgs/Point\nfloat64 x # metres\n";
        let definition = Definition::parse("some_msgs/msg/Outer", text, |_| None).unwrap();
        let leaves = definition.leaves();
        assert_eq!(leaves[..2], ["pair[0]", "pair[1]"]);
        assert_eq!(leaves[2 + ELEMENTS.0..], ["inner.flag", "point.x"]);
    }

    #[test]
    fn types_that_are_missing_or_hold_themselves_are_named() {
        let error = Definition::parse("a/B", "c/D d", |_| None).unwrap_err();
        assert!(error.contains("c/D"), "{error}");
        assert!(Definition::parse("a/B", "B again", |_| None).unwrap_err().contains("holds itself"));
    }
}
