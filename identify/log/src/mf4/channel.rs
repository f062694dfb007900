//! Numbers out of the bits of records.

use super::Failure;
use super::conversion::Conversion;
use half::f16;

/// The records of a channel group.
#[derive(Clone, Copy, Debug)]
pub struct Records<'a> {
    pub bytes: &'a [u8],
    /// Bytes from one record to the next.
    pub stride: usize,
    pub count: usize,
    /// The invalidation bytes, from one record to the next, and where those of the first record begin.
    pub invalid: (&'a [u8], usize, usize),
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

    /// All values, converted; NaN where they are invalid. The field was checked.
    pub fn values(&self, records: &Records, conversion: &Conversion, invalid: Invalid) -> Vec<f64> {
        let mut values = self.raw(records);
        match conversion {
            Conversion::Identity => {}
            Conversion::Linear(a, b) => values.iter_mut().for_each(|value| *value = a + b * *value),
            conversion => values.iter_mut().for_each(|value| *value = conversion.apply(*value)),
        }
        match invalid {
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
        values
    }

    fn raw(&self, records: &Records) -> Vec<f64> {
        let size = self.bytes();
        let fields = (0..records.count).map(|k| &records.bytes[k * records.stride + self.byte..][..size]);
        // The usual widths on whole bytes; everything else bit by bit.
        macro_rules! each {
            ($type:ty, $from:ident) => {
                fields.map(|field| field.first_chunk().map_or(f64::NAN, |word| <$type>::$from(*word) as f64)).collect()
            };
        }
        match (self.kind, self.bit, self.bits) {
            (Kind::Index, ..) => (0..records.count).map(|k| k as f64).collect(),
            (Kind::Float { big: false }, 0, 64) => each!(f64, from_le_bytes),
            (Kind::Float { big: false }, 0, 32) => each!(f32, from_le_bytes),
            (Kind::Unsigned { big: false }, 0, 8) => each!(u8, from_le_bytes),
            (Kind::Unsigned { big: false }, 0, 16) => each!(u16, from_le_bytes),
            (Kind::Unsigned { big: false }, 0, 32) => each!(u32, from_le_bytes),
            (Kind::Signed { big: false }, 0, 8) => each!(i8, from_le_bytes),
            (Kind::Signed { big: false }, 0, 16) => each!(i16, from_le_bytes),
            (Kind::Signed { big: false }, 0, 32) => each!(i32, from_le_bytes),
            _ => fields.map(|field| self.number(field)).collect(),
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
        let records = Records { bytes, stride: bytes.len(), count: 1, invalid: (&[], 0, 0) };
        field.values(&records, &Conversion::Identity, Invalid::None)[0]
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
