//! Animated PNG (W3C, "Portable Network Graphics (PNG) Specification, third edition", chapter 11.3.4): a film that browsers
//! and picture viewers show, written picture by picture.
//!
//! In: pictures of one size with the time that each is shown. Out: a file of 255 colours, in which each picture holds what has
//! changed since the one before. Colours are chosen as the film goes on; they, and the number of frames, are filled in at its end.

use super::palette::{Colour, Histogram, Palette, differ};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use image::RgbImage;
use std::io::{Error, Result, Seek, SeekFrom, Write};

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Offset of the chunks that are filled in at the end: behind the signature and the header.
const FILLED_IN_AT: u64 = 8 + 25;
/// Largest error of a pixel that was shown before, in steps of 255 of a channel.
const UNSEEN: u8 = 3;
/// A colour that is further than this from all that there are is worth a new one.
const MISSED: u8 = 10;
/// Number of colours that are kept for later pictures.
const KEPT: usize = 64;
/// Each picture takes at most one in this number of the colours that are left.
const PART: usize = 6;
/// Least number of pixels for which a new colour stands.
const PIXELS: u32 = 24;

/// A film on its way into a file.
pub struct Apng<W: Write + Seek> {
    file: W,
    size: [u32; 2],
    frames: u32,
    /// Number of the next chunk of those that are counted.
    sequence: u32,
    palette: Palette,
    /// Numbers of the colours that a viewer sees; 0 is none.
    seen: Vec<u8>,
}

