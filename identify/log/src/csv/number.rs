//! The usual number of a log, digits with a point among them, faster than a parser of all numbers reads it.
//!
//! Digits behind the point are taken eight at a time, and a rest of fewer without a branch for each. The nearest double is
//! found as by Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51 (2021), 1700-1727,
//! <https://doi.org/10.1002/spe.2984>, reduced to the powers of ten that so few digits need: there the product below always
//! decides.

/// More digits may not fit into 64 bits.
const DIGITS: usize = 19;

/// Powers of ten.
const TEN: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// The first 128 bits of `5^-k`, rounded up; `5^0` is not used.
const FIFTHS: [u128; DIGITS + 1] = {
    let mut fifths = [0; DIGITS + 1];
    let (mut k, mut power) = (1, 1_u128);
    while k <= DIGITS {
        power *= 5;
        // 2^(bits + 127) / 5^k digit by digit, where 2^bits is the least power of two above 5^k
        let bits = 128 - power.leading_zeros();
        let (mut quotient, mut rest, mut digit) = (0_u128, 1, 0);
        while digit < bits + 127 {
            (quotient, rest, digit) = (quotient << 1, rest << 1, digit + 1);
            if rest >= power {
                (quotient, rest) = (quotient | 1, rest - power);
            }
        }
        fifths[k] = quotient + 1;
        k += 1;
    }
    fifths
};

/// The number with which a text begins, and its length; none if it is of another kind, or less than eight bytes follow
/// it. Exactly the nearest double. Whether an exponent follows is left for the caller to see.
#[inline]
pub fn leading(text: &[u8]) -> Option<(f64, usize)> {
    let negative = text.first() == Some(&b'-');
    let start = usize::from(negative);
    let (mut number, mut places, mut at) = (0_u64, 0, start);
    // Few digits stand before the point.
    while let Some(digit @ b'0'..=b'9') = text.get(at) {
        number = number.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
        at += 1;
    }
    let mut count = at - start;
    if text.get(at) == Some(&b'.') {
        let point = at;
        (number, at) = digits(text, point + 1, number)?;
        places = at - point - 1;
        count += places;
    }
    if count == 0 || count > DIGITS {
        return None;
    }
    // No shorter way for what fits into 53 bits: the processor cannot foresee which numbers do.
    let size = if places == 0 || number == 0 { number as f64 } else { quotient(number, places) };
    Some((f64::from_bits(size.to_bits() | u64::from(negative) << 63), at))
}

/// Appends the digits from a place on to a number; the number, if it fits, and where they end.
#[inline]
fn digits(text: &[u8], mut at: usize, mut number: u64) -> Option<(u64, usize)> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    loop {
        let word = u64::from_le_bytes(*text.get(at..)?.first_chunk()?) ^ (0x30 * ONES);
        // The highest bit of a byte that is no digit, and of none before it.
        let foreign = (word.wrapping_add(0x76 * ONES) | word) & (0x80 * ONES);
        if foreign == 0 {
            number = number.wrapping_mul(TEN[8]).wrapping_add(eight(word));
            at += 8;
            continue;
        }
        let count = foreign.trailing_zeros() / 8;
        // Noughts in front of fewer than eight digits.
        let rest = eight(word.checked_shl(64 - 8 * count).unwrap_or(0));
        number = number.wrapping_mul(TEN[count as usize]).wrapping_add(rest);
        return Some((number, at + count as usize));
    }
}

