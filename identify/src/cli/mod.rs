//! The command line: what each command takes, and its exit code.

mod check;
mod convert;
mod design;
mod fit;
mod human;
mod maps;
mod run;
mod settings;
mod simulate;
mod tune;
mod words;

use crate::log::{Input, Log, LogError};
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;

/// Fits physical parameters of wheeled machines from logs, tunes filter noise, simulates logs.
#[derive(Debug, Parser)]
#[command(name = "identify", version, max_term_width = 100)]
#[command(after_help = "\
Exit codes:
  0  done
  1  done with warnings (a parameter is not identified or sits at a bound, or something contradicts the result)
  2  refused; one line on stderr says why and no output file is written, except that --out of a fit whose logs were
     read tells what was read and what is wrong

Logs are CSV, Parquet, MDF4, MCAP or CAN files (.csv, .csv.gz, .csv.zst, .parquet, .mf4, .mcap,
.blf, .asc, .log) with a column `time` in s and columns named as the FMU's inputs, in SI units or
with units that the file states. --columns reads logs with other names and units.

Examples:
  identify simulate nursing-robot --scenario identification --seed 1 --out log.csv
  identify fit nursing-robot log.csv --out fit.json --report fit.html
  identify fit nursing-robot trip*.csv --columns map.toml --only robot.mass,rolling.coefficient")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Look for wrong units, signs, delays and dead channels in logs before anything is fitted to them.
    Check(check::CheckArgs),
    /// Fit physical parameters from logs by convex optimisation.
    Fit(Box<fit::FitArgs>),
    /// Tune the filter's noise settings by replaying logs.
    Tune(tune::TuneArgs),
    /// Run an estimator over logs at native speed: estimates, innovations, verdicts.
    Run(run::RunArgs),
    /// Make a log with a built-in plant; its true_* columns hold the truth.
    Simulate(simulate::SimulateArgs),
    /// Say what to drive next: manoeuvres compared by the intervals that a fit with them would have.
    Design(design::DesignArgs),
    /// Rewrite a log with the names and units of the FMU's inputs, for fmpy and other tools.
    Convert(convert::ConvertArgs),
    /// Estimate every quantity of a body over a whole log.
    Estimate(human::EstimateArgs),
    /// Measure the time of an estimation step.
    Bench(human::BenchArgs),
}

/// The logs of a command and how to read them.
#[derive(Debug, Args)]
struct LogArgs {
    /// Logs: .csv, .parquet, .mf4, .mcap, .blf, .asc or .log.
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Column map for logs with other names, units or missing samples (`identify convert --help` has the grammar);
    /// repeatable as PATTERN=MAP.toml for logs whose file names fit the pattern, as in 'trip*.csv=car.toml'.
    #[arg(long, value_name = "[PATTERN=]MAP.toml")]
    columns: Vec<String>,
}

/// How a command ended that did its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Done,
    Warnings,
    /// What was asked for was done, and its answer is that the logs cannot be used.
    Refused,
}

/// Why a command was refused: one line.
#[derive(Debug)]
struct Refusal(String);

impl<E: std::error::Error> From<E> for Refusal {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

/// What the program calls itself in messages and in its help, if not [`NAME`].
static PROGRAM: OnceLock<&'static str> = OnceLock::new();

/// What the program is called in this package.
const NAME: &str = "identify";

/// What the program calls itself.
fn program() -> &'static str {
    PROGRAM.get().copied().unwrap_or(NAME)
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    ExitCode::from(run(NAME, std::env::args_os(), &[]))
}

/// Runs a command line, the program's name first, and gives the exit code.
///
/// The program calls itself `name`; the first call of a process decides. `others` are further commands with a line about
/// each, which the caller carries out: here they only stand in the help.
pub fn run(
    name: &'static str,
    arguments: impl IntoIterator<Item = OsString>,
    others: &[(&'static str, &'static str)],
) -> u8 {
    PROGRAM.get_or_init(|| name);
    crate::log::guard::quiet();
    let matches = command(others).try_get_matches_from(arguments);
    let cli = match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            eprintln!("{}: {}", program(), usage(&error.to_string()));
            return 2;
        }
        Err(help) => {
            let _ = help.print(); // a reader that has gone away is no error
            return 0;
        }
    };
    let outcome = match cli.command {
        Command::Check(args) => check::run(&args),
        Command::Fit(args) => fit::run(&args),
        Command::Tune(args) => tune::run(&args),
        Command::Run(args) => run::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Design(args) => design::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Estimate(args) => human::estimate(&args),
        Command::Bench(args) => human::bench(&args),
    };
    match outcome {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::Warnings) => 1,
        Ok(Outcome::Refused) => 2,
        Err(Refusal(line)) => {
            eprintln!("{}: {}", program(), line.replace(['\n', '\r'], " "));
            2
        }
    }
}

