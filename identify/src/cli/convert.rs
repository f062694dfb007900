//! `identify convert`.

use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

const GRAMMAR: &str = "\
The result has a column `time` and the columns of the FMU's inputs, in SI units; columns that the map
does not use follow under their own names. A missing sample is `nan`. What was guessed, repaired or left out
is said on stderr, one line each.

Column maps are TOML files; each key is a channel, its value says where the channel comes from:

  time = \"t_ms\"                                     a column; without unit the one that the file states
  speed = { column = \"v\", unit = \"km/h\" }            (scale * column + offset), read in unit, turned into SI
  speed = \"(v_rl + v_rr) / 2\"                       arithmetic over columns: + - * / ^ < <= > >= == != && || !
                                                     abs sqrt sin cos missing(x); {odd name} in braces
  speed = [\"v_gps\", \"v_can\"]                        the first column that exists
  speed = { column = \"n\", unit = \"rpm\", radius = 0.31 }            rotation to motion by a radius in m
  encoder_left = { column = \"n_rl\", unit = \"rpm\", integrate = true }    speed to angle; differentiate = true: back
  torque_left = { column = \"m\", scale = 4.8, unit = \"N.m\", missing_if = \"v < 3 || brake > 0\" }
  accel_x = { column = \"ax\", optional = true }      left out if the log has no such column
  slope = { value = 0 }                              a constant
  missing_if = \"gear == 0\"                          a condition for all channels

Groups with clocks of their own (groups of MDF4, topics, CAN messages):

  speed = \"engine/speed\"                            group and column; the same as
  speed = { column = \"speed\", group = 1 }           by place, counted from 0; column = 3 does so, too
  time = \"engine/time\"                              whose clock counts (else that of the group with most samples)
  speed = { column = \"speed\", between = \"hold\" }   what stands between the samples of a slower group:
                                                     missing (default), hold, nearest or linear

Topics of MCAP recordings and signals of CAN logs (.blf, .asc, candump's .log), which are read only if they are named:

  speed = \"/odom.twist.twist.linear.x\"              topic and field; a list's element: /joint_states.position[2]
  speed = \"ESP_21.ESP_v_Signal\"                     message and signal of the database
  [mcap]
  time = \"header\"                                   the stamps in messages (default where all have them), or
                                                     \"log\" or \"publish\"
  [can]
  dbc = [\"car.dbc\"]   channel = 1                     databases, relative to the map; the bus if there are several

Another file on the clock of the log (time + offset), {stem} being the log's name:

  join = [{ file = \"{stem}_gps.csv\", time = \"t\", offset = -0.35, as = \"gps\" }]

What is guessed of CSV files, if it must be told:

  [csv]
  separator = \";\"   decimal = \",\"   comment = \"#\"   skip = 2   units = true
  encoding = \"latin-1\"   missing = [\"-999\"]

Examples:
  identify convert nursing-robot trip.csv --columns bmw_i3.toml --out ride.csv
  identify convert wheelchair run.mf4 --out run.csv";

#[derive(Debug, Args)]
#[command(after_help = GRAMMAR)]
pub(super) struct ConvertArgs {
    /// The machine whose inputs the columns are checked against.
    #[arg(value_parser = vehicle_parser())]
    vehicle: &'static Vehicle,
    #[command(flatten)]
    logs: LogArgs,
    /// The log to write: .csv, .parquet or .mf4.
    #[arg(long, value_name = "LOG")]
    out: PathBuf,
}

pub(super) fn run(args: &ConvertArgs) -> Result<Outcome, Refusal> {
    keep_inputs(Some(&args.out), &args.logs.logs)?;
    Outputs::check(&args.out)?;
    let logs = read_logs(args.vehicle, &args.logs, &Progress::terminal())?;
    let [log] = logs.as_slice() else {
        return Err(Refusal(format!("convert takes one log at a time, not {}", logs.len())));
    };
    let mut outputs = Outputs::new();
    outputs.file(&args.out, |file| log.write(&args.out, file))?;
    outputs.commit()?;
    print(&format!("{}: {} samples, {} channels\n", args.out.display(), log.len(), log.channels.len()));
    Ok(Outcome::Done)
}