/// The part of a picture that is written: a rectangle by its corner and size, and its pixels in rows; those that stay are 0.
struct Part {
    corner: [u32; 2],
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl<W: Write + Seek> Apng<W> {
    pub fn new(file: W) -> Apng<W> {
        Apng { file, size: [0; 2], frames: 0, sequence: 0, palette: Palette::new(255), seen: Vec::new() }
    }

    /// Takes the colours of pictures that are like those of the film, where some are known before it.
    pub fn expect(&mut self, pictures: &[RgbImage]) {
        let mut colours = Histogram::new();
        pictures.iter().for_each(|picture| self.palette.missed(picture, 0, &mut colours));
        self.palette.grow(&colours, self.palette.room().saturating_sub(KEPT));
    }

    /// Adds a picture that is shown for `shown_s`; all have the size of the first.
    pub fn add(&mut self, picture: &RgbImage, shown_s: f64) -> Result<()> {
        let size = [picture.width(), picture.height()];
        if self.frames == 0 {
            self.begin(size)?;
        } else if size != self.size {
            return Err(Error::other("a picture has another size than the film"));
        }
        self.choose_colours(picture);
        let part = self.part(picture);
        self.frame(&part, shown_s)?;
        self.frames += 1;
        Ok(())
    }

    /// Ends the film; returns the file.
    pub fn finish(mut self) -> Result<W> {
        write_chunk(&mut self.file, b"IEND", &[])?;
        self.file.seek(SeekFrom::Start(FILLED_IN_AT))?;
        self.filled_in()?;
        self.file.seek(SeekFrom::End(0))?;
        self.file.flush()?;
        Ok(self.file)
    }

    fn begin(&mut self, size: [u32; 2]) -> Result<()> {
        self.size = size;
        self.seen = vec![0; size[0] as usize * size[1] as usize];
        self.file.write_all(SIGNATURE)?;
        let mut header = size.map(u32::to_be_bytes).concat();
        // A byte for each pixel, the number of a colour; nothing interlaced.
        header.extend([8, 3, 0, 0, 0]);
        write_chunk(&mut self.file, b"IHDR", &header)?;
        self.filled_in()?;
        // The colour 0 is transparent.
        write_chunk(&mut self.file, b"tRNS", &[0])
    }

    /// The number of frames, which are shown again and again, and the colours.
    fn filled_in(&mut self) -> Result<()> {
        write_chunk(&mut self.file, b"acTL", &[self.frames, 0].map(u32::to_be_bytes).concat())?;
        let mut colours = vec![0; 3];
        colours.extend(self.palette.colours.iter().flatten());
        colours.resize(3 * 256, 0);
        write_chunk(&mut self.file, b"PLTE", &colours)
    }

    fn choose_colours(&mut self, picture: &RgbImage) {
        if self.palette.colours.is_empty() {
            self.expect(std::slice::from_ref(picture));
        }
        let most = self.palette.room().div_ceil(PART);
        if most > 0 {
            let mut missed = Histogram::new();
            self.palette.missed(picture, MISSED, &mut missed);
            let pixels: u32 = missed.values().sum();
            self.palette.grow(&missed, most.min((pixels / PIXELS) as usize));
        }
    }

    fn colour(&self, number: u8) -> Colour {
        self.palette.colours.get(usize::from(number).wrapping_sub(1)).copied().unwrap_or_default()
    }

    /// The part of the picture that is new.
    fn part(&mut self, picture: &RgbImage) -> Part {
        let width = self.size[0];
        let mut changed = vec![0; self.seen.len()];
        let (mut low, mut high) = (self.size, [0; 2]);
        for (at, pixel) in picture.pixels().enumerate() {
            let (seen, number) = (self.seen[at], self.palette.index(pixel.0) + 1);
            let off = |number: u8| differ(self.colour(number), pixel.0);
            if seen != number && (seen == 0 || off(seen) > off(number).max(UNSEEN)) {
                (changed[at], self.seen[at]) = (number, number);
                let place = [at as u32 % width, at as u32 / width];
                low = [low[0].min(place[0]), low[1].min(place[1])];
                high = [high[0].max(place[0]), high[1].max(place[1])];
            }
        }
        if low[1] > high[1] {
            return Part { corner: [0, 0], size: [1, 1], pixels: vec![0] };
        }
        let size = [high[0] - low[0] + 1, high[1] - low[1] + 1];
        let row = |y: u32| {
            let start = (y * width + low[0]) as usize;
            &changed[start..start + size[0] as usize]
        };
        Part { corner: low, size, pixels: (low[1]..=high[1]).flat_map(row).copied().collect() }
    }

    fn frame(&mut self, part: &Part, shown_s: f64) -> Result<()> {
        let milliseconds = (1e3 * shown_s).round().clamp(1.0, 65535.0) as u16;
        let mut control = self.next_number();
        control
            .extend([part.size, part.corner].as_flattened().iter().flat_map(|number| number.to_be_bytes()));
        control.extend(milliseconds.to_be_bytes());
        control.extend(1000_u16.to_be_bytes());
        // It stays when the next is shown, which is laid over it.
        control.extend([0, 1]);
        write_chunk(&mut self.file, b"fcTL", &control)?;
        let (kind, data) =
            if self.frames == 0 { (b"IDAT", Vec::new()) } else { (b"fdAT", self.next_number()) };
        let mut encoder = ZlibEncoder::new(data, Compression::best());
        for row in part.pixels.chunks(part.size[0] as usize) {
            // As it is: numbers of colours have no differences.
            encoder.write_all(&[0])?;
            encoder.write_all(row)?;
        }
        write_chunk(&mut self.file, kind, &encoder.finish()?)
    }

    fn next_number(&mut self) -> Vec<u8> {
        let number = self.sequence.to_be_bytes().to_vec();
        self.sequence += 1;
        number
    }
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

    fn film(pictures: &[(RgbImage, f64)]) -> Vec<u8> {
        let mut film = Apng::new(Cursor::new(Vec::new()));
        pictures.iter().for_each(|(picture, shown_s)| film.add(picture, *shown_s).unwrap());
        film.finish().unwrap().into_inner()
    }

    /// Pictures and their times, ms, from the decoder of another project.
    fn shown(film: &[u8]) -> Vec<(RgbImage, u32)> {
        let decoder = PngDecoder::new(Cursor::new(film)).unwrap().apng().unwrap();
        let frames = decoder.into_frames().collect_frames().unwrap();
        let shown = |frame: image::Frame| {
            let (numerator, denominator) = frame.delay().numer_denom_ms();
            (image::DynamicImage::from(frame.into_buffer()).to_rgb8(), numerator / denominator)
        };
        frames.into_iter().map(shown).collect()
    }

    fn worst(a: &RgbImage, b: &RgbImage) -> u8 {
        a.pixels().zip(b.pixels()).map(|(a, b)| differ(a.0, b.0)).max().unwrap()
    }

    #[test]
    fn a_film_of_few_colours_is_read_back_as_it_went_in() {
        let picture = |k: u8| {
            RgbImage::from_fn(40, 30, |x, y| {
                let inside = x.abs_diff(5 * u32::from(k) + 5) < 4 && y.abs_diff(15) < 4;
                image::Rgb(if inside {
                    [200, 40 * k, 20]
                } else {
                    [8 * (x / 5) as u8, 10 * (y / 3) as u8, 60]
                })
            })
        };
        let pictures: Vec<_> = [0, 1, 2, 3, 3].map(|k| (picture(k), 0.04 * f64::from(k + 1))).into();
        let bytes = film(&pictures);
        let frames = shown(&bytes);
        assert_eq!(frames.iter().map(|(_, ms)| *ms).collect::<Vec<_>>(), [40, 80, 120, 160, 160]);
        for (k, ((frame, _), (picture, _))) in frames.iter().zip(&pictures).enumerate() {
            assert!(worst(frame, picture) <= UNSEEN, "picture {k}: {}", worst(frame, picture));
        }
        let (first, all) = (film(&pictures[..1]).len(), bytes.len());
        assert!(all - first < 600, "pictures hold what changed: {first} of {all} bytes are the first");
    }

    /// Ten thousand colours, and new ones in each picture.
    #[test]
    fn many_colours_become_255_that_are_near_them() {
        let picture = |k: u32| {
            RgbImage::from_fn(100, 100, |x, y| {
                let lit = if x / 20 == k { 1.0 } else { 0.5 };
                image::Rgb([2 * x, 90 + x / 2 + y / 2, 50 + y].map(|part| (lit * f64::from(part)) as u8))
            })
        };
        let pictures: Vec<_> = (0..5).map(|k| (picture(k), 0.1)).collect();
        for (k, ((frame, _), (picture, _))) in shown(&film(&pictures)).iter().zip(&pictures).enumerate() {
            let squares = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
            let sum: f64 = frame.as_raw().iter().zip(picture.as_raw()).map(squares).sum();
            let off = (sum / 3e4).sqrt();
            assert!(off < 8.0, "picture {k}: {off} steps of 255, root mean square");
        }
    }

    #[test]
    fn a_picture_of_another_size_is_refused() {
        let mut film = Apng::new(Cursor::new(Vec::new()));
        film.add(&RgbImage::new(4, 3), 0.1).unwrap();
        assert!(film.add(&RgbImage::new(3, 4), 0.1).unwrap_err().to_string().contains("another size"));
    }
}