/// The number of eight digits, one to a byte, the first of them in the lowest.
#[inline]
fn eight(digits: u64) -> u64 {
    let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
    let low = (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(100 + (1_000_000 << 32));
    let high = ((pairs >> 16) & 0x0000_00ff_0000_00ff).wrapping_mul(1 + (10_000 << 32));
    low.wrapping_add(high) >> 32
}

/// The double nearest to `number / 10^places`, for a number above 0 and 1 to [`DIGITS`] places.
#[inline]
fn quotient(number: u64, places: usize) -> f64 {
    let zeros = number.leading_zeros();
    let number = u128::from(number << zeros);
    let fifth = FIFTHS[places];
    let mut product = number * (fifth >> 64);
    // The lower half of the power matters only where all bits behind those of the result are ones.
    if (product >> 64) & 0x1ff == 0x1ff {
        product += (number * (fifth & u128::from(u64::MAX))) >> 64;
    }
    let (upper, lower) = ((product >> 64) as u64, product as u64);
    let top = upper >> 63;
    // 53 bits and one to round by
    let shift = top + 9;
    let mut bits = upper >> shift;
    if lower <= 1 {
        bits = halfway(bits, bits << shift == upper, places);
    }
    bits = (bits + (bits & 1)) >> 1;
    // 2^exponent is the power of two in 10^-places, times that of the upper half
    let exponent = ((-217_706 * places as i64) >> 16) + 63 + top as i64 - i64::from(zeros) + 1023;
    // A mantissa that was rounded up to the next power of two carries into the exponent.
    f64::from_bits(((exponent - 1) as u64).wrapping_shl(52).wrapping_add(bits))
}

/// Halfway between two doubles, which only few fives allow: to the even one.
#[cold]
fn halfway(bits: u64, exactly: bool, places: usize) -> u64 {
    if exactly && places <= 4 && bits & 3 == 1 { bits & !1 } else { bits }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What follows the number in question.
    const MORE: &str = ",12345678901234567890123";

    /// The standard library's parser is the oracle.
    fn check(text: &str) -> Result<(), TestCaseError> {
        let (number, length) = leading(format!("{text}{MORE}").as_bytes()).expect("a usual number");
        prop_assert_eq!(length, text.len());
        prop_assert_eq!(number.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{}", text);
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn numbers_of_up_to_nineteen_digits_are_the_nearest_doubles(digits in "[0-9]{1,19}", point in 0..20_usize, sign in any::<bool>()) {
            let (whole, places) = digits.split_at(point.min(digits.len()));
            check(&format!("{}{whole}.{places}", if sign { "-" } else { "" }))?;
            check(&digits)?;
        }

        #[test]
        fn the_shortest_texts_of_doubles_give_them_back(value in -1.0..1.0, scale in 0..4) {
            let value: f64 = value * [1.0, 10.0, 1e3, 1e6][scale as usize];
            let text = format!("{value:?}");
            if !text.contains('e') && text.bytes().filter(u8::is_ascii_digit).count() <= DIGITS {
                check(&text)?;
            }
        }

        /// Halves of the last of 53 bits, and the numbers of as many places beside them.
        #[test]
        fn halves_between_two_doubles_go_to_the_even_one(places in 1..5_u32, bits in 0..1_u64 << 52, off in 0..3_u64) {
            let odd = u128::from(2 * (bits | 1 << 52) + 1) * 5_u128.pow(places);
            let text = (odd + u128::from(off) - 1).to_string();
            if text.len() <= DIGITS {
                let (whole, rest) = text.split_at(text.len() - places as usize);
                check(&format!("{whole}.{rest}"))?;
            }
        }
    }

    #[test]
    fn what_is_of_another_kind_is_left_to_others() {
        for text in
            ["", "-", ".", "-.", "e5", "nan", "+1", "inf", "12345678901234567890", ".123456789012345678901234567", "x"]
        {
            assert_eq!(leading(format!("{text}{MORE}").as_bytes()), None, "{text}");
        }
        assert_eq!(leading(format!("1.5E3{MORE}").as_bytes()), Some((1.5, 3)), "what follows is for others");
        assert_eq!(leading(b"1.5E3,12345678"), Some((1.5, 3)), "an exponent is for the caller");
        assert_eq!(leading(b"1.5"), None, "what follows cannot be looked at");
        assert_eq!(
            leading(b"-0,1234567").map(|(zero, length)| (zero.to_bits(), length)),
            Some(((-0.0_f64).to_bits(), 2))
        );
    }
}
