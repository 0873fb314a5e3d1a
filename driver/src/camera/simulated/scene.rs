//! What the simulated camera sees.
//!
//! A few backgrounds are rendered once, with the lamp in another place and other noise in each; a frame is one of them plus the
//! markers. So a frame costs little more than its copy, as on a device that writes memory by itself. To draw the backgrounds is most of what
//! the start of a simulated camera takes: what they have in common is computed once, and waves by column and by row.

use crate::camera::Settings;

/// Backgrounds in turn: the lamp comes back to its place after as many frames.
const BACKGROUNDS: u64 = 8;
/// Memory that all backgrounds may take together, bytes. Where a frame is so large that they would take more, there are fewer.
const BACKGROUND_BYTES: u64 = 256 << 20;
/// The exposure at which an airframe under the lamp is near the upper end of the scale, microseconds.
const LIT_EXPOSURE_US: f64 = 5000.0;

#[derive(Debug)]
pub(super) struct Scene {
    backgrounds: Vec<Vec<u8>>,
    width: u32,
    height: u32,
    bytes_per_pixel: usize,
    significant_bits: u32,
    still: bool,
}

/// What one column or one row adds to the light of its pixels.
struct Waves {
    /// The airframe's surface.
    grain: f64,
    /// The lamp's light that moves over it, as an angle.
    sweep: f64,
    mirror: f64,
}

fn backgrounds(frame_bytes: usize) -> u64 {
    (BACKGROUND_BYTES / (frame_bytes as u64).max(1)).clamp(1, BACKGROUNDS)
}

impl Scene {
    pub(super) fn new(settings: &Settings, exposure_us: f64, gain_db: f64, still: bool) -> Self {
        let brightness = exposure_us / LIT_EXPOSURE_US * 10f64.powf(gain_db / 20.0);
        let mut scene = Scene {
            backgrounds: Vec::new(),
            width: settings.width,
            height: settings.height,
            bytes_per_pixel: settings.pixel_format.bytes_per_pixel(),
            significant_bits: settings.pixel_format.significant_bits(),
            still,
        };
        let on_airframe = scene.airframe();
        scene.backgrounds = (0..if still { 1 } else { backgrounds(scene.frame_bytes()) })
            .map(|index| scene.background(index, brightness, &on_airframe))
            .collect();
        scene
    }

    pub(super) fn frame_bytes(&self) -> usize {
        self.width as usize * self.height as usize * self.bytes_per_pixel
    }

    pub(super) fn render(&self, frame_id: u64, pixels: &mut [u8]) {
        self.render_rows_until(frame_id, self.frame_bytes(), pixels);
        for marker in 0..2 {
            self.draw_marker(marker, if self.still { 0 } else { frame_id }, pixels);
        }
    }

    /// Writes the first `bytes` of the background only.
    pub(super) fn render_rows_until(&self, frame_id: u64, bytes: usize, pixels: &mut [u8]) {
        let Some(background) = self.backgrounds.get((frame_id % self.backgrounds.len() as u64) as usize)
        else {
            return;
        };
        if let (Some(to), Some(from)) = (pixels.get_mut(..bytes), background.get(..bytes)) {
            to.copy_from_slice(from);
        }
    }

    /// A blinking square of 3 x 3 px that wanders in the upper half, one bit of its code a frame.
    fn draw_marker(&self, marker: u64, frame_id: u64, pixels: &mut [u8]) {
        const CODES: [u16; 2] = [0b1110_0110_1010_0101, 0b1100_1011_0010_1101];
        if CODES[marker as usize % 2] >> (frame_id % 16) & 1 == 0 {
            return;
        }
        let angle = frame_id as f64 * 0.004 + marker as f64 * 2.0;
        let x = (0.5 + 0.35 * angle.sin()) * f64::from(self.width);
        let y = (0.25 + 0.15 * (1.7 * angle).cos()) * f64::from(self.height);
        for (dx, dy) in (0..9).map(|cell| (cell % 3, cell / 3)) {
            self.put(pixels, x as u32 + dx, y as u32 + dy, 240);
        }
    }

