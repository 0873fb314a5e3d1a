//! What masking costs beside touching the whole frame: `apply` is to stay below a tenth of `memcpy` for every
//! mask.
//!
//! The setting is that of a driver: a frame has just arrived in its slot, and the slot that `memcpy` copies
//! it to was last used so long ago that no cache holds it. Where the caches hold that slot too, `memcpy` is
//! about three times as fast, and a mask of many short runs costs up to a fifth of it. Masks in real use join
//! in where the reference data is found.

#![allow(clippy::expect_used, reason = "a bench that cannot apply its mask measures nothing")]

use std::cell::{Cell, RefCell};
use std::fmt;
use std::path::Path;

use divan::Bencher;
use uvcam_masker::{ImageViewMut, Mask};

/// Memory of all slots, several times what caches hold.
const SLOTS_BYTES: usize = 128 << 20;

fn main() {
    divan::main();
}

struct Case {
    name: String,
    mask: Mask,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, mask } = self;
        write!(
            f,
            "{}x{} {name}: {} runs, {} px",
            mask.width(),
            mask.height(),
            mask.runs().len(),
            mask.masked_px()
        )
    }
}

/// Two arms of the airframe, one from either side, `runs` rows together and `length` pixels wide.
fn arms(width: u32, height: u32, runs: u32, length: u32) -> Case {
    let mask = Mask::from_fn(width, height, |x, y| {
        let (left, right) = (y < runs.div_ceil(2), y >= height - runs / 2);
        (left && x < length) || (right && x >= width - length)
    });
    Case { name: "synthetic".to_owned(), mask }
}

fn cases() -> Vec<Case> {
    let mut cases = vec![arms(752, 480, 482, 75), arms(960, 600, 413, 116), arms(1920, 1200, 818, 115)];
    let shared = std::env::var_os("UVCAM_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), Into::into);
    for name in ["grace_25003774.png", "charlotte_uav1_40494091.png"] {
        match Mask::load(&shared.join("data/masks").join(name)) {
            Ok(mask) => cases.push(Case { name: name.to_owned(), mask }),
            Err(error) => eprintln!("without {name}: {error}"),
        }
    }
    cases
}

/// Times `touch(arrived, old)` on slot after slot: a frame that has just been written, and a slot not in any
/// cache.
fn on_each_frame(bencher: Bencher, mask: &Mask, touch: impl Fn(&mut [u8], &mut [u8])) {
    let bytes = mask.width() as usize * mask.height() as usize;
    let half = SLOTS_BYTES / bytes / 2;
    let slots = RefCell::new(vec![vec![0; bytes]; 2 * half]);
    let slot = Cell::new(0);
    let arrive = || {
        slot.set((slot.get() + 1) % half);
        slots.borrow_mut()[slot.get()].fill(200);
    };
    bencher.with_inputs(arrive).bench_local_values(|()| {
        let mut slots = slots.borrow_mut();
        let (arrived, old) = slots.split_at_mut(half);
        touch(divan::black_box(&mut arrived[slot.get()]), divan::black_box(&mut old[slot.get()]));
    });
}

#[divan::bench(args = cases(), sample_count = 500, sample_size = 1)]
fn apply(bencher: Bencher, case: &Case) {
    let (width, height) = (case.mask.width(), case.mask.height());
    on_each_frame(bencher, &case.mask, |arrived, _| {
        let mut view =
            ImageViewMut::new(arrived, width, height, width as usize, 1).expect("size of the mask");
        case.mask.apply(&mut view).expect("size of the mask");
    });
}

#[divan::bench(args = cases(), sample_count = 500, sample_size = 1)]
fn memcpy(bencher: Bencher, case: &Case) {
    on_each_frame(bencher, &case.mask, |arrived, old| old.copy_from_slice(arrived));
}

#[divan::bench(args = cases(), sample_count = 500, sample_size = 1)]
fn and_whole_frame(bencher: Bencher, case: &Case) {
    let gray = case.mask.to_gray();
    on_each_frame(bencher, &case.mask, |arrived, _| {
        arrived.iter_mut().zip(gray.as_raw()).for_each(|(pixel, keep)| *pixel &= keep);
    });
}
