//! Numbers out of the bits of records.

use super::Failure;
use super::conversion::Conversion;
use half::f16;

/// Records of a channel group that follow each other.
#[derive(Clone, Copy, Debug)]
pub struct Records<'a> {
    pub bytes: &'a [u8],
    /// Bytes from one record to the next.
    pub stride: usize,
    /// The first record's number in its group, and how many there are.
    pub first: usize,
    pub count: usize,
    /// The invalidation bytes, from one record to the next, and where those of the first record begin.
    pub invalid: (&'a [u8], usize, usize),
}

/// A channel that is being read.
#[derive(Debug)]
pub struct Reading {
    /// Its place among the columns of its group.
    pub place: usize,
    pub field: Field,
    pub conversion: Conversion,
    pub invalid: Invalid,
    /// The values so far, converted; NaN where they are invalid.
    pub values: Vec<f64>,
}

/// Where a channel's numbers stand in a record.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    pub kind: Kind,
    pub byte: usize,
    pub bit: u32,
    pub bits: u32,
}

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Unsigned {
        big: bool,
    },
    Signed {
        big: bool,
    },
    Float {
        big: bool,
    },
    /// The record's own number; nothing is stored.
    Index,
}

/// Which samples are invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Invalid {
    None,
    All,
    Bit(usize),
}

impl<'a> Records<'a> {
    /// The bytes of a field in each record.
    fn fields(&self, byte: usize, size: usize) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.bytes.chunks_exact(self.stride.max(1)).take(self.count).map(move |record| &record[byte..byte + size])
    }
}

impl Reading {
    /// Reads the values of further records.
    pub fn take(&mut self, records: &Records) {
        let start = self.values.len();
        self.field.append(records, &mut self.values);
        let values = &mut self.values[start..];
        match &self.conversion {
            Conversion::Identity => {}
            Conversion::Linear(a, b) => values.iter_mut().for_each(|value| *value = a + b * *value),
            conversion => values.iter_mut().for_each(|value| *value = conversion.apply(*value)),
        }
        match self.invalid {
            Invalid::None => {}
            Invalid::All => values.fill(f64::NAN),
            Invalid::Bit(bit) => {
                let (bytes, stride, start) = records.invalid;
                for (k, value) in values.iter_mut().enumerate() {
                    let byte = bytes.get(k * stride + start + bit / 8).copied().unwrap_or(0);
                    if byte >> (bit % 8) & 1 == 1 {
                        *value = f64::NAN;
                    }
                }
            }
        }
    }
}

impl Field {
    /// Refuses widths that no number has.
    pub fn check(&self, record: usize) -> Result<(), Failure> {
        let widths_of_floats = [16, 32, 64];
        match self.kind {
            Kind::Index => return Ok(()),
            Kind::Float { .. } if !widths_of_floats.contains(&self.bits) => {
                return Err(Failure::foreign(format!("floats of {} bits", self.bits)));
            }
            _ if self.bits == 0 || self.bits > 64 => {
                return Err(Failure::foreign(format!("integers of {} bits", self.bits)));
            }
            _ => {}
        }
        let end = self.byte.checked_add(self.bytes());
        if self.bit > 7 || end.is_none_or(|end| end > record) {
            return Err(Failure::foreign("values that lie outside the record".to_owned()));
        }
        Ok(())
    }

    fn bytes(&self) -> usize {
        (self.bit + self.bits).div_ceil(8) as usize
    }

