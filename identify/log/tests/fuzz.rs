//! Damaged files of every format: no panic, no endless loop, one line of refusal.
//!
//! Each reader gets valid files with random damage for `WHEELSTATE_FUZZ_SECONDS` (default 1). A failure names the seed and
//! keeps the file in the folder of temporary files.

use crate::measurement::{Channel, File, Group, UNSIGNED, double, record, time};
use flate2::{Compression, write::GzEncoder};
use std::io::{Cursor, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use wheelstate_log::progress::Progress;
use wheelstate_log::{ColumnMap, Input, Log};

const INPUTS: [Input; 2] = [Input { name: "speed", unit: "m/s" }, Input { name: "torque_left", unit: "N.m" }];

/// Xorshift by Marsaglia (2003): the same damage from the same seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// A file with some bits turned, bytes moved, words replaced by extreme ones, or its end cut off.
fn damaged(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(7) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 | 3 => {
                let word = [0, 1, 24, 0x7fff_ffff, u64::MAX, u64::MAX / 8, random.next() % (2 * whole.len() as u64)]
                    [random.below(7)];
                let width = [1, 2, 4, 8][random.below(4)];
                for (byte, new) in bytes[at..].iter_mut().zip(&word.to_le_bytes()[..width]) {
                    *byte = *new;
                }
            }
            4 => {
                let from = random.below(bytes.len());
                let piece = bytes[from..(from + 1 + random.below(64)).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            5 => {
                let end = (at + random.below(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            _ => bytes.truncate(at.max(1)),
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
    bytes
}

/// Feeds damaged copies of the files to the reader of this ending.
fn survive(ending: &str, files: &[Vec<u8>], maps: &[Option<&str>]) {
    wheelstate_log::guard::quiet();
    let seconds = std::env::var("WHEELSTATE_FUZZ_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(1.0);
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("car.dbc"), DBC).unwrap();
    let path = folder.path().join(format!("log.{ending}"));
    let maps: Vec<_> = maps
        .iter()
        .map(|text| {
            text.map(|text| {
                let file = folder.path().join("map.toml");
                std::fs::write(&file, text).unwrap();
                ColumnMap::read(&file).unwrap()
            })
        })
        .collect();
    for (file, map) in files.iter().flat_map(|file| maps.iter().map(move |map| (file, map))) {
        std::fs::write(&path, file).unwrap();
        // The files are good, whatever the map asks of them.
        if let Err(error) = Log::read_inputs(&path, map.as_ref(), &INPUTS, &|_| true, &Progress::none()) {
            assert!(!error.to_string().contains("damaged"), "{ending}: {error}");
        }
    }
    let seed = 0x9e37_79b9_7f4a_7c15 ^ std::process::id() as u64;
    let mut random = Random(seed);
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let mut rounds = 0;
    while Instant::now() < end {
        let bytes = damaged(&files[random.below(files.len())], &mut random);
        std::fs::write(&path, &bytes).unwrap();
        let map = &maps[random.below(maps.len())];
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| {
            Log::read_inputs(&path, map.as_ref(), &INPUTS, &|_| true, &Progress::none())
        }));
        let took = start.elapsed();
        let good = match &result {
            Ok(Ok(log)) => log.len() >= 2 && log.channels.iter().all(|channel| channel.values.len() == log.len()),
            Ok(Err(error)) => error.to_string().lines().count() == 1,
            Err(_) => false,
        };
        if !good || took > Duration::from_secs(20) {
            let kept = std::env::temp_dir().join(format!("wheelstate-fuzz.{ending}"));
            std::fs::write(&kept, &bytes).unwrap();
            panic!(
                "{ending}: seed {seed}, round {rounds}, {took:?}: {}: {:?}",
                kept.display(),
                result.map(|log| log.map(|log| log.len()))
            );
        }
        rounds += 1;
    }
    println!("{ending}: {rounds} damaged files");
}

fn plain_log() -> Log {
    let mut log = Log { time: (0..50).map(f64::from).collect(), ..Log::default() };
    log.push("speed", (0..50).map(|k| f64::from(k).sin()).collect::<Vec<_>>());
    log.push("torque_left", (0..50).map(|k| if k % 3 == 0 { f64::NAN } else { f64::from(k) }).collect::<Vec<_>>());
    log
}

fn written(ending: &str) -> Vec<u8> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(format!("log.{ending}"));
    plain_log().write(&path, std::fs::File::create(&path).unwrap()).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn damaged_text_files_never_panic() {
    let files: Vec<Vec<u8>> = [
        "time,speed,torque_left\n0,1,2\n1,2,3\n2,NA,4\n",
        "sep=;\nTime [s];speed [km/h];Größe\n0,0;1,5;3\n1,0;2,5;4\n;;\n",
        "# comment\n# time speed\ntime\tspeed\ns\tm/s\n2024-05-06T12:00:00Z\t1\n2024-05-06T12:00:01Z\tTRUE\n",
        "\"time\",\"speed\"\r\n\"0,5\",\"1,5\"\r\"1,5\",\"2\"\r\n",
    ]
    .iter()
    .flat_map(|text| {
        let wide = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        [text.as_bytes().to_vec(), wide]
    })
    .collect();
    survive(
        "csv",
        &files,
        &[None, Some("time = \"time\"\nspeed = \"speed * 2\"\n"), Some("[csv]\ncomment = \"#\"\nskip = 1\n")],
    );
}

#[test]
fn damaged_packed_text_files_never_panic() {
    let text = "time,speed,torque_left\n0,1,2\n1,2,3\n2,NA,4\n";
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    survive("csv.gz", &[encoder.finish().unwrap()], &[None]);
    survive("csv.zst", &[zstd::encode_all(text.as_bytes(), 3).unwrap()], &[None]);
}

#[test]
fn damaged_parquet_files_never_panic() {
    survive("parquet", &[written("parquet")], &[None, Some("speed = \"speed\"\n")]);
}

#[test]
fn damaged_measurement_files_never_panic() {
    let gear = Channel { data: UNSIGNED, bits: 8, texts: vec![(0.0, "P"), (1.0, "D")], ..double("gear", "") };
    let rows = (0..20_u8).map(|k| [record(&[f64::from(k), 7.0]), vec![k % 2]].concat()).collect();
    let drive = || {
        Group::new(
            "drive",
            vec![time(), double("speed", "m/s")],
            (0..20).map(|k| record(&[f64::from(k), 1.0])).collect(),
        )
    };
    let events = || {
        Group::new("events", vec![time(), double("e", "rad")], (0..5).map(|k| record(&[f64::from(k), 1.0])).collect())
    };
    let order: Vec<usize> = (0..25).map(|k| usize::from(k % 5 == 4)).collect();
    let unsorted = || File::new().unsorted(&[drive(), events()], &order);
    let files = [
        File::new().group(&Group::new("", vec![time(), double("speed", "km/h"), gear], rows), &[100, 203]),
        unsorted(),
        unsorted().unfinished(),
    ];
    let mut files: Vec<Vec<u8>> = files.into_iter().map(|file| file.bytes).collect();
    files.push(written("mf4"));
    survive(
        "mf4",
        &files,
        &[
            None,
            Some("speed = \"speed\"\ne = { column = \"e\", between = \"linear\" }\n"),
            Some("speed = { column = 1, group = 0 }"),
        ],
    );
}

const DBC: &str = "VERSION \"\"\nNS_ :\nBS_:\nBU_: E\nBO_ 256 Motion: 8 E\n SG_ Speed : 7|16@0+ (0.01,0) [0|300] \"km/h\" E\n \
                   SG_ Which M : 16|8@1+ (1,0) [0|3] \"\" E\n SG_ Left m0 : 24|33@1- (0.5,0) [0|0] \"N.m\" E\n";

#[test]
fn damaged_bus_logs_never_panic() {
    let map = "speed = \"Motion.Speed\"\ntorque_left = \"Motion/Left\"\n[can]\ndbc = \"car.dbc\"\n";
    let dump: String = (0..20)
        .map(|k| format!("({k}.5) can0 100#0{}112233445566\n({k}.7)  can0  100   [2]  2A 36\n", k % 10))
        .collect();
    survive("log", &[dump.into_bytes()], &[None, Some(map)]);
    let asc: String = (0..20)
        .map(|k| format!("{k}.501 1  100  Rx   d 8 09 08 07 06 05 04 03 02\n{k}.6 CANFD 1 Rx 100 1 0 8 2 01 02\n"))
        .collect();
    survive("asc", &[format!("base hex  timestamps absolute\n{asc}").into_bytes()], &[None, Some(map)]);
    survive("blf", &[blf()], &[None, Some(map)]);
}

/// A BLF file with ten frames in a packed container.
fn blf() -> Vec<u8> {
    let object = |kind: u32, head: &[u8], body: &[u8]| {
        let head_size = (16 + head.len()) as u16;
        let size = (16 + head.len() + body.len()) as u32;
        [b"LOBJ", &head_size.to_le_bytes()[..], &[1, 0], &size.to_le_bytes(), &kind.to_le_bytes(), head, body].concat()
    };
    let frame = |k: u64| {
        let head = [&2_u32.to_le_bytes()[..], &[0; 4], &(k * 1_000_000).to_le_bytes()].concat();
        object(1, &head, &[&[1, 0, 0, 8][..], &256_u32.to_le_bytes(), &[k as u8; 8]].concat())
    };
    let frames: Vec<u8> = (0..10).flat_map(frame).collect();
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&frames).unwrap();
    let head = [&2_u16.to_le_bytes()[..], &[0; 6], &(frames.len() as u32).to_le_bytes(), &[0; 4]].concat();
    let container = object(10, &head, &encoder.finish().unwrap());
    let mut header = vec![0; 144];
    header[..8].copy_from_slice(b"LOGG\x90\0\0\0");
    [header, container].concat()
}

#[test]
fn frames_of_a_packed_container_are_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.blf");
    std::fs::write(&path, blf()).unwrap();
    std::fs::write(folder.path().join("car.dbc"), DBC).unwrap();
    let map = folder.path().join("map.toml");
    std::fs::write(&map, "speed = \"Motion.Speed\"\n[can]\ndbc = \"car.dbc\"\n").unwrap();
    let map = ColumnMap::read(&map).unwrap();
    let log = Log::read(&path, Some(&map), &Progress::none()).unwrap();
    assert_eq!(log.time, (0..10).map(|k| f64::from(k) / 1000.0).collect::<Vec<_>>());
    // Big-endian 16 bits of equal bytes k: 257 k hundredths of km/h.
    for (k, speed) in log.channel("speed").unwrap().iter().enumerate() {
        assert!((speed - 2.57 * k as f64 / 3.6).abs() < 1e-12, "{speed}");
    }
}

/// The same recording with its chunks packed.
fn packed(plain: &[u8]) -> Vec<u8> {
    let mut file = plain[..8].to_vec();
    let mut rest = &plain[8..plain.len() - 8];
    while !rest.is_empty() {
        let length = u64::from_le_bytes(*rest[1..].first_chunk().unwrap()) as usize;
        let body = &rest[9..9 + length];
        let body = match rest[0] {
            // A chunk: times, size and checksum (28 bytes), the name of the packing, and the records with their length.
            6 => {
                let records = zstd::encode_all(&body[40..], 3).unwrap();
                let size = (records.len() as u64).to_le_bytes();
                [&body[..24], &[0; 4], &4_u32.to_le_bytes(), b"zstd", &size, &records].concat()
            }
            _ => body.to_vec(),
        };
        file.push(rest[0]);
        file.extend_from_slice(&(body.len() as u64).to_le_bytes());
        file.extend_from_slice(&body);
        rest = &rest[9 + length..];
    }
    file.extend_from_slice(&plain[..8]);
    file
}

/// A recording with one topic in small chunks.
fn mcap() -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(200));
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let definition = b"std_msgs/Header header\nfloat64 v\nstring s\nfloat64[] list\n";
    let schema = writer.add_schema("a/msg/B", "ros2msg", definition).unwrap();
    let channel = writer.add_channel(schema, "/b", "cdr", &std::collections::BTreeMap::new()).unwrap();
    for k in 0..20_u32 {
        // Header: stamp and an empty frame name; then the number at a multiple of eight, text and list.
        let mut data = vec![0, 1, 0, 0];
        for word in [1000 + k, 0, 1, 0] {
            data.extend_from_slice(&word.to_le_bytes());
        }
        data.extend_from_slice(&f64::from(k).to_le_bytes());
        for word in [1, 0, 2, 0] {
            data.extend_from_slice(&u32::to_le_bytes(word));
        }
        data.truncate(data.len() - 4);
        data.resize(4 + (data.len() - 4).next_multiple_of(8), 0);
        data.extend_from_slice(&[f64::from(k).to_le_bytes(), 7.0_f64.to_le_bytes()].concat());
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: k,
            log_time: k.into(),
            publish_time: k.into(),
        };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn damaged_recordings_never_panic() {
    let map = "speed = \"/b.v\"\ntorque_left = \"/b.list[1]\"\n";
    let files = vec![mcap(), packed(&mcap())];
    survive("mcap", &files, &[None, Some(map)]);
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let map = ColumnMap::parse("map.toml", map).unwrap();
    for file in &files {
        std::fs::write(&path, file).unwrap();
        let log = Log::read(&path, Some(&map), &Progress::none()).unwrap();
        assert_eq!(log.channel("speed"), Some(&(0..20).map(f64::from).collect::<Vec<_>>()[..]));
        assert_eq!((log.channel("torque_left"), log.time[1]), (Some(&[7.0; 20][..]), 1001.0));
    }
}
