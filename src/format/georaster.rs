//! Grids of numbers on a map, read from GeoTIFF: surface models and orthophotos of this and other programs.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::contain::contained;
use super::{At, Error};

/// Most samples of a picture: a gibibyte as floats.
const MOST: u64 = 1 << 28;
/// Most samples per byte of a file. Deflate and LZW reach about a thousand.
const MOST_PER_BYTE: u64 = 2048;
/// The field of GDAL with the value of pixels without data.
const NO_DATA: u16 = 42_113;
/// The key of what a pixel's coordinates mean, and its value for the pixel's middle.
const RASTER_TYPE: u16 = 1025;
const POINT: u16 = 2;
/// The key of a projected system's EPSG code, and the value for systems without one.
const PROJECTED: u16 = 3072;
const USER_DEFINED: u16 = 32_767;

/// The value of the field of planes for bands one after the other.
const SEPARATE: u16 = 2;

/// A grid on a map, rows from the north.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoRaster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values of a pixel.
    pub bands: usize,
    /// Easting and northing of the north-western corner.
    pub corner: [f64; 2],
    /// Width and height of a pixel.
    pub pixel: [f64; 2],
    /// EPSG code of the reference system, if the file has one.
    pub epsg: Option<u32>,
    /// The values, those of a pixel beside each other; NaN without data.
    pub values: Vec<f32>,
}

impl GeoRaster {
    /// Reads a GeoTIFF without rotation, at its full size.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let opened = File::open(file).map_err(Error::io(file, "open"))?;
        let wrong = |problem: String| Error::malformed(file, "GeoTIFF", At::Byte(0), problem);
        contained(|| decoded(opened)).unwrap_or_else(Err).map_err(wrong)
    }

    /// The value of a band at a place, between the middles of pixels interpolated; NaN where a pixel has no data.
    pub fn at(&self, band: usize, [east, north]: [f64; 2]) -> f32 {
        let x = (east - self.corner[0]) / self.pixel[0] - 0.5;
        let y = (self.corner[1] - north) / self.pixel[1] - 0.5;
        let (last, lowest) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        // Half a pixel at the edge belongs to the picture.
        let inside = x >= -0.5 && y >= -0.5 && x <= last + 0.5 && y <= lowest + 0.5;
        if !inside {
            return f32::NAN;
        }
        let (x, y) = (x.clamp(0.0, last), y.clamp(0.0, lowest));
        let (left, top) = (x as usize, y as usize);
        let (u, v) = (x - left as f64, y - top as f64);
        let mut sum = 0.0;
        for (row, share) in [(top, 1.0 - v), (top + 1, v)] {
            for (column, of) in [(left, 1.0 - u), (left + 1, u)] {
                // What has no weight may be outside or without data.
                if share * of > 0.0 {
                    let at = (row * self.width + column) * self.bands + band;
                    sum += share * of * f64::from(self.values[at]);
                }
            }
        }
        sum as f32
    }
}

