//! Frames out of the three kinds of CAN logs: BLF and ASC of Vector's tools, and the text of `candump`.

use flate2::read::ZlibDecoder;
use std::io::Read;

/// Packed containers that grow beyond this many bytes are no log.
const LARGEST: u64 = 1 << 30;
/// Marks an identifier of 29 bits in BLF.
const EXTENDED: u32 = 1 << 31;

/// A frame with data.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<'a> {
    /// Time, s.
    pub time: f64,
    /// The bus, as the log calls it.
    pub channel: &'a str,
    pub id: u32,
    pub extended: bool,
    pub data: &'a [u8],
}

/// Calls `with` for each data frame of a BLF file; returns false if the file ends within an object.
pub fn blf(bytes: &[u8], mut with: impl FnMut(Frame)) -> Result<bool, String> {
    if !bytes.starts_with(b"LOGG") {
        return Err("it does not begin as one".to_owned());
    }
    let header = usize::try_from(u32_at(bytes, 4).ok_or("it ends within its header")?).unwrap_or(usize::MAX);
    let mut unpacked = Vec::new();
    // Objects go on from one container to the next.
    let whole = objects(bytes, header, |kind, object| {
        if kind != 10 {
            return Ok(());
        }
        let method = u16_at(object, 16).ok_or("a container is too short")?;
        let size = u64::from(u32_at(object, 24).ok_or("a container is too short")?);
        let data = object.get(32..).ok_or("a container is too short")?;
        if size + unpacked.len() as u64 > LARGEST.max(200 * bytes.len() as u64) {
            return Err("it unpacks to more than 200 times its size and 1 GiB, as no log does".to_owned());
        }
        match method {
            0 => unpacked.extend_from_slice(data),
            2 => {
                ZlibDecoder::new(data)
                    .take(size)
                    .read_to_end(&mut unpacked)
                    .map_err(|e| format!("a container is damaged: {e}"))?;
            }
            other => return Err(format!("containers packed by method {other} are not read")),
        }
        Ok(())
    })?;
    let ended = objects(&unpacked, 0, |kind, object| {
        if let Some(frame) = object_frame(kind, object) {
            with(frame);
        }
        Ok(())
    })?;
    Ok(whole && ended)
}

/// Calls `with` for the kind and the bytes of each object from a place on; false if the last one is not whole.
fn objects<'a>(
    bytes: &'a [u8],
    mut at: usize,
    mut with: impl FnMut(u32, &'a [u8]) -> Result<(), String>,
) -> Result<bool, String> {
    loop {
        // Objects are padded, in more than one way.
        let Some(rest) = bytes.get(at..) else { return Ok(true) };
        let Some(skip) = rest.windows(4).take(8).position(|window| window == b"LOBJ") else {
            return Ok(rest.len() < 16);
        };
        at += skip;
        let (Some(size), Some(kind)) = (u32_at(bytes, at + 8), u32_at(bytes, at + 12)) else { return Ok(false) };
        let size = size as usize;
        let Some(object) = at.checked_add(size).and_then(|end| bytes.get(at..end)).filter(|_| size >= 16) else {
            return Ok(false);
        };
        with(kind, object)?;
        at += size;
    }
}

/// The data frame of an object: CAN messages (1, 86) and those of CAN FD (100, 101).
fn object_frame(kind: u32, object: &[u8]) -> Option<Frame<'_>> {
    let head = usize::from(u16_at(object, 4)?);
    let ticks = u64::from_le_bytes(*object.get(24..)?.first_chunk()?);
    let time = if u32_at(object, 16)? == 1 {
        ticks as f64 / 1e5
    } else {
        (ticks / 1_000_000_000) as f64 + (ticks % 1_000_000_000) as f64 / 1e9
    };
    let body = object.get(head..)?;
    let (channel, id, remote, data) = match kind {
        1 | 86 => {
            let length = usize::from(*body.get(3)?).min(8);
            (u16_at(body, 0)?, u32_at(body, 4)?, body.get(2)? & 0x80 != 0, body.get(8..8 + length)?)
        }
        100 => {
            let length = usize::from(*body.get(14)?).min(64);
            (u16_at(body, 0)?, u32_at(body, 4)?, false, body.get(20..20 + length)?)
        }
        101 => {
            let length = usize::from(*body.get(2)?).min(64);
            (u16::from(*body.first()?), u32_at(body, 4)?, u32_at(body, 12)? & 0x10 != 0, body.get(40..40 + length)?)
        }
        _ => return None,
    };
    (!remote).then_some(Frame {
        time,
        channel: number(channel),
        id: id & !EXTENDED,
        extended: id & EXTENDED != 0,
        data,
    })
}

