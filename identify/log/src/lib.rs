//! Recorded or simulated logs: uniform in memory whatever file they came from; and what programs that
//! read and write them share: [`progress`] of long work and [`output`] files that appear whole.
//!
//! [`Log::read`] takes CSV, Parquet and MDF4 by file ending, applies a column map and checks what
//! every later step relies on: finite, strictly increasing times and at least two samples.
// A build without some of the formats leaves helpers unused that the others share.
#![cfg_attr(not(all(feature = "can", feature = "parquet", feature = "mf4", feature = "mcap")), allow(dead_code))]

mod assemble;
mod between;
#[cfg(feature = "can")]
mod can;
pub mod columns;
mod compact;
mod csv;
mod error;
pub mod guard;
mod hash;
#[cfg(feature = "mcap")]
mod mcap;

#[cfg(feature = "mf4")]
mod mf4;
pub mod output;
#[cfg(feature = "parquet")]
mod parquet;
pub mod progress;
mod recording;
mod sampling;
mod selection;
mod series;
mod store;
mod table;
mod wanted;

pub use columns::{ColumnMap, listed};
pub use error::LogError;
pub use selection::median;
pub use series::Series;
pub use store::{LONG, Store};
pub use table::{Samples, TableColumn};

use crate::progress::Progress;
use std::path::Path;
use wanted::Wanted;

/// A log: one time base and named channels of the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    /// Where it came from: the file's path, or the scenario.
    pub source: String,
    /// SHA-256 of the file, hexadecimal; empty if it never was a file.
    pub sha256: String,
    /// Sample times, s, increasing.
    pub time: Series,
    /// The channels, named as the FMU's inputs; `true_*` are references for reports.
    pub channels: Vec<Channel>,
    /// What was detected, repaired or left out while reading, one line each.
    pub notes: Vec<String>,
    /// Names of columns that were not read because nothing asked for them.
    pub unread: Vec<String>,
}

/// A channel that a log is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Input<'a> {
    /// Name of the channel.
    pub name: &'a str,
    /// SI unit of its values, in the FMI spelling.
    pub unit: &'a str,
}

/// One channel of a [`Log`]. NaN is a missing sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name, as the FMU's input.
    pub name: String,
    /// One value per sample, SI units.
    pub values: Series,
}

/// The file formats, by file ending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Csv,
    Parquet,
    Mf4,
    Mcap,
    Blf,
    Asc,
    Candump,
}

impl Format {
    fn of(path: &Path) -> Result<Self, LogError> {
        let fail = |what: &str| Err(LogError::file(&path.display().to_string(), what));
        let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let mut endings = name.rsplit('.');
        let ending = endings.next().unwrap_or_default();
        match ending {
            "csv" | "tsv" => Ok(Self::Csv),
            "parquet" => Ok(Self::Parquet),
            "mf4" | "mdf" => Ok(Self::Mf4),
            "mcap" => Ok(Self::Mcap),
            "blf" => Ok(Self::Blf),
            "asc" => Ok(Self::Asc),
            "log" | "candump" => Ok(Self::Candump),
            "gz" | "zst" if matches!(endings.next(), Some("csv" | "tsv")) => Ok(Self::Csv),
            "gz" | "zip" | "bz2" | "xz" | "zst" | "7z" => {
                fail("is compressed; unpack it first (.csv.gz and .csv.zst are read as they are)")
            }
            "mf3" | "dat" => {
                fail("MDF 3 or another older format of measurement files; asammdf, for example, converts it to MDF 4")
            }
            "bag" => fail("a bag of ROS 1; `rosbags-convert` makes it MCAP"),
            "db3" => fail("a rosbag2 file in SQLite storage; `ros2 bag convert` makes it MCAP"),
            "mat" | "h5" | "hdf5" => fail("MATLAB or HDF5 data; save them as CSV or Parquet"),
            "xls" | "xlsx" | "ods" => fail("a spreadsheet; save it as CSV"),
            "tdms" | "arrow" | "feather" | "ulg" | "tlog" => {
                fail("a format that is not read; save it as CSV or Parquet")
            }
            _ => fail(&format!("unknown ending; {ENDINGS} is expected")),
        }
    }

    /// The format to write: nothing is packed, and no older format is written.
    fn written(path: &Path) -> Result<Self, LogError> {
        match path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("parquet") => Ok(Self::Parquet),
            Some("mf4") => Ok(Self::Mf4),
            _ => {
                let reason = "unknown ending; .csv, .parquet or .mf4 is expected";
                Err(LogError::file(&path.display().to_string(), reason))
            }
        }
    }
}

