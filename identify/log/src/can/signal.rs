//! Numbers out of the bits of CAN frames, by the signals of a DBC file.

use can_dbc::{ByteOrder, Dbc, Message, MultiplexIndicator, Signal, SignalExtendedValueType, ValueType};

/// Where a signal stands and what its number means.
#[derive(Clone, Debug)]
pub struct Layout {
    start: usize,
    size: usize,
    big: bool,
    signed: bool,
    float: bool,
    factor: f64,
    offset: f64,
    /// Present only if the multiplexer has this value.
    when: Option<u64>,
}

impl Layout {
    /// The layout of a signal; the error says in words what it is instead.
    pub fn of(dbc: &Dbc, message: &Message, signal: &Signal) -> Result<Self, String> {
        let extended = dbc
            .extended_multiplex
            .iter()
            .any(|entry| entry.message_id == message.id && entry.signal_name == signal.name);
        let when = match signal.multiplexer_indicator {
            MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor => None,
            MultiplexIndicator::MultiplexedSignal(value) if !extended => Some(value),
            _ => return Err("a signal under several multiplexers".to_owned()),
        };
        let kind = dbc.extended_value_type_for_signal(message.id, &signal.name);
        let float = match kind {
            Some(SignalExtendedValueType::IEEEfloat32Bit) if signal.size == 32 => true,
            Some(SignalExtendedValueType::IEEEdouble64bit) if signal.size == 64 => true,
            Some(SignalExtendedValueType::IEEEfloat32Bit | SignalExtendedValueType::IEEEdouble64bit) => {
                return Err(format!("a float of {} bits", signal.size));
            }
            _ => false,
        };
        if signal.size == 0 || signal.size > 64 || signal.start_bit > 8 * 64 {
            return Err(format!("a signal of {} bits", signal.size));
        }
        Ok(Self {
            start: signal.start_bit as usize,
            size: signal.size as usize,
            big: signal.byte_order == ByteOrder::BigEndian,
            signed: signal.value_type == ValueType::Signed,
            float,
            factor: signal.factor,
            offset: signal.offset,
            when,
        })
    }

    /// The bits of the signal; `None` if the frame is too short for it.
    pub fn raw(&self, data: &[u8]) -> Option<u64> {
        let mut word = 0_u64;
        let mut at = self.start;
        for k in 0..self.size {
            let bit = u64::from(*data.get(at / 8)? >> (at % 8) & 1);
            if self.big {
                // The start is the highest bit; bits follow downwards in a byte and then at the top of the next one.
                word = word << 1 | bit;
                at = if at.is_multiple_of(8) { at + 15 } else { at - 1 };
            } else {
                word |= bit << k;
                at += 1;
            }
        }
        Some(word)
    }

    /// The physical value in a frame; NaN if it is not in there.
    pub fn value(&self, data: &[u8], multiplexer: Option<u64>) -> f64 {
        if self.when.is_some() && self.when != multiplexer {
            return f64::NAN;
        }
        let Some(word) = self.raw(data) else { return f64::NAN };
        let number = match (self.float, self.size) {
            (true, 32) => f64::from(f32::from_bits(word as u32)),
            (true, _) => f64::from_bits(word),
            (false, size) if self.signed => ((word << (64 - size)) as i64 >> (64 - size)) as f64,
            (false, _) => word as f64,
        };
        number * self.factor + self.offset
    }
}
