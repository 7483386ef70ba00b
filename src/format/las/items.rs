//! The items of a compressed point, from the compressor's record.

use std::path::Path;

use super::super::Error;
use super::super::source::Source;

/// User name and number of the compressor's record.
const USER: [u8; 16] = *b"laszip encoded\0\0";
const NUMBER: u16 = 22204;
/// Bytes of the record before the number of items.
const BEFORE_ITEMS: u64 = 32;
/// Most bytes per point beyond its format. The decoder keeps some thousand bytes of statistics per byte.
const MOST_EXTRA: u16 = 1024;

/// Checks that the compressed items add up to a point of `record` bytes, of which the format defines `of_format`: the
/// decoder allocates memory by the items. `records` records begin after `header` bytes.
pub(super) fn check(file: &Path, header: u64, records: u32, record: u16, of_format: u16) -> Result<(), Error> {
    let mut source = Source::open(file)?;
    if record - of_format > MOST_EXTRA {
        let problem = format_args!(
            "is {record}, {} more than the format has; compressed points have at most {MOST_EXTRA} such bytes here: \
             decompress the scan, or leave its extra dimensions out",
            record - of_format
        );
        return Err(source.error(105, "point record length", problem));
    }
    source.skip(header, "header")?;
    for k in 0..records {
        source.skip(2, format_args!("record {k}"))?;
        let user = source.array::<16>(format_args!("user of record {k}"))?;
        let number = u16::from_le_bytes(source.array(format_args!("number of record {k}"))?);
        let bytes = u64::from(u16::from_le_bytes(source.array(format_args!("length of record {k}"))?));
        source.skip(32, format_args!("description of record {k}"))?;
        if user != USER || number != NUMBER {
            source.skip(bytes, format_args!("record {k}"))?;
            continue;
        }
        source.skip(BEFORE_ITEMS, "record of the compressor")?;
        let items = u16::from_le_bytes(source.array("compressed items")?);
        let mut sum = 0u64;
        for item in 0..items {
            source.skip(2, format_args!("type of item {item}"))?;
            let at = source.at();
            let size = u16::from_le_bytes(source.array(format_args!("size of item {item}"))?);
            source.skip(2, format_args!("version of item {item}"))?;
            sum += u64::from(size);
            if sum > u64::from(record) {
                let problem = format_args!("is {size}: items have more bytes than a point, which has {record}");
                return Err(source.error(at, format_args!("size of item {item}"), problem));
            }
        }
        return Ok(());
    }
    Err(source.error(
        header,
        "records",
        "none is the compressor's, and the point format says that points are compressed",
    ))
}
