use proptest::prelude::*;

use super::publisher::NewMask;
use super::*;

const WIDTH: u32 = 12;
const HEIGHT: u32 = 9;

/// A mask whose pixels are masked where `masked` says so, as it lies in memory.
fn mask_of(masked: &[bool]) -> (MaskHeader, Vec<u8>, Vec<Run>) {
    let mut runs = Vec::new();
    for (row, pixels) in (0..).zip(masked.chunks(WIDTH as usize)) {
        let mut start = 0;
        for stretch in pixels.chunk_by(|a, b| a == b) {
            let length = stretch.len() as u32;
            if stretch[0] {
                runs.push(Run { row, start, length });
            }
            start += length;
        }
    }
    let mask = NewMask {
        mask_id: [7; 16],
        width: WIDTH,
        height: HEIGHT,
        runs: &runs,
        provenance: "{\"a\": \"\u{10d}\"}",
    };
    let header = mask.header();
    let mut payload = vec![0xaa; header.payload_bytes()];
    mask.write(&header, &mut payload);
    (header, payload, runs)
}

fn any_mask() -> impl Strategy<Value = Vec<bool>> {
    proptest::collection::vec(proptest::bool::weighted(0.2), (WIDTH * HEIGHT) as usize)
}

proptest! {
    #[test]
    fn what_was_written_is_read(masked in any_mask()) {
        let (header, payload, runs) = mask_of(&masked);
        prop_assert_eq!(header.read(&payload), Some((runs, "{\"a\": \"\u{10d}\"}".to_owned())));
        let image: Vec<u8> = masked.iter().map(|masked| if *masked { DISCARD } else { KEEP }).collect();
        prop_assert_eq!(&payload[..header.image_bytes()], &image);
    }

    #[test]
    fn a_grown_mask_reaches_so_far_and_no_further(masked in any_mask(), by in 0..15_u32) {
        let (header, _, runs) = mask_of(&masked);
        let grown = grow(&header, &runs, by);
        for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let near = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (u, v))).any(|(u, v)| {
                masked[(v * WIDTH + u) as usize] && u.abs_diff(x) <= by && v.abs_diff(y) <= by
            });
            let expected = if near { DISCARD } else { KEEP };
            prop_assert_eq!(grown[(y * WIDTH + x) as usize], expected, "x {}, y {}", x, y);
        }
    }

    #[test]
    fn no_bytes_make_a_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), width in any::<u32>(), height in 0..4_u32, runs in any::<u32>(), provenance_bytes in any::<u32>()) {
        let header = MaskHeader { width, height, runs: runs % 20, provenance_bytes: provenance_bytes % 20, ..mask_of(&[]).0 };
        if let Some((runs, _)) = header.read(&bytes) {
            prop_assert!(are_sound(&runs, width, height));
        }
    }
}

#[test]
fn a_header_that_lies_is_not_believed() {
    let (good, payload, _) = mask_of(&[false, true, true, false, true]);
    assert!(good.read(&payload).is_some());
    for lie in [
        MaskHeader::default(),
        MaskHeader { magic: 0, ..good },
        MaskHeader { contract_version: 9, ..good },
        MaskHeader { header_size: 128, ..good },
        MaskHeader { width: 0, ..good },
        MaskHeader { height: u32::MAX, width: u32::MAX, ..good },
        MaskHeader { width: 4, ..good },
        MaskHeader { masked_px: 4, ..good },
        MaskHeader { runs: u32::MAX, ..good },
        MaskHeader { runs: 1, ..good },
        MaskHeader { provenance_bytes: u32::MAX, ..good },
    ] {
        assert_eq!(lie.read(&payload), None, "{lie:?}");
    }
    assert_eq!(good.read(&payload[..payload.len() - 1]), None);
}

#[test]
fn runs_out_of_order_outside_or_touching_are_not_sound() {
    let run = |row, start, length| Run { row, start, length };
    assert!(are_sound(&[], 4, 2));
    assert!(are_sound(&[run(0, 0, 1), run(0, 2, 2), run(1, 0, 4)], 4, 2));
    for runs in [
        &[run(0, 0, 0)][..],
        &[run(0, 3, 2)],
        &[run(2, 0, 1)],
        &[run(0, u32::MAX, u32::MAX)],
        &[run(0, 0, 2), run(0, 2, 1)],
        &[run(0, 2, 1), run(0, 0, 1)],
        &[run(1, 0, 1), run(0, 0, 1)],
    ] {
        assert!(!are_sound(runs, 4, 2), "{runs:?}");
    }
}