/// The name of a channel that is identified by a number.
fn number(channel: u16) -> &'static str {
    const NAMES: [&str; 17] =
        ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12", "13", "14", "15", "16"];
    NAMES.get(usize::from(channel)).copied().unwrap_or("above 16")
}

/// Calls `with` for each data frame of an ASC file.
pub fn asc(text: &str, mut with: impl FnMut(Frame)) -> Result<(), String> {
    let (mut base, mut relative, mut last) = (16, false, 0.0);
    for (line, text) in text.lines().enumerate() {
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.first() == Some(&"base") {
            base = if words.get(1) == Some(&"dec") { 10 } else { 16 };
            relative = words.contains(&"relative");
            continue;
        }
        // Every event begins with its time; everything else is a header, a comment or a trigger block.
        let Some(time) = words.first().and_then(|word| word.parse::<f64>().ok()) else { continue };
        let time = if relative { last + time } else { time };
        last = time;
        let fail = || format!("line {}: a frame that is not understood", line + 1);
        let mut data = [0; 64];
        match words.as_slice() {
            [_, "CANFD", channel, _, rest @ ..] => {
                let Some((id, rest)) = rest.split_first() else { return Err(fail()) };
                // A name may stand behind the identifier; then two flags, the code of the length and the length.
                let rest = if rest.first().is_some_and(|word| matches!(*word, "0" | "1")) {
                    rest
                } else {
                    rest.get(1..).unwrap_or_default()
                };
                let (Some((id, extended)), [_, _, _, length, bytes @ ..]) = (identifier(id, base), rest) else {
                    continue;
                };
                let length = length.parse::<usize>().ok().filter(|length| *length <= 64).ok_or_else(fail)?;
                let data = read_bytes(bytes.get(..length).ok_or_else(fail)?, base, &mut data).ok_or_else(fail)?;
                with(Frame { time, channel, id, extended, data });
            }
            [_, channel, id, "Rx" | "Tx", "d" | "D", length, bytes @ ..] => {
                let (id, extended) = identifier(id, base).ok_or_else(fail)?;
                let code = usize::from_str_radix(length, base).map_err(|_| fail())?;
                let length = code.min(8);
                let data = read_bytes(bytes.get(..length).ok_or_else(fail)?, base, &mut data).ok_or_else(fail)?;
                with(Frame { time, channel, id, extended, data });
            }
            _ => {}
        }
    }
    Ok(())
}

fn identifier(word: &str, base: u32) -> Option<(u32, bool)> {
    let (digits, extended) = match word.strip_suffix('x') {
        Some(digits) => (digits, true),
        None => (word, false),
    };
    Some((u32::from_str_radix(digits, base).ok()?, extended))
}

fn read_bytes<'a>(words: &[&str], base: u32, to: &'a mut [u8; 64]) -> Option<&'a [u8]> {
    for (byte, word) in to.iter_mut().zip(words) {
        *byte = u8::from_str_radix(word, base).ok()?;
    }
    to.get(..words.len())
}

