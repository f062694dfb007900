//! Writing MDF4 with the `mf4-rs` library.

use crate::Log;
use mf4_rs::blocks::common::DataType;
use mf4_rs::error::MdfError;
use mf4_rs::writer::MdfWriter;
use std::io::{Seek, Write};

/// Writes one channel group of doubles.
pub(crate) fn write(log: &Log, to: impl Write + Seek + Send + 'static) -> Result<(), MdfError> {
    let mut writer = MdfWriter::new_from_writer(std::io::BufWriter::new(to));
    writer.init_mdf_file()?;
    let group = writer.add_channel_group(None, |_| {})?;
    let double = |name: &str| {
        let name = name.to_owned();
        move |block: &mut mf4_rs::blocks::channel_block::ChannelBlock| {
            block.data_type = DataType::FloatLE;
            block.bit_count = 64;
            block.name = Some(name);
        }
    };
    let master = writer.add_channel(&group, None, double("time"))?;
    writer.set_time_channel(&master)?;
    let mut last = master;
    for channel in &log.channels {
        last = writer.add_channel(&group, Some(&last), double(&channel.name))?;
    }
    writer.start_data_block_for_cg(&group, 0)?;
    let mut columns = vec![log.time.as_slice()];
    columns.extend(log.channels.iter().map(|channel| channel.values.as_slice()));
    writer.write_columns_f64(&group, &columns)?;
    writer.finish_data_block(&group)?;
    writer.finalize()
}