fn decoded(opened: File) -> Result<GeoRaster, String> {
    let bytes = opened.metadata().map_err(|error| error.to_string())?.len();
    let failed = |error: tiff::TiffError| error.to_string();
    let mut limits = Limits::default();
    limits.decoding_buffer_size = 4 * MOST as usize;
    let mut decoder = Decoder::new(BufReader::new(opened)).map_err(failed)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let bands = usize::from(decoder.colortype().map_err(failed)?.num_samples());
    let samples = u64::from(width) * u64::from(height) * bands as u64;
    if samples == 0 || samples > MOST {
        return Err(format!("{width} x {height} pixels of {bands} bands; at most {MOST} values can be taken in"));
    }
    if samples / MOST_PER_BYTE > bytes {
        return Err(format!("{width} x {height} pixels of {bands} bands cannot be in the {bytes} bytes of the file"));
    }
    let keys = decoder.find_tag(Tag::GeoKeyDirectoryTag).map_err(failed)?;
    let keys = keys.map(|keys| keys.into_u16_vec()).transpose().map_err(failed)?.unwrap_or_default();
    let key = |wanted: u16| keys.chunks_exact(4).skip(1).find(|key| key[0] == wanted && key[1] == 0).map(|key| key[3]);
    let mut doubles = |tag: Tag| -> Result<Option<Vec<f64>>, String> {
        let found = decoder.find_tag(tag).map_err(failed)?;
        found.map(|value| value.into_f64_vec()).transpose().map_err(failed)
    };
    let (scale, tie) = (doubles(Tag::ModelPixelScaleTag)?, doubles(Tag::ModelTiepointTag)?);
    let (corner, pixel) = match (scale.as_deref(), tie.as_deref(), doubles(Tag::ModelTransformationTag)?.as_deref()) {
        (Some([x, y, ..]), Some([column, row, _, east, north, ..]), _) => {
            ([east - column * x, north + row * y], [*x, *y])
        }
        (_, _, Some([x, turn, _, east, other, y, _, north, ..])) if *turn == 0.0 && *other == 0.0 => {
            ([*east, *north], [*x, -y])
        }
        (_, _, Some(_)) => return Err("its rows do not lie from west to east: turn it north up".to_owned()),
        _ => return Err("it has no place on a map: a GeoTIFF is needed".to_owned()),
    };
    let sound = corner.iter().chain(&pixel).all(|v| v.is_finite()) && pixel.iter().all(|v| *v > 0.0);
    if !sound {
        return Err("the size or the place of its pixels is no number".to_owned());
    }
    let shift = if key(RASTER_TYPE) == Some(POINT) { 0.5 } else { 0.0 };
    let corner = [corner[0] - shift * pixel[0], corner[1] + shift * pixel[1]];
    let text = decoder.find_tag(Tag::Unknown(NO_DATA)).map_err(failed)?;
    let text = text.and_then(|text| text.into_string().ok()).unwrap_or_default();
    let no_data = text.trim_end_matches('\0').trim().parse::<f64>().ok().map(|v| v as f32);
    let planar = decoder.find_tag(Tag::PlanarConfiguration).map_err(failed)?;
    let planar = planar.and_then(|value| value.into_u16().ok()) == Some(SEPARATE);
    let mut image = DecodingResult::F32(Vec::new());
    decoder.read_image_to_buffer(&mut image).map_err(failed)?;
    let mut values = floats(image)?;
    if bands > 1 && planar {
        let pixels = values.len() / bands;
        values = (0..values.len()).map(|k| values[k % bands * pixels + k / bands]).collect();
    }
    if values.len() as u64 != samples {
        return Err(format!("{} values where {samples} are needed", values.len()));
    }
    if let Some(no_data) = no_data {
        values.iter_mut().filter(|v| **v == no_data).for_each(|v| *v = f32::NAN);
    }
    let epsg = key(PROJECTED).filter(|code| *code != USER_DEFINED && *code != 0).map(u32::from);
    Ok(GeoRaster { width: width as usize, height: height as usize, bands, corner, pixel, epsg, values })
}