/// The endings of files that are read.
const ENDINGS: &str = ".csv, .csv.gz, .csv.zst, .parquet, .mf4, .mcap, .blf, .asc or .log";

impl Log {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample at all.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The values of a channel, if the log has it.
    pub fn channel(&self, name: &str) -> Option<&[f64]> {
        self.channels.iter().find(|channel| channel.name == name).map(|channel| channel.values.as_slice())
    }

    /// The same, shared with the log.
    pub fn series(&self, name: &str) -> Option<Series> {
        self.channels.iter().find(|channel| channel.name == name).map(|channel| channel.values.clone())
    }

    /// The names of all channels and of the columns that were not read.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.channels.iter().map(|channel| channel.name.as_str()).chain(self.unread.iter().map(String::as_str))
    }

    /// The values of a channel, or an error that names the log and channels with similar names.
    pub fn require(&self, name: &str) -> Result<&[f64], LogError> {
        self.channel(name).ok_or_else(|| {
            let names: Vec<_> = self.names().filter(|name| !name.starts_with("true_")).collect();
            LogError::file(&self.source, format!("no channel '{name}'; {}", columns::hint(name, &names)))
        })
    }

    /// Puts the samples into a file, of which they are read again where they are looked at, see [`Series`].
    pub fn put_away(&mut self, store: &Store) -> Result<(), LogError> {
        let put_away = self.series_mut().try_for_each(|series| series.put_away(store));
        put_away.map_err(|error| LogError::file(&self.source, error.to_string()))
    }

    fn series_mut(&mut self) -> impl Iterator<Item = &mut Series> {
        std::iter::once(&mut self.time).chain(self.channels.iter_mut().map(|channel| &mut channel.values))
    }

    /// Adds a channel; all channels have as many values as there are times.
    pub fn push(&mut self, name: &str, values: impl Into<Series>) {
        let values = values.into();
        debug_assert_eq!(values.len(), self.len());
        self.channels.push(Channel { name: name.to_owned(), values });
    }

    /// Reads a log; the extension of the file gives its format.
    ///
    /// Without a column map the file has a column `time` in s, and every column of a text file must be numeric.
    /// With one, the mapped channels come first and columns that the map does not use follow under
    /// their own names, as far as they are numeric.
    /// Infinite samples become missing ones.
    ///
    /// ```
    /// use wheelstate_log::progress::Progress;
    /// use wheelstate_log::{ColumnMap, Log};
    ///
    /// let path = std::env::temp_dir().join(format!("wheelstate-{}.csv", std::process::id()));
    /// std::fs::write(&path, "t;v [km/h]\n0;3,6\n0,01;\n0,02;7,2\n")?;
    /// let map = ColumnMap::parse("map.toml", "time = 't'\nspeed = 'v'")?;
    /// let log = Log::read(&path, Some(&map), &Progress::none())?;
    /// let speed = log.require("speed")?; // m/s; the empty cell is a missing sample
    /// assert!(log.time == [0.0, 0.01, 0.02] && speed[0] == 1.0 && speed[1].is_nan() && speed[2] == 2.0);
    /// # std::fs::remove_file(path)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn read(path: &Path, map: Option<&ColumnMap>, progress: &Progress) -> Result<Self, LogError> {
        let mut log = Self::read_verbatim(path, map, progress)?;
        log.drop_infinite();
        Ok(log)
    }

    /// As [`read`](Self::read), for a program that knows which channels it needs: their units are checked, and what is
    /// wrong with other columns never refuses the file. Of these only those are read that `keep` says, by their names:
    /// a recording may have thousands of columns, and time and memory are those of the columns that are read. `|_| true`
    /// keeps them all.
    pub fn read_inputs(
        path: &Path,
        map: Option<&ColumnMap>,
        inputs: &[Input],
        keep: &dyn Fn(&str) -> bool,
        progress: &Progress,
    ) -> Result<Self, LogError> {
        let wanted = Wanted::new(map, inputs, keep);
        let mut log = Self::read_any(path, map, Some(inputs), &wanted, progress)?;
        log.drop_infinite();
        Ok(log)
    }

    /// As [`read`](Self::read), with infinite samples as they are: for a program that hands them on.
    pub fn read_verbatim(path: &Path, map: Option<&ColumnMap>, progress: &Progress) -> Result<Self, LogError> {
        Self::read_any(path, map, None, &Wanted::all(), progress)
    }

    fn read_any(
        path: &Path,
        map: Option<&ColumnMap>,
        inputs: Option<&[Input]>,
        wanted: &Wanted,
        progress: &Progress,
    ) -> Result<Self, LogError> {
        Self::finish(record(path, map, wanted, progress)?, path, map, inputs, wanted, progress)
    }

    /// Joins the files that the map names and puts the log together; `path` is the log's.
    fn finish(
        mut recording: recording::Recording,
        path: &Path,
        map: Option<&ColumnMap>,
        inputs: Option<&[Input]>,
        wanted: &Wanted,
        progress: &Progress,
    ) -> Result<Self, LogError> {
        for join in map.iter().flat_map(|map| &map.joins) {
            let map = map.expect("its joins");
            let other = map.path(&join.path(path));
            let joined = record(&other, Some(map), wanted, progress)?;
            assemble::join(&mut recording, joined, join, map)?;
        }
        assemble::assemble(recording, map, inputs)
    }

    /// Reads a log in CSV from any bytes; `name` is named in errors.
    pub fn from_csv(name: &str, from: impl std::io::Read, map: Option<&ColumnMap>) -> Result<Self, LogError> {
        let options = map.map(|map| map.csv.clone()).unwrap_or_default();
        let recording = csv::parse(name, (hash::Hashed::new(from), 0), &options, &Wanted::all(), &Progress::none())?;
        let mut log = assemble::assemble(recording, map, None)?;
        log.drop_infinite();
        Ok(log)
    }

    fn drop_infinite(&mut self) {
        let some = |values: &Series| values.may_be_infinite() && values.pieces().any(|piece| any_infinite(&piece));
        for channel in self.channels.iter_mut().filter(|channel| some(&channel.values)) {
            channel.values.iter_mut().filter(|value| value.is_infinite()).for_each(|value| *value = f64::NAN);
            // A file that has no room for the column leaves it in memory.
            let _ = recording::Shelf::default().put_away(&mut channel.values);
        }
    }

    /// Writes a log in CSV to anything; every number reads back as the same bits.
    pub fn write_csv(&self, to: impl std::io::Write) -> std::io::Result<()> {
        csv::write(self, to)
    }

    /// Writes a log in the format that the extension of `path` gives; the bytes go to `to`, full precision.
    pub fn write(&self, path: &Path, to: impl std::io::Write + std::io::Seek + Send + 'static) -> Result<(), LogError> {
        let failed = |e: &dyn std::fmt::Display| LogError::file(&path.display().to_string(), e.to_string());
        match Format::written(path)? {
            Format::Csv => csv::write(self, to).map_err(|e| failed(&e)),
            #[cfg(feature = "parquet")]
            Format::Parquet => parquet::write(self, to).map_err(|e| failed(&e)),
            #[cfg(feature = "mf4")]
            Format::Mf4 => mf4::write(self, to).map_err(|e| failed(&e)),
            #[allow(unreachable_patterns)]
            _ => Err(failed(&"this build cannot write this kind of file")),
        }
    }
}

