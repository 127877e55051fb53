//! Animated PNG files: each frame holds only what has changed since the one before.
//!
//! In: pictures of one size. Out: the bytes of an APNG file, as every browser shows it. Pixels that changed by no more than
//! [`UNSEEN`] are left as they are, so that noise costs nothing; what is shown never differs by more than that and half of
//! [`COARSE`].

use image::{Rgba, RgbaImage};
use png::{BlendOp, ColorType, DisposeOp, Encoder, EncodingError, Writer};

/// Steps of 255 in a channel by which a pixel may differ from what it should be.
const UNSEEN: u8 = 4;
/// Colours are multiples of this: even slopes of a background then take little space.
const COARSE: u8 = 4;

/// An animation on its way into memory.
pub struct Animation<'a> {
    writer: Writer<&'a mut Vec<u8>>,
    /// What a viewer sees after the last frame.
    seen: RgbaImage,
    is_first: bool,
}

impl<'a> Animation<'a> {
    /// Of exactly `frames` pictures of this size, `rate_hz` a second, again and again.
    pub fn new(
        bytes: &'a mut Vec<u8>,
        size: [u32; 2],
        frames: u32,
        rate_hz: u16,
    ) -> Result<Self, EncodingError> {
        let mut encoder = Encoder::new(bytes, size[0], size[1]);
        encoder.set_color(ColorType::Rgba);
        encoder.set_compression(png::Compression::High);
        encoder.set_animated(frames, 0)?;
        encoder.set_frame_delay(1, rate_hz)?;
        encoder.set_dispose_op(DisposeOp::None)?;
        encoder.set_blend_op(BlendOp::Over)?;
        let writer = encoder.write_header()?;
        Ok(Animation { writer, seen: RgbaImage::new(size[0], size[1]), is_first: true })
    }

    /// Adds a picture.
    pub fn push(&mut self, picture: &RgbaImage) -> Result<(), EncodingError> {
        let picture = coarse(picture);
        let (place, part) = match self.is_first {
            false => changes(&self.seen, &picture),
            true => ([0, 0], picture),
        };
        self.is_first = false;
        self.writer.reset_frame_position()?;
        self.writer.set_frame_dimension(part.width(), part.height())?;
        self.writer.set_frame_position(place[0], place[1])?;
        self.writer.write_image_data(part.as_raw())?;
        image::imageops::overlay(&mut self.seen, &part, place[0].into(), place[1].into());
        Ok(())
    }

    /// Writes the end.
    pub fn finish(self) -> Result<(), EncodingError> {
        self.writer.finish()
    }
}

/// The picture in fewer colours.
fn coarse(picture: &RgbaImage) -> RgbaImage {
    let round = |value: u8| value.saturating_add(COARSE / 2) / COARSE * COARSE;
    let of = |Rgba([r, g, b, _]): &Rgba<u8>| Rgba([round(*r), round(*g), round(*b), 255]);
    RgbaImage::from_fn(picture.width(), picture.height(), |x, y| of(picture.get_pixel(x, y)))
}

/// The rectangle that holds all that changed, by its corner and its pixels; those that did not are transparent.
fn changes(seen: &RgbaImage, picture: &RgbaImage) -> ([u32; 2], RgbaImage) {
    let is_new = |x: u32, y: u32| {
        let (a, b) = (seen.get_pixel(x, y).0, picture.get_pixel(x, y).0);
        (0..3).any(|channel| a[channel].abs_diff(b[channel]) > UNSEEN)
    };
    let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
    for (x, y, _) in picture.enumerate_pixels().filter(|&(x, y, _)| is_new(x, y)) {
        (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
    }
    if low[0] > high[0] {
        return ([0, 0], RgbaImage::new(1, 1));
    }
    let size = [high[0] - low[0] + 1, high[1] - low[1] + 1];
    let part = RgbaImage::from_fn(size[0], size[1], |x, y| {
        let (x, y) = (x + low[0], y + low[1]);
        let [r, g, b, _] = picture.get_pixel(x, y).0;
        if is_new(x, y) { Rgba([r, g, b, 255]) } else { Rgba([0; 4]) }
    });
    (low, part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_comes_out_as_it_went_in() {
        let size = [40, 30];
        let picture = |k: u32| {
            RgbaImage::from_fn(size[0], size[1], |x, y| {
                let inside = x.abs_diff(5 * k + 5) < 4 && y.abs_diff(15) < 4;
                if inside { Rgba([200, 40 * k as u8, 20, 255]) } else { Rgba([x as u8, y as u8, 60, 255]) }
            })
        };
        let mut bytes = Vec::new();
        let mut animation = Animation::new(&mut bytes, size, 5, 8).unwrap();
        (0..4).for_each(|k| animation.push(&picture(k)).unwrap());
        animation.push(&picture(3)).unwrap();
        animation.finish().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
        let mut seen = RgbaImage::new(size[0], size[1]);
        for k in [0, 1, 2, 3, 3] {
            let mut part = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut part).unwrap();
            let control = *reader.info().frame_control().unwrap();
            part.truncate(info.buffer_size());
            let part = RgbaImage::from_raw(info.width, info.height, part).unwrap();
            image::imageops::overlay(&mut seen, &part, control.x_offset.into(), control.y_offset.into());
            assert!(k == 0 || info.width < 20, "only what changed: {} pixels wide", info.width);
            let differs = |(a, b): (&u8, &u8)| a.abs_diff(*b) > UNSEEN + COARSE / 2;
            assert!(!seen.as_raw().iter().zip(picture(k).as_raw()).any(differs), "frame {k}");
        }
    }
}