    /// Appends the numbers as they are stored. The field was checked.
    fn append(&self, records: &Records, to: &mut Vec<f64>) {
        // The usual widths on whole bytes; everything else bit by bit.
        macro_rules! each {
            ($type:ty) => {{
                const SIZE: usize = size_of::<$type>();
                let number = |field: &[u8]| {
                    field.first_chunk::<SIZE>().map_or(f64::NAN, |word| <$type>::from_le_bytes(*word) as f64)
                };
                to.extend(records.fields(self.byte, SIZE).map(number))
            }};
        }
        match (self.kind, self.bit, self.bits) {
            (Kind::Index, ..) => to.extend((records.first..).take(records.count).map(|k| k as f64)),
            (Kind::Float { big: false }, 0, 64) => each!(f64),
            (Kind::Float { big: false }, 0, 32) => each!(f32),
            (Kind::Unsigned { big: false }, 0, 8) => each!(u8),
            (Kind::Unsigned { big: false }, 0, 16) => each!(u16),
            (Kind::Unsigned { big: false }, 0, 32) => each!(u32),
            (Kind::Signed { big: false }, 0, 8) => each!(i8),
            (Kind::Signed { big: false }, 0, 16) => each!(i16),
            (Kind::Signed { big: false }, 0, 32) => each!(i32),
            _ => to.extend(records.fields(self.byte, self.bytes()).map(|field| self.number(field))),
        }
    }

    fn number(&self, field: &[u8]) -> f64 {
        let fold = |word: u128, byte: &u8| word << 8 | u128::from(*byte);
        let (Kind::Unsigned { big } | Kind::Signed { big } | Kind::Float { big }) = self.kind else { return f64::NAN };
        let word = if big { field.iter().fold(0, fold) } else { field.iter().rev().fold(0, fold) };
        let word = (word >> self.bit) as u64 & (u64::MAX >> (64 - self.bits));
        match (self.kind, self.bits) {
            (Kind::Float { .. }, 16) => f16::from_bits(word as u16).to_f64(),
            (Kind::Float { .. }, 32) => f32::from_bits(word as u32).into(),
            (Kind::Float { .. }, _) => f64::from_bits(word),
            // The sign bit up to the top and back.
            (Kind::Signed { .. }, bits) => ((word << (64 - bits)) as i64 >> (64 - bits)) as f64,
            _ => word as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(kind: Kind, bit: u32, bits: u32, bytes: &[u8]) -> f64 {
        let field = Field { kind, byte: 0, bit, bits };
        field.check(bytes.len()).unwrap();
        let records = Records { bytes, stride: bytes.len(), first: 0, count: 1, invalid: (&[], 0, 0) };
        let (conversion, invalid) = (Conversion::Identity, Invalid::None);
        let mut reading = Reading { place: 0, field, conversion, invalid, values: Vec::new() };
        reading.take(&records);
        reading.values[0]
    }

    #[test]
    fn numbers_of_any_width_are_read_at_any_bit() {
        let (little, big) = (Kind::Unsigned { big: false }, Kind::Unsigned { big: true });
        assert_eq!(read(little, 3, 5, &[0b1011_1000]), 23.0);
        assert_eq!(read(little, 4, 12, &[0x30, 0x12]), 0x123 as f64);
        assert_eq!(read(big, 4, 12, &[0x12, 0x30]), 0x123 as f64);
        assert_eq!(read(Kind::Signed { big: false }, 1, 4, &[0b0001_1110]), -1.0);
        assert_eq!(read(Kind::Signed { big: true }, 0, 64, &(-5_i64).to_be_bytes()), -5.0);
        // 64 bits that begin within a byte reach into a ninth one.
        let shifted = (u128::from(u64::MAX - 7) << 5).to_le_bytes();
        assert_eq!(read(little, 5, 64, &shifted[..9]), (u64::MAX - 7) as f64);
        let shifted = (u128::from(1.5_f64.to_bits()) << 2).to_le_bytes();
        assert_eq!(read(Kind::Float { big: false }, 2, 64, &shifted[..9]), 1.5);
        // IEEE 754 binary16: 0x3555 is the number nearest to one third.
        assert_eq!(read(Kind::Float { big: false }, 0, 16, &[0x55, 0x35]), 0.333251953125);
    }

    #[test]
    fn odd_widths_are_named() {
        let field = |kind, bits| Field { kind, byte: 0, bit: 0, bits }.check(8).is_err();
        assert!(field(Kind::Float { big: false }, 24) && field(Kind::Unsigned { big: false }, 0));
        assert!(field(Kind::Unsigned { big: false }, 65) && !field(Kind::Unsigned { big: false }, 64));
    }
}