fn floats(image: DecodingResult) -> Result<Vec<f32>, String> {
    Ok(match image {
        DecodingResult::U8(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::U16(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::I8(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::I16(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::U32(values) => values.into_iter().map(|v| v as f32).collect(),
        DecodingResult::I32(values) => values.into_iter().map(|v| v as f32).collect(),
        DecodingResult::F32(values) => values,
        DecodingResult::F64(values) => values.into_iter().map(|v| v as f32).collect(),
        _ => return Err("its numbers are of a kind that is not read: 8 to 32 bits, or floats".to_owned()),
    })
}

#[cfg(test)]
mod tests {
    use tiff::encoder::TiffEncoder;
    use tiff::encoder::colortype::{ColorType, Gray32Float, RGBA8};

    use super::*;

    /// Writes a picture of 4 x 3 pixels with these fields.
    fn written<C: ColorType>(values: &[C::Inner], keys: &[u16], tie: &[f64], no_data: &str) -> tempfile::NamedTempFile
    where
        [C::Inner]: tiff::encoder::TiffValue,
    {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        let mut encoder = TiffEncoder::new(file.as_file_mut()).expect("an encoder");
        let mut image = encoder.new_image::<C>(4, 3).expect("a picture");
        let fields = image.encoder();
        fields.write_tag(Tag::ModelPixelScaleTag, &[0.5, 0.25, 0.0][..]).expect("written");
        if !tie.is_empty() {
            fields.write_tag(Tag::ModelTiepointTag, tie).expect("written");
        }
        fields.write_tag(Tag::GeoKeyDirectoryTag, keys).expect("written");
        fields.write_tag(Tag::Unknown(NO_DATA), no_data).expect("written");
        image.write_data(values).expect("written");
        file
    }

    const AREA: [u16; 12] = [1, 1, 0, 2, 1025, 0, 1, 1, 3072, 0, 1, 32_632];
    const TIE: [f64; 6] = [0.0, 0.0, 0.0, 500_000.0, 4_600_000.0, 0.0];

    #[test]
    fn heights_come_with_their_place_and_without_what_is_no_data() {
        let values: Vec<f32> = (0..12).map(|k| if k == 11 { -9999.0 } else { k as f32 }).collect();
        let file = written::<Gray32Float>(&values, &AREA, &TIE, "-9999");
        let found = GeoRaster::read(file.path()).expect("a grid");
        assert_eq!((found.width, found.height, found.bands, found.epsg), (4, 3, 1, Some(32_632)));
        assert_eq!((found.corner, found.pixel), ([500_000.0, 4_600_000.0], [0.5, 0.25]));
        assert!(found.values[11].is_nan() && found.values[10] == 10.0);
        // The middle of the first pixel, between four pixels, at the edge and outside.
        let at = |x: f64, y: f64| found.at(0, [500_000.0 + x, 4_600_000.0 - y]);
        assert_eq!([at(0.25, 0.125), at(0.5, 0.25), at(0.0, 0.0), at(1.25, 0.625)], [0.0, 2.5, 0.0, 10.0]);
        assert!([at(-0.01, 0.1), at(2.01, 0.1), at(0.1, 0.76), at(1.5, 0.6)].iter().all(|v| v.is_nan()));
    }

    #[test]
    fn places_of_middles_and_of_other_pixels_are_taken_as_meant() {
        let mut keys = AREA;
        keys[7] = POINT;
        let tie = [1.0, 2.0, 0.0, 500_000.5, 4_599_999.5, 0.0];
        let found = GeoRaster::read(written::<RGBA8>(&[7; 48], &keys, &tie, "0").path()).expect("a grid");
        assert_eq!((found.corner, found.bands), ([499_999.75, 4_600_000.125], 4));
    }

    #[test]
    fn pictures_without_a_place_and_damaged_ones_are_refused() {
        let values = [0.0; 12];
        for (tie, problem) in [(&[][..], "no place on a map"), (&[0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0][..], "no number")]
        {
            let file = written::<Gray32Float>(&values, &AREA, tie, "x");
            let error = GeoRaster::read(file.path()).expect_err("refused").to_string();
            assert!(error.contains(problem) && error.contains("GeoTIFF"), "{error}");
        }
        // A size that the file cannot have takes no memory.
        let mut claims = std::fs::read(written::<Gray32Float>(&values, &AREA, &TIE, "0").path()).expect("bytes");
        let widths: Vec<usize> =
            (0..claims.len() - 12).filter(|at| claims[*at..at + 8] == [0, 1, 4, 0, 1, 0, 0, 0]).collect();
        for at in widths {
            claims[at + 8..at + 12].copy_from_slice(&10_000_000_u32.to_le_bytes());
        }
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), &claims).expect("written");
        let error = GeoRaster::read(file.path()).expect_err("refused").to_string();
        assert!(error.contains("10000000 x"), "{error}");
        let whole = std::fs::read(written::<Gray32Float>(&values, &AREA, &TIE, "0").path()).expect("bytes");
        let part = tempfile::NamedTempFile::new().expect("a file");
        for length in 0..whole.len() - 1 {
            std::fs::write(part.path(), &whole[..length]).expect("written");
            assert!(GeoRaster::read(part.path()).is_err(), "{length} of {} bytes", whole.len());
        }
    }
}
