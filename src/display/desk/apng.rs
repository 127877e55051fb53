//! Animated PNG (W3C, "Portable Network Graphics (PNG) Specification, third edition", chapter 11.3.4): a film that browsers
//! and picture viewers show, written picture by picture.
//!
//! In: pictures of one size with the time that each is shown. Out: a file whose number of frames is filled in at the end.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use std::io::{Error, Result, Seek, SeekFrom, Write};

/// Where the chunk that tells the number of frames begins: behind the signature and the header.
const CONTROL_AT: u64 = 8 + 25;

/// A film on its way into a file.
pub struct Apng<W: Write + Seek> {
    file: W,
    frames: u32,
    /// Number of the next chunk of those that are counted.
    sequence: u32,
}

impl<W: Write + Seek> Apng<W> {
    pub fn new(file: W) -> Apng<W> {
        Apng { file, frames: 0, sequence: 0 }
    }

    /// Adds a picture that is shown for `shown_s`; all have the size of the first.
    pub fn add(&mut self, picture: &RgbImage, shown_s: f64) -> Result<()> {
        let mut png = Vec::new();
        PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive)
            .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
            .map_err(Error::other)?;
        let chunks = chunks(&png).ok_or_else(|| Error::other("a picture was not encoded as PNG"))?;
        if self.frames == 0 {
            self.file.write_all(&png[..8])?;
            for (_, header) in chunks.iter().filter(|(kind, _)| kind == b"IHDR") {
                write_chunk(&mut self.file, b"IHDR", header)?;
            }
            self.control()?;
        }
        let milliseconds = (1e3 * shown_s).round().clamp(1.0, 65535.0) as u16;
        let mut frame = self.next_number();
        frame
            .extend([picture.width(), picture.height(), 0, 0].iter().flat_map(|number| number.to_be_bytes()));
        frame.extend(milliseconds.to_be_bytes());
        frame.extend(1000_u16.to_be_bytes());
        // Kept when the next is shown, which covers it.
        frame.extend([0, 0]);
        write_chunk(&mut self.file, b"fcTL", &frame)?;
        for (_, data) in chunks.iter().filter(|(kind, _)| kind == b"IDAT") {
            if self.frames == 0 {
                write_chunk(&mut self.file, b"IDAT", data)?;
            } else {
                let mut numbered = self.next_number();
                numbered.extend_from_slice(data);
                write_chunk(&mut self.file, b"fdAT", &numbered)?;
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// Ends the film; returns the file.
    pub fn finish(mut self) -> Result<W> {
        write_chunk(&mut self.file, b"IEND", &[])?;
        self.file.seek(SeekFrom::Start(CONTROL_AT))?;
        self.control()?;
        self.file.seek(SeekFrom::End(0))?;
        self.file.flush()?;
        Ok(self.file)
    }

    /// So many frames, again and again.
    fn control(&mut self) -> Result<()> {
        let numbers = [self.frames.to_be_bytes(), 0_u32.to_be_bytes()].concat();
        write_chunk(&mut self.file, b"acTL", &numbers)
    }

    fn next_number(&mut self) -> Vec<u8> {
        let number = self.sequence.to_be_bytes().to_vec();
        self.sequence += 1;
        number
    }
}

/// Kind and content of the chunks of a PNG file.
fn chunks(png: &[u8]) -> Option<Vec<([u8; 4], &[u8])>> {
    let (mut rest, mut found) = (png.get(8..)?, Vec::new());
    while !rest.is_empty() {
        let length = u32::from_be_bytes(rest.get(..4)?.try_into().ok()?) as usize;
        found.push((rest.get(4..8)?.try_into().ok()?, rest.get(8..8 + length)?));
        rest = rest.get(12 + length..)?;
    }
    Some(found)
}

fn write_chunk(file: &mut impl Write, kind: &[u8; 4], content: &[u8]) -> Result<()> {
    let mut checked = flate2::Crc::new();
    checked.update(kind);
    checked.update(content);
    file.write_all(&(content.len() as u32).to_be_bytes())?;
    file.write_all(kind)?;
    file.write_all(content)?;
    file.write_all(&checked.sum().to_be_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::AnimationDecoder;
    use image::codecs::png::PngDecoder;
    use std::io::Cursor;

    /// Read by the decoder of another project.
    #[test]
    fn a_film_is_read_back_picture_by_picture() {
        let picture = |k: u8| RgbImage::from_fn(17, 9, |x, y| image::Rgb([k, x as u8 * 10, y as u8 * 20]));
        let mut film = Apng::new(Cursor::new(Vec::new()));
        for k in 0..3 {
            film.add(&picture(80 * k), 0.04 * f64::from(k + 1)).unwrap();
        }
        let bytes = film.finish().unwrap().into_inner();
        let decoder = PngDecoder::new(Cursor::new(bytes)).unwrap().apng().unwrap();
        let frames = decoder.into_frames().collect_frames().unwrap();
        assert_eq!(frames.len(), 3);
        for (k, frame) in (0..).zip(&frames) {
            let rgb = image::DynamicImage::from(frame.buffer().clone()).to_rgb8();
            assert!(rgb == picture(80 * k), "picture {k}");
            let (numerator, denominator) = frame.delay().numer_denom_ms();
            assert_eq!(numerator, 40 * (u32::from(k) + 1) * denominator);
        }
    }
}