/// Calls `with` for each data frame of candump's text, times in s; an error names the line. Both of its forms are read:
/// `(1436509052.249713) can0 044#2A366C2BBA` and `(1436509052.249713)  can0  044   [5]  2A 36 6C 2B BA`.
pub fn candump(text: &str, mut with: impl FnMut(Frame)) -> Result<(), String> {
    for (line, text) in text.lines().enumerate().filter(|(_, text)| !text.trim().is_empty()) {
        let fail = || {
            format!(
                "line {}: is not a line of candump: '{}'",
                line + 1,
                text.chars().take(60).collect::<String>().escape_debug()
            )
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        let [time, channel, frame, rest @ ..] = words.as_slice() else { return Err(fail()) };
        let time = time
            .strip_prefix('(')
            .and_then(|time| time.strip_suffix(')'))
            .and_then(|time| time.parse().ok())
            .ok_or_else(fail)?;
        let mut data = [0; 64];
        let (id, length) = match frame.split_once('#') {
            Some((id, digits)) => {
                // CAN FD has a second sign and a digit of flags.
                let digits = digits.strip_prefix('#').map_or(digits, |digits| digits.get(1..).unwrap_or_default());
                if digits.starts_with('R') {
                    continue;
                }
                let digits = digits.split('_').next().unwrap_or_default().replace('.', "");
                let pairs = digits.as_bytes().chunks(2);
                let mut length = 0;
                for pair in pairs {
                    let byte = std::str::from_utf8(pair)
                        .ok()
                        .filter(|pair| pair.len() == 2)
                        .and_then(|pair| u8::from_str_radix(pair, 16).ok());
                    *data.get_mut(length).ok_or_else(fail)? = byte.ok_or_else(fail)?;
                    length += 1;
                }
                (id, length)
            }
            None => {
                let [length, bytes @ ..] = rest else { return Err(fail()) };
                let length = length
                    .trim_matches(['[', ']'])
                    .parse::<usize>()
                    .ok()
                    .filter(|length| *length <= 64)
                    .ok_or_else(fail)?;
                if bytes.first() == Some(&"remote") {
                    continue;
                }
                read_bytes(bytes.get(..length).ok_or_else(fail)?, 16, &mut data).ok_or_else(fail)?;
                (*frame, length)
            }
        };
        let number = u32::from_str_radix(id, 16).map_err(|_| fail())?;
        // Identifiers of 29 bits have eight digits; above them stand flags of error frames.
        if number & 0x2000_0000 != 0 {
            continue;
        }
        with(Frame { time, channel, id: number & 0x1fff_ffff, extended: id.len() > 3, data: &data[..length] });
    }
    Ok(())
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Time, bus, identifier, whether it has 29 bits, and data of a frame.
    type Copied = (f64, String, u32, bool, Vec<u8>);

    fn all(read: impl Fn(&mut dyn FnMut(Frame)) -> Result<(), String>) -> Result<Vec<Copied>, String> {
        let mut frames = Vec::new();
        read(&mut |frame| {
            frames.push((frame.time, frame.channel.to_owned(), frame.id, frame.extended, frame.data.to_vec()))
        })?;
        Ok(frames)
    }

    #[test]
    fn both_forms_of_candump_are_read() {
        let text = "(1436509052.249713) vcan0 044#2A36\n(2.5) can1 18FEF100##1AABB\n(3.0)  vcan0  044   [2]  2A 36\n\
                    (4.0) can0 123#R\n(5.0) can0 20000004#00\n";
        let frames = all(|with| candump(text, with)).unwrap();
        assert_eq!(frames[0], (1436509052.249713, "vcan0".to_owned(), 0x44, false, vec![0x2a, 0x36]));
        assert_eq!(frames[1], (2.5, "can1".to_owned(), 0x18FE_F100, true, vec![0xaa, 0xbb]));
        assert_eq!((frames[2].2, frames[2].4.as_slice(), frames.len()), (0x44, &[0x2a, 0x36][..], 3));
        assert!(all(|with| candump("(1.0) can0 044#2\n", with)).unwrap_err().starts_with("line 1"));
        assert!(all(|with| candump("hello\n", with)).is_err());
    }

    #[test]
    fn frames_of_asc_files_are_read() {
        let text = "date Sat Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\n// version 9.0.0\n\
                    0.015991 CAN 1 Status:chip status error passive - TxErr: 132 RxErr: 0\n\
                    2.501000 1  C8              Tx   d 8 09 08 07 06 05 04 03 02\n\
                    2.510001 2  100             Tx   r\n\
                    3.098426 1  18EBFF00x       Rx   d 2 01 A0  Length = 273910 BitCount = 141\n\
                    30.300981 CANFD   3 Tx     50005x  symbol  0 0 5 0 140000 73 200050 7a60 46500250\n\
                    31.0 CANFD   1 Rx        300                                   1 0 8  2 01 02   102203 133\n";
        let frames = all(|with| asc(text, with)).unwrap();
        assert_eq!(frames[0], (2.501, "1".to_owned(), 0xc8, false, vec![9, 8, 7, 6, 5, 4, 3, 2]));
        assert_eq!(frames[1], (3.098426, "1".to_owned(), 0x18EB_FF00, true, vec![1, 0xa0]));
        assert_eq!(frames.last().unwrap(), &(31.0, "1".to_owned(), 0x300, false, vec![1, 2]));
    }
}
