//! What was seen of the lamp's light over several frames.

use super::LIT;
use super::floor::{Floor, Histogram};
use crate::image::GrayImage;

/// A pixel this many standard deviations above the floor is faintly lit.
const FAINT: f64 = 4.0;
/// A pixel this many standard deviations above the floor is strongly lit: twice as far as a faint one.
const STRONG: f64 = 8.0;
/// Grey values above this are strong in any case, however high the floor: the pixel is all but saturated.
pub(super) const SATURATED: u8 = 250;

/// Pixels that may be lit in enough frames by chance. They come in spots, so a spot is far less likely still.
const CHANCE_PX: f64 = 0.1;

/// Light seen so far, pixel by pixel.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    width: u32,
    height: u32,
    /// Row of the image in which its first one is.
    pub(super) top: u32,
    /// Considered pixels: stretches of indices in row order.
    considered: Vec<std::ops::Range<usize>>,
    considered_px: u64,
    /// Per pixel, in how many frames it was at least faintly lit; 255 stands for more, too.
    faint: Vec<u8>,
    /// Per pixel, in how many frames it was strongly lit.
    strong: Vec<u8>,
    /// Number of pixels strongly lit in more than one frame.
    pub(super) lit_px: u64,
    /// Grey values of all frames.
    pub(super) histogram: Histogram,
    pub(super) frames: u32,
    /// Frames whose floor is too bright for faint light to stand out.
    pub(super) lost_frames: u32,
    /// Highest floor of a frame, as bound of strong light.
    pub(super) highest_floor: f64,
}

impl Evidence {
    /// Nothing seen yet in the pixels of `considered` that are [`LIT`]: rows of an image from row `top` on.
    pub(super) fn new(considered: &GrayImage, top: u32) -> Self {
        let mut stretches: Vec<std::ops::Range<usize>> = Vec::new();
        let mut start = 0;
        for row in considered.as_raw().chunks((considered.width() as usize).max(1)) {
            // The lamp's part of the image is passed over row by row.
            if !row.contains(&LIT) {
                start += row.len();
                continue;
            }
            for stretch in row.chunk_by(|a, b| a == b) {
                if stretch.first() == Some(&LIT) {
                    stretches.push(start..start + stretch.len());
                }
                start += stretch.len();
            }
        }
        let considered_px = stretches.iter().map(|stretch| stretch.len() as u64).sum();
        Self {
            width: considered.width(),
            height: considered.height(),
            top,
            considered: stretches,
            considered_px,
            faint: vec![0; considered.len()],
            strong: vec![0; considered.len()],
            lit_px: 0,
            histogram: [0; 256],
            frames: 0,
            lost_frames: 0,
            highest_floor: 0.0,
        }
    }

    /// Adds the same rows of a frame, pixels in row order.
    pub(super) fn add(&mut self, pixels: &[u8]) {
        self.frames += 1;
        let histogram = histogram(self.considered.iter().map(|stretch| &pixels[stretch.clone()]));
        for (sum, px) in self.histogram.iter_mut().zip(&histogram) {
            *sum += px;
        }
        let Some(floor) = Floor::of(&histogram) else { return };
        self.highest_floor = self.highest_floor.max(floor.above(STRONG));
        if floor.above(FAINT) >= f64::from(SATURATED) {
            self.lost_frames += 1;
            return;
        }
        // A pixel exceeds a number where it exceeds the whole number below it.
        let (faint, strong) = (floor.above(FAINT) as u8, (floor.above(STRONG) as u8).min(SATURATED));
        for stretch in &self.considered {
            // Most pixels are dark, and found to be so faster many at a time.
            for start in stretch.clone().step_by(64) {
                let end = (start + 64).min(stretch.end);
                if pixels[start..end].iter().all(|value| *value <= faint) {
                    continue;
                }
                for (index, value) in (start..end).zip(&pixels[start..end]) {
                    if *value > faint {
                        self.faint[index] = self.faint[index].saturating_add(1);
                    }
                    if *value > strong {
                        self.strong[index] = self.strong[index].saturating_add(1);
                        self.lit_px += u64::from(self.strong[index] == 2);
                    }
                }
            }
        }
    }

    /// Frames in which a pixel must be lit to count, and the number of pixels that count by chance nevertheless.
    ///
    /// Hot pixels, reflections and noise light some pixels in one frame only, `passing_px` in all. From their number
    /// follows how many pixels they light in several frames by chance: N choose m times p^m of all. The least m is taken
    /// for which that is next to none, so a quiet scene needs two frames and a busy one more; but never more than a
    /// majority.
    pub(super) fn frames_needed(&self, passing_px: usize) -> (u32, f64) {
        let (frames, pixels) = (f64::from(self.frames), self.considered_px as f64);
        let passing = passing_px as f64 / (frames * pixels).max(1.0);
        let (mut needed, mut by_chance) = (1, pixels * frames * passing);
        while needed <= self.frames / 2 && (needed == 1 || by_chance > CHANCE_PX) {
            by_chance *= (frames - f64::from(needed)) / f64::from(needed + 1) * passing;
            needed += 1;
        }
        (needed, by_chance)
    }

    /// Image of the pixels, [`LIT`] where strongly lit in at least `needed` frames.
    pub(super) fn strong(&self, needed: u32) -> GrayImage {
        let needed = saturated(needed);
        self.image(&self.strong, |count| count >= needed)
    }

    /// Image of the pixels, [`LIT`] where at least faintly lit in at least `needed` frames.
    pub(super) fn faint(&self, needed: u32) -> GrayImage {
        let needed = saturated(needed);
        self.image(&self.faint, |count| count >= needed)
    }

    /// Image of the pixels, [`LIT`] where at least faintly lit in exactly one frame.
    pub(super) fn lit_once(&self) -> GrayImage {
        self.image(&self.faint, |count| count == 1)
    }

    /// Image of the pixels, [`LIT`] where strongly lit in some frames, but fewer than `needed`.
    pub(super) fn passing(&self, needed: u32) -> GrayImage {
        let needed = saturated(needed);
        self.image(&self.strong, |count| count > 0 && count < needed)
    }

    fn image(&self, counts: &[u8], is_lit: impl Fn(u8) -> bool) -> GrayImage {
        let mut image = GrayImage::new(self.width, self.height);
        let all: &mut [u8] = &mut image;
        for stretch in &self.considered {
            let pixels = all[stretch.clone()].iter_mut().zip(&counts[stretch.clone()]);
            pixels.for_each(|(pixel, count)| *pixel = if is_lit(*count) { LIT } else { 0 });
        }
        image
    }
}

/// A number of frames as it is counted for a pixel.
fn saturated(frames: u32) -> u8 {
    u8::try_from(frames).unwrap_or(u8::MAX)
}

fn histogram<'a>(stretches: impl Iterator<Item = &'a [u8]>) -> Histogram {
    // Neighbours often have the same value; counting them apart keeps one addition from waiting for the other.
    let mut counts = [[0_u32; 256]; 4];
    let mut sums = [0; 256];
    for stretch in stretches {
        let mut quads = stretch.chunks_exact(4);
        for quad in &mut quads {
            for (count, value) in counts.iter_mut().zip(quad) {
                count[usize::from(*value)] += 1;
            }
        }
        for value in quads.remainder() {
            sums[usize::from(*value)] += 1;
        }
    }
    for (value, sum) in sums.iter_mut().enumerate() {
        *sum += counts.iter().map(|count| u64::from(count[value])).sum::<u64>();
    }
    sums
}