/// The parser, with the program's present name in the texts of its help.
fn command(others: &[(&'static str, &'static str)]) -> clap::Command {
    let renamed = |text: &clap::builder::StyledStr| text.to_string().replace("identify ", &format!("{} ", program()));
    let in_arguments = |argument: clap::Arg| match argument.get_help().map(renamed) {
        Some(help) => argument.help(help),
        None => argument,
    };
    let in_command = |command: clap::Command| {
        let after = command.get_after_help().map(renamed);
        let command = command.mut_args(in_arguments);
        if let Some(after) = after { command.after_help(after) } else { command }
    };
    let all = Cli::command().name(program()).bin_name(program());
    let all = others.iter().fold(all, |all, (name, about)| all.subcommand(clap::Command::new(*name).about(*about)));
    in_command(all).mut_subcommands(in_command)
}

/// What is wrong with the command line, in one line: the first paragraph of the parser's text.
fn usage(text: &str) -> String {
    let lines = text.lines().map(str::trim).take_while(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join(" ").trim_start_matches("error: ").to_owned() + "; --help shows the usage"
}

/// Prints to stdout; a reader that has gone away is no error.
fn print(text: &str) {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Reads all logs of a command and checks the maps against the vehicle's inputs.
fn read_logs(
    vehicle: &Vehicle,
    args: &LogArgs,
    keep: &dyn Fn(&str) -> bool,
    progress: &Progress,
) -> Result<Vec<Log>, Refusal> {
    let mut logs = Vec::with_capacity(args.logs.len());
    read_each(vehicle, args, keep, progress, |_, log| {
        logs.push(log?);
        Ok(())
    })?;
    tell(&logs);
    Ok(logs)
}

/// Reads the logs of a command one by one; `keep` says which other columns than the vehicle's inputs.
fn read_each(
    vehicle: &Vehicle,
    args: &LogArgs,
    keep: &dyn Fn(&str) -> bool,
    progress: &Progress,
    mut take: impl FnMut(&Path, Result<Log, LogError>) -> Result<(), Refusal>,
) -> Result<(), Refusal> {
    let maps = maps::Maps::read(vehicle, &args.columns)?;
    let inputs = vehicle.inputs();
    let inputs: Vec<_> = inputs.iter().map(|input| Input { name: &input.name, unit: input.unit }).collect();
    for path in &args.logs {
        let log = Log::read_inputs(path, maps.of(path)?, &inputs, keep, progress);
        if let Err(LogError::Interrupted(stop)) = log {
            return Err(stop.into());
        }
        take(path, log)?;
    }
    Ok(())
}

/// Says what was detected, repaired or left out of logs; what holds for several of them in one line.
fn tell(logs: &[Log]) {
    let mut notes: Vec<(&str, Vec<&str>)> = Vec::new();
    for log in logs {
        for note in &log.notes {
            match notes.iter_mut().find(|(other, _)| *other == note) {
                Some((_, sources)) => sources.push(&log.source),
                None => notes.push((note, vec![&log.source])),
            }
        }
    }
    for (note, sources) in notes {
        let logs = match sources.as_slice() {
            [first, _, _, ..] => format!("{first} and {} other logs", sources.len() - 1),
            few => few.join(" and "),
        };
        eprintln!("{}: note: {logs}: {}", program(), note.replace(['\n', '\r'], " "));
    }
}

/// Refuses an output that would replace one of the inputs.
fn keep_inputs(output: Option<&Path>, inputs: &[PathBuf]) -> Result<(), Refusal> {
    let Some(output) = output else { return Ok(()) };
    let real = std::fs::canonicalize(output).ok();
    if inputs.iter().any(|input| real.is_some() && std::fs::canonicalize(input).ok() == real) {
        return Err(Refusal(format!("{}: is an input and would be overwritten", output.display())));
    }
    Ok(())
}