/// Whether a number is infinite: by the largest ones of eight that stand side by side, which the processor takes together.
fn any_infinite(values: &[f64]) -> bool {
    let larger = |a: f64, b: &f64| if b.abs() > a { b.abs() } else { a };
    let (eights, rest) = values.as_chunks::<8>();
    let largest = eights.iter().fold([0.0; 8], |most, eight| std::array::from_fn(|k| larger(most[k], &eight[k])));
    largest.iter().chain(rest).fold(0.0, larger).is_infinite()
}

/// Reads a file as it is, of its columns those that are wanted; formats of messages read theirs later.
fn record(
    path: &Path,
    map: Option<&ColumnMap>,
    wanted: &Wanted,
    progress: &Progress,
) -> Result<recording::Recording, LogError> {
    match Format::of(path)? {
        Format::Csv => csv::read(path, &map.map(|map| map.csv.clone()).unwrap_or_default(), wanted, progress),
        #[cfg(feature = "parquet")]
        Format::Parquet => parquet::read(path, wanted, progress),
        #[cfg(feature = "mf4")]
        Format::Mf4 => mf4::read(path, wanted, progress),
        #[cfg(feature = "mcap")]
        Format::Mcap => mcap::read(path, map.and_then(|map| map.stamps), progress),
        #[cfg(feature = "can")]
        Format::Blf => can::read(path, can::Kind::Blf, map, progress),
        #[cfg(feature = "can")]
        Format::Asc => can::read(path, can::Kind::Asc, map, progress),
        #[cfg(feature = "can")]
        Format::Candump => can::read(path, can::Kind::Candump, map, progress),
        #[allow(unreachable_patterns)]
        _ => Err(LogError::file(&path.display().to_string(), "this build cannot read this kind of file")),
    }
}
