//! Frames of an airframe under a moving lamp, rendered: two arms that reach into the image from below.

use image::{GrayImage, Luma};

/// Size of the image that lengths are given for, px.
const SIZE: (u32, u32) = (752, 480);

/// What is in front of the camera.
#[derive(Debug, Clone)]
pub struct LitScene {
    pub width: u32,
    pub height: u32,
    /// At 5000 us most of the airframe is near the upper end of the scale.
    pub exposure_us: f64,
    /// Light of the lamp on the airframe; 0 is switched off.
    pub lamp: f64,
    /// Where the lamp itself stands and glows, (x, y) in pixels of a 752 x 480 image.
    pub glow_at: Option<(f64, f64)>,
    /// Pixels that are bright in every frame.
    pub stuck_px: u32,
    /// Pixels that are bright in one frame, of each.
    pub passing_px: u32,
    /// Bright discs of 6 px that are in one frame, of each.
    pub glints: u32,
    /// Whether an arm (0 or 1) is lit in a frame.
    pub arm_is_lit: fn(arm: u32, frame: u32) -> bool,
    pub seed: u64,
}

impl Default for LitScene {
    fn default() -> Self {
        Self {
            width: SIZE.0,
            height: SIZE.1,
            exposure_us: 5000.0,
            lamp: 1.0,
            glow_at: Some((380.0, 60.0)),
            stuck_px: 2,
            passing_px: 2,
            glints: 0,
            arm_is_lit: |_, _| true,
            seed: 1,
        }
    }
}

impl LitScene {
    /// The arm that shows at a pixel.
    pub fn arm(&self, x: u32, y: u32) -> Option<u32> {
        let scale = f64::from(SIZE.0) / f64::from(self.width);
        let (x, y) = (f64::from(x) * scale, f64::from(y) * scale);
        let limb = |from: (f64, f64), to: (f64, f64), radius: f64| {
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            let along = ((x - from.0) * dx + (y - from.1) * dy) / (dx * dx + dy * dy);
            let along = along.clamp(0.0, 1.0);
            (x - from.0 - along * dx).hypot(y - from.1 - along * dy) <= radius
        };
        let left = limb((110.0, 500.0), (190.0, 390.0), 14.0) || (x - 190.0).hypot(y - 385.0) <= 24.0;
        let right = limb((640.0, 500.0), (590.0, 400.0), 11.0) || (x - 588.0).hypot(y - 396.0) <= 19.0;
        if left { Some(0) } else { right.then_some(1) }
    }

    /// Frame of this number.
    pub fn frame(&self, number: u32) -> GrayImage {
        let gain = self.exposure_us / 5000.0;
        let scale = f64::from(SIZE.0) / f64::from(self.width);
        let mut noise = Random(self.seed << 20 | u64::from(number));
        let phase = f64::from(number) * 1.1;
        let mut image = GrayImage::from_fn(self.width, self.height, |x, y| {
            let (u, v) = (f64::from(x) * scale, f64::from(y) * scale);
            let grain = 0.8 + 0.2 * (u * 0.31).sin() * (v * 0.23).cos();
            let lit_arm = self.arm(x, y).filter(|arm| (self.arm_is_lit)(*arm, number));
            let mut light = match lit_arm {
                Some(_) => self.lamp * grain * (330.0 + 90.0 * (u * 0.009 + v * 0.009 + phase).cos()),
                None => 6.0 + 12.0 * (0.5 + 0.25 * (u * 0.012).sin() + 0.25 * (v * 0.017).cos()),
            };
            if let Some((at_x, at_y)) = self.glow_at {
                let distance = ((u - at_x) / 70.0).hypot((v - at_y) / 60.0);
                light += self.lamp * 400.0 * (-distance * distance).exp();
            }
            let value = light * gain;
            let deviation = 1.6 + 0.05 * value.clamp(0.0, 255.0).sqrt();
            Luma([(value + deviation * noise.normal()).round().clamp(0.0, 255.0) as u8])
        });
        let mut stuck = Random(self.seed);
        for (source, count) in [(&mut stuck, self.stuck_px), (&mut noise, self.passing_px)] {
            for _ in 0..count {
                let (x, y) = (source.below(self.width), source.below(self.height));
                image.put_pixel(x, y, Luma([230]));
            }
        }
        for _ in 0..self.glints {
            self.glint(&mut image, &mut noise);
        }
        image
    }

    /// A disc that keeps away from the airframe.
    fn glint(&self, image: &mut GrayImage, noise: &mut Random) {
        let (x, y) = (noise.below(self.width), noise.below(self.height));
        let around = |radius: i64| {
            let steps = move || -radius..=radius;
            let offsets = steps().flat_map(move |dy| steps().map(move |dx| (dx, dy)));
            offsets.filter(move |(dx, dy)| dx * dx + dy * dy <= radius * radius).filter_map(
                move |(dx, dy)| {
                    let (x, y) = (i64::from(x) + dx, i64::from(y) + dy);
                    Some((u32::try_from(x).ok()?, u32::try_from(y).ok()?))
                },
            )
        };
        if around(60).all(|(x, y)| self.arm(x, y).is_none()) {
            for (x, y) in around(6).filter(|(x, y)| *x < self.width && *y < self.height) {
                image.put_pixel(x, y, Luma([240]));
            }
        }
    }
}

/// A small generator of repeatable numbers (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    fn below(&mut self, end: u32) -> u32 {
        (self.next() >> 32) as u32 % end.max(1)
    }

    /// About a standard normal value: the sum of four uniform ones.
    fn normal(&mut self) -> f64 {
        let bits = self.next();
        let sum: u64 = (0..4).map(|part| bits >> (16 * part) & 0xffff).sum();
        (sum as f64 / 65536.0 - 2.0) * 3f64.sqrt()
    }
}
