//! `identify convert`.

use super::words::vehicle_parser;
use super::{LogArgs, Outcome, Refusal, keep_inputs, print, read_logs};
use crate::output::Outputs;
use crate::progress::Progress;
use crate::vehicle::Vehicle;
use clap::Args;
use std::path::PathBuf;

const GRAMMAR: &str = "\
The result has a column `time` and the columns of the FMU's inputs, in SI units; columns that the
map does not use follow under their own names. A missing sample is `nan`. What was detected, repaired
or left out is reported on stderr, one line each.

A column map is a TOML file; each key is a channel, its value says where the channel comes from:

  time = \"t_ms\"                                a column, in the unit that the file states
  speed = { column = \"v\", unit = \"km/h\" }      scale * column + offset, in unit, converted to SI
  speed = \"(v_rl + v_rr) / 2\"                  a formula over columns: + - * / ^ < <= > >= == !=
                                               && || ! abs sqrt sin cos missing(x); {odd name}
  speed = [\"v_gps\", \"v_can\"]                   the first column that exists
  speed = { column = \"n\", unit = \"rpm\", radius = 0.31 }
                                               rotation to motion by a radius in m
  encoder_left = { column = \"n_rl\", unit = \"rpm\", integrate = true }
                                               speed to angle; back with differentiate = true
  torque_left = { column = \"m\", scale = 4.8, unit = \"N.m\", missing_if = \"v < 3 || brake > 0\" }
  accel_x = { column = \"ax\", optional = true }
                                               left out if the log has no such column
  slope = { value = 0 }                        a constant
  missing_if = \"gear == 0\"                     a condition for all channels

Groups with clocks of their own (groups of MDF4, topics, CAN messages):

  speed = \"engine/speed\"                       group and column, or by number, counted from 0:
  speed = { column = \"speed\", group = 1 }      column = 3 works as well
  time = \"engine/time\"                         the clock of the result; without this line that of
                                               the group with the most samples
  speed = { column = \"speed\", between = \"hold\" }
                                               between the samples of a slower group: missing
                                               (default), hold, nearest or linear

Topics of MCAP recordings and signals of CAN logs (.blf, .asc, candump's .log) are read only if they
are named:

  speed = \"/odom.twist.twist.linear.x\"         topic and field
  angle = \"/joint_states.position[2]\"          an element of a list
  speed = \"ESP_21.ESP_v_Signal\"                message and signal of the database
  [mcap]
  time = \"header\"                              the stamps in the messages (default where all have
                                               them), or \"log\" or \"publish\"
  [can]
  dbc = [\"car.dbc\"]                            databases, relative to the map
  channel = 1                                  the bus, if there are several

Another file on the clock of the log (time + offset), {stem} being the log's name:

  join = [{ file = \"{stem}_gps.csv\", time = \"t\", offset = -0.35, as = \"gps\" }]

What is detected of CSV files, to be set where that is wrong:

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
    let logs = read_logs(args.vehicle, &args.logs, &|_| true, &Progress::terminal())?;
    let [log] = logs.as_slice() else {
        return Err(Refusal(format!("convert takes one log at a time, not {}", logs.len())));
    };
    let mut outputs = Outputs::new();
    outputs.file(&args.out, |file| log.write(&args.out, file))?;
    outputs.commit()?;
    print(&format!("{}: {} samples, {} channels\n", args.out.display(), log.len(), log.channels.len()));
    Ok(Outcome::Done)
}
