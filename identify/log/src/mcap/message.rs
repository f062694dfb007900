//! Numbers out of serialised messages: the CDR of ROS 2 (versions 1 and 2, both byte orders) and the layout of ROS 1.

use super::definition::{Count, Definition, Kind, Number};

/// Which fields of a message are wanted, as a tree along its definition.
#[derive(Debug, Default)]
pub struct Plan {
    /// By field of the message, and by element of the field.
    fields: Vec<(usize, usize, Plan)>,
    /// Where the number goes.
    slot: Option<usize>,
}

impl Plan {
    /// Adds a field by its path, as in `twist.linear.x` or `position[3]`; false if there is none.
    pub fn add(&mut self, definition: &Definition, path: &str, slot: usize) -> bool {
        let mut plan = self;
        let mut message = Some(0);
        for step in path.split('.') {
            let Some(fields) = message.map(|message: usize| &definition.messages[message]) else { return false };
            let (name, element) = match step.split_once('[') {
                None => (step, 0),
                Some((name, rest)) => match rest.trim_end_matches(']').parse() {
                    Ok(element) => (name, element),
                    Err(_) => return false,
                },
            };
            let Some(index) = fields.iter().position(|field| field.name == name) else { return false };
            message = match fields[index].kind {
                Kind::Message(inner) => Some(inner),
                _ => None,
            };
            let known = plan.fields.iter().position(|(field, e, _)| (*field, *e) == (index, element));
            let place = known.unwrap_or_else(|| {
                plan.fields.push((index, element, Self::default()));
                plan.fields.len() - 1
            });
            plan = &mut plan.fields[place].2;
        }
        plan.slot = Some(slot);
        true
    }

    fn of(&self, field: usize, element: usize) -> Option<&Self> {
        self.fields.iter().find(|(f, e, _)| (*f, *e) == (field, element)).map(|(.., plan)| plan)
    }

    fn has(&self, field: usize) -> bool {
        self.fields.iter().any(|(f, ..)| *f == field)
    }
}

/// How messages are serialised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Cdr,
    Ros1,
}

/// Why a message cannot be read.
const SHORT: &str = "a message is shorter than its type";

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
    /// The widest alignment; 0 for none.
    align: usize,
}

/// Reads the wanted fields of a message into their slots.
pub fn read(
    definition: &Definition,
    plan: &Plan,
    encoding: Encoding,
    bytes: &[u8],
    to: &mut [f64],
) -> Result<(), String> {
    let mut reader = match encoding {
        Encoding::Ros1 => Reader { bytes, at: 0, big: false, align: 0 },
        Encoding::Cdr => {
            let (head, bytes) = bytes.split_at_checked(4).ok_or(SHORT)?;
            let (big, align) = match head[1] {
                0 => (true, 8),
                1 => (false, 8),
                6 => (true, 4),
                7 => (false, 4),
                other => return Err(format!("messages in a representation that is not read (CDR kind {other})")),
            };
            Reader { bytes, at: 0, big, align }
        }
    };
    reader.message(definition, 0, Some(plan), to)
}

impl Reader<'_> {
    fn message(
        &mut self,
        definition: &Definition,
        message: usize,
        plan: Option<&Plan>,
        to: &mut [f64],
    ) -> Result<(), String> {
        for (index, field) in definition.messages[message].iter().enumerate() {
            let wanted = plan.filter(|plan| plan.has(index));
            let count = match field.count {
                Count::One => 1,
                Count::Fixed(count) => count,
                Count::Told => self.length()?,
            };
            match field.kind {
                Kind::Number(number) => {
                    let size = number.size();
                    if count > 0 {
                        self.align_to(number.alignment());
                    }
                    let end = size.checked_mul(count).and_then(|bytes| self.at.checked_add(bytes));
                    let end = end.filter(|end| *end <= self.bytes.len()).ok_or(SHORT)?;
                    for (_, element, plan) in wanted.iter().flat_map(|plan| &plan.fields).filter(|(f, ..)| *f == index)
                    {
                        if let (Some(slot), true) = (plan.slot, *element < count) {
                            to[slot] = number.value(&self.bytes[self.at + element * size..][..size], self.big);
                        }
                    }
                    self.at = end;
                }
                Kind::Text => {
                    for _ in 0..count {
                        let length = self.length()?;
                        self.at += length;
                    }
                }
                Kind::WideText if count > 0 => return Err("messages with wide text are not read".to_owned()),
                Kind::WideText => {}
                Kind::Message(inner) => {
                    // A message without fields takes no bytes, however many of them are claimed.
                    if definition.messages[inner].is_empty() {
                        continue;
                    }
                    for element in 0..count {
                        let plan = wanted.and_then(|plan| plan.of(index, element));
                        self.message(definition, inner, plan, to)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// A count in front of texts and lists: never more than there are bytes left.
    fn length(&mut self) -> Result<usize, String> {
        self.align_to(4);
        let word = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk).ok_or(SHORT)?;
        let length = if self.big { u32::from_be_bytes(*word) } else { u32::from_le_bytes(*word) } as usize;
        self.at += 4;
        if length > self.bytes.len() - self.at { Err(SHORT.to_owned()) } else { Ok(length) }
    }

    fn align_to(&mut self, size: usize) {
        let size = size.min(self.align);
        if size > 1 {
            self.at = self.at.next_multiple_of(size);
        }
    }
}

impl Number {
    fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 | Self::Seconds | Self::SignedSeconds => 8,
        }
    }

    fn alignment(self) -> usize {
        if matches!(self, Self::Seconds | Self::SignedSeconds) { 4 } else { self.size() }
    }

    fn value(self, bytes: &[u8], big: bool) -> f64 {
        let fold = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
        let word = if big { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) };
        match self {
            Self::Bool => f64::from(u8::from(word != 0)),
            Self::I8 => f64::from(word as i8),
            Self::I16 => f64::from(word as i16),
            Self::I32 => f64::from(word as i32),
            Self::I64 => word as i64 as f64,
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => word as f64,
            Self::F32 => f32::from_bits(word as u32).into(),
            Self::F64 => f64::from_bits(word),
            // ROS 1 is little-endian: the seconds stand in the lower half.
            Self::Seconds => f64::from(word as u32) + f64::from((word >> 32) as u32) / 1e9,
            Self::SignedSeconds => f64::from(word as i32) + f64::from((word >> 32) as i32) / 1e9,
        }
    }
}