    /// Which pixels show the airframe, row by row.
    fn airframe(&self) -> Vec<bool> {
        let on_airframe = airframe(self.width, self.height);
        (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| (x, y)))
            .map(|(x, y)| on_airframe(x, y))
            .collect()
    }

    fn background(&self, index: u64, brightness: f64, on_airframe: &[bool]) -> Vec<u8> {
        let mut pixels = vec![0; self.frame_bytes()];
        let mut noise = Noise(index + 1);
        let sigma = if self.still { 0.0 } else { 1.6 };
        let phase = index as f64 / BACKGROUNDS as f64 * std::f64::consts::TAU;
        let along = |length: u32| (0..length).map(move |at| f64::from(at) / f64::from(length));
        let columns: Vec<_> = along(self.width)
            .map(|u| Waves { grain: (u * 91.0).sin(), sweep: u * 6.0, mirror: (u * 40.0 + phase).sin() })
            .collect();
        let rows = along(self.height).map(|v| Waves {
            grain: (v * 57.0).cos(),
            sweep: v * 4.0,
            mirror: (v * 36.0 - phase).cos(),
        });
        let mut places = pixels.chunks_exact_mut(self.bytes_per_pixel).zip(on_airframe);
        for row in rows {
            for (column, (pixel, on_airframe)) in columns.iter().zip(places.by_ref()) {
                let grain = 0.8 + 0.2 * column.grain * row.grain;
                let light = if *on_airframe {
                    let sweep = 0.5 + 0.5 * (column.sweep + row.sweep + phase).cos();
                    // Edges that mirror the lamp: what a detector would take for a marker.
                    let mirror = if column.mirror * row.mirror > 0.985 { 1200.0 } else { 0.0 };
                    (220.0 + 170.0 * sweep) * grain + mirror
                } else {
                    6.0 + 10.0 * grain
                };
                let value = (light * brightness + sigma * noise.normal()).clamp(0.0, 255.0) as u8;
                self.write(pixel, value);
            }
        }
        pixels
    }

    /// Writes one pixel where it is in the image.
    fn put(&self, pixels: &mut [u8], x: u32, y: u32, value: u8) {
        if x >= self.width || y >= self.height {
            return;
        }
        let at = (y as usize * self.width as usize + x as usize) * self.bytes_per_pixel;
        if let Some(pixel) = pixels.get_mut(at..at + self.bytes_per_pixel) {
            self.write(pixel, value);
        }
    }

    /// Writes the value, scaled from 8 bits to the format's depth.
    fn write(&self, pixel: &mut [u8], value: u8) {
        let scaled = u16::from(value) << (self.significant_bits - 8);
        match (pixel, scaled.to_le_bytes()) {
            ([byte], [value, _]) => *byte = value,
            ([low, high], value) => [*low, *high] = value,
            _ => {}
        }
    }
}

/// Tells which pixels of an image of this size show the simulated airframe: two arms with their motors, and a landing leg.
pub fn airframe(width: u32, height: u32) -> impl Fn(u32, u32) -> bool {
    let unit = f64::from(width.max(1));
    let floor = f64::from(height) / unit;
    // Thick lines: two ends and a radius, in image widths.
    let limbs = [
        ((0.08, floor + 0.02), (0.27, floor - 0.13), 0.035),
        ((0.27, floor - 0.13), (0.27, floor - 0.13), 0.050),
        ((0.93, floor + 0.02), (0.76, floor - 0.11), 0.032),
        ((0.76, floor - 0.11), (0.76, floor - 0.11), 0.045),
        ((0.50, floor + 0.02), (0.52, floor - 0.06), 0.012),
    ];
    move |x, y| {
        let point = (f64::from(x) / unit, f64::from(y) / unit);
        limbs.iter().any(|(from, to, radius)| squared_distance_to_line(point, *from, *to) <= radius * radius)
    }
}

fn squared_distance_to_line(point: (f64, f64), from: (f64, f64), to: (f64, f64)) -> f64 {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length_squared = dx * dx + dy * dy;
    let along = ((point.0 - from.0) * dx + (point.1 - from.1) * dy) / length_squared.max(f64::MIN_POSITIVE);
    let along = along.clamp(0.0, 1.0);
    (point.0 - from.0 - along * dx).powi(2) + (point.1 - from.1 - along * dy).powi(2)
}

/// A small generator of repeatable noise (SplitMix64).
struct Noise(u64);

impl Noise {
    /// About a standard normal value: the sum of four uniform ones.
    fn normal(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
        let sum: u64 = (0..4).map(|part| bits >> (16 * part) & 0xffff).sum();
        (sum as f64 / 65536.0 - 2.0) * 3f64.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backgrounds_of_large_frames_are_fewer() {
        assert_eq!(backgrounds(752 * 480), BACKGROUNDS);
        assert_eq!(backgrounds(32 << 20), BACKGROUNDS);
        assert_eq!(backgrounds(128 << 20), 2);
        assert_eq!(backgrounds(1 << 40), 1);
    }
}
