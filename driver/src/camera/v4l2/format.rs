//! Which of the device's formats becomes which pixel format, and how its rows lie in memory.

use std::fmt;

use uvcam_shm_ipc::PixelFormat;
use v4l::v4l_sys::{v4l2_field_V4L2_FIELD_NONE, v4l2_pix_format};

use crate::camera::{CameraError, Settings};

/// A format of <linux/videodev2.h>, by its four characters in the order of memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct FourCc(pub(super) [u8; 4]);

/// V4L2_PIX_FMT_GREY: one byte a pixel.
const GREY: FourCc = FourCc(*b"GREY");
/// V4L2_PIX_FMT_YUYV: the luma of every pixel, a sample of chroma after each.
const YUYV: FourCc = FourCc(*b"YUYV");
/// V4L2_PIX_FMT_Y10, Y12, Y16: 16-bit little-endian words, value in the low bits, as in PFNC Mono10, Mono12, Mono16.
const Y10: FourCc = FourCc(*b"Y10 ");
const Y12: FourCc = FourCc(*b"Y12 ");
const Y16: FourCc = FourCc(*b"Y16 ");

impl fmt::Display for FourCc {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(String::from_utf8_lossy(&self.0).trim())
    }
}

/// The formats that give `pixel_format`, best first.
fn candidates(pixel_format: PixelFormat) -> &'static [FourCc] {
    match pixel_format {
        PixelFormat::Mono8 => &[GREY, YUYV],
        PixelFormat::Mono10 => &[Y10],
        PixelFormat::Mono12 => &[Y12],
        PixelFormat::Mono16 => &[Y16],
    }
}

/// The format to ask for, of those that the device offers.
///
/// # Errors
/// [`CameraError::Refused`] with what it offers.
pub(super) fn choose(pixel_format: PixelFormat, offered: &[FourCc]) -> Result<FourCc, CameraError> {
    let wanted = candidates(pixel_format);
    wanted.iter().copied().find(|fourcc| offered.contains(fourcc)).ok_or_else(|| {
        let list = |formats: &[FourCc]| formats.iter().map(FourCc::to_string).collect::<Vec<_>>().join(", ");
        CameraError::Refused {
            setting: "pixel_format",
            asked: format!("{pixel_format} ({})", list(wanted)),
            applied: list(offered),
            remedy:
                "choose one of Mono8 (GREY, YUYV), Mono10 (Y10), Mono12 (Y12) and Mono16 (Y16) that it offers"
                    .into(),
        }
    })
}

/// How a frame lies in the device's memory, and what becomes of it in a slot, whose rows have no padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Layout {
    fourcc: FourCc,
    /// Bytes of a row in the slot.
    row_bytes: usize,
    /// Bytes from one row to the next in the device's memory.
    stride: usize,
    rows: usize,
    /// Bytes that the device wants for a frame, padding behind the last row included.
    buffer_bytes: usize,
}

impl Layout {
    /// Takes what the device gives for `fourcc`.
    ///
    /// # Errors
    /// [`CameraError::Refused`] where that is another size, another format, interlaced, or rows longer than their distance.
    pub(super) fn of(given: &v4l2_pix_format, fourcc: FourCc, asked: &Settings) -> Result<Self, CameraError> {
        let refused = |setting, asked: String, applied: String, remedy: &str| {
            Err(CameraError::Refused { setting, asked, applied, remedy: remedy.into() })
        };
        let given_fourcc = FourCc(given.pixelformat.to_le_bytes());
        if given_fourcc != fourcc {
            let remedy = "choose a format that it has at this size";
            return refused("pixel_format", fourcc.to_string(), given_fourcc.to_string(), remedy);
        }
        if (given.width, given.height) != (asked.width, asked.height) {
            return refused(
                "width and height",
                format!("{}x{}", asked.width, asked.height),
                format!("{}x{}", given.width, given.height),
                "set width and height to a size that the camera has in this format",
            );
        }
        if given.field != v4l2_field_V4L2_FIELD_NONE {
            let remedy = "this driver takes progressive cameras only";
            return refused("field", "progressive".into(), format!("V4L2_FIELD {}", given.field), remedy);
        }
        let row_bytes = given.width as usize * asked.pixel_format.bytes_per_pixel();
        let device_row_bytes = if fourcc == YUYV { 2 * row_bytes } else { row_bytes };
        let layout = Layout {
            fourcc,
            row_bytes,
            stride: given.bytesperline as usize,
            rows: given.height as usize,
            buffer_bytes: given.sizeimage as usize,
        };
        if layout.stride < device_row_bytes || layout.buffer_bytes < layout.frame_bytes() {
            return refused(
                "pixel_format",
                format!("{device_row_bytes} bytes a row of {fourcc}"),
                format!("{} bytes a row, {} a frame", layout.stride, layout.buffer_bytes),
                "its driver describes frames that cannot be; choose another format or size",
            );
        }
        Ok(layout)
    }

    /// Bytes of a frame in the device's memory, from its first row to its last.
    pub(super) fn frame_bytes(&self) -> usize {
        self.stride * self.rows
    }

    /// Whether a frame came entirely into memory of `memory_bytes`. A driver may claim to have used more bytes than there are.
    pub(super) fn is_whole(&self, bytes_used: usize, memory_bytes: usize) -> bool {
        bytes_used.min(memory_bytes) >= self.frame_bytes()
    }

    /// Bytes of a frame in a slot.
    pub(super) fn payload_bytes(&self) -> usize {
        self.row_bytes * self.rows
    }

    /// Bytes of a row in a slot.
    pub(super) fn row_bytes(&self) -> usize {
        self.row_bytes
    }

    /// Whether a frame lies in the device's memory as it is to lie in a slot.
    pub(super) fn is_slot(&self) -> bool {
        self.fourcc != YUYV
            && self.buffer_bytes == self.payload_bytes()
            && self.frame_bytes() == self.payload_bytes()
    }

    /// Writes the device's frame into a slot: rows without their padding; of YUYV the luma.
    pub(super) fn copy(&self, frame: &[u8], slot: &mut [u8]) {
        let rows = slot.chunks_exact_mut(self.row_bytes).zip(frame.chunks(self.stride));
        for (to, from) in rows {
            if self.fourcc == YUYV {
                for (luma, pixel) in to.iter_mut().zip(from.chunks_exact(2)) {
                    *luma = pixel[0];
                }
            } else if let Some(from) = from.get(..self.row_bytes) {
                to.copy_from_slice(from);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(width: u32, height: u32, pixel_format: PixelFormat) -> Settings {
        Settings { pixel_format, ..Settings::new(width, height, 50.0, 1000.0) }
    }

    fn given(fourcc: FourCc, (width, height): (u32, u32), stride: u32, bytes: u32) -> v4l2_pix_format {
        v4l2_pix_format {
            width,
            height,
            pixelformat: u32::from_le_bytes(fourcc.0),
            field: v4l2_field_V4L2_FIELD_NONE,
            bytesperline: stride,
            sizeimage: bytes,
            colorspace: 0,
            priv_: 0,
            flags: 0,
            __bindgen_anon_1: v4l::v4l_sys::v4l2_pix_format__bindgen_ty_1 { ycbcr_enc: 0 },
            quantization: 0,
            xfer_func: 0,
        }
    }

    #[test]
    fn grey_is_preferred_to_a_conversion() {
        assert_eq!(choose(PixelFormat::Mono8, &[YUYV, GREY]).unwrap(), GREY);
        assert_eq!(choose(PixelFormat::Mono8, &[FourCc(*b"MJPG"), YUYV]).unwrap(), YUYV);
        assert_eq!(choose(PixelFormat::Mono12, &[GREY, Y12]).unwrap(), Y12);
    }

    #[test]
    fn a_refusal_tells_what_the_device_offers() {
        let error = choose(PixelFormat::Mono10, &[FourCc(*b"MJPG"), YUYV]).unwrap_err();
        assert!(error.is_refusal() && error.to_string().contains("Mono10 (Y10)"), "{error}");
        assert!(error.to_string().contains("MJPG, YUYV"), "{error}");
    }

    #[test]
    fn rows_without_padding_are_a_slot() {
        let asked = settings(8, 4, PixelFormat::Mono8);
        let layout = |stride, bytes| Layout::of(&given(GREY, (8, 4), stride, bytes), GREY, &asked).unwrap();
        assert!(layout(8, 32).is_slot());
        assert!(!layout(16, 64).is_slot(), "padding behind each row");
        assert!(!layout(8, 4096).is_slot(), "padding behind the last row");
        assert_eq!(layout(16, 64).payload_bytes(), 32);
        assert_eq!(layout(16, 64).frame_bytes(), 64);

        let asked = settings(8, 4, PixelFormat::Mono12);
        assert!(Layout::of(&given(Y12, (8, 4), 16, 64), Y12, &asked).unwrap().is_slot());
    }

    #[test]
    fn a_copy_drops_the_padding() {
        let asked = settings(3, 2, PixelFormat::Mono8);
        let layout = Layout::of(&given(GREY, (3, 2), 5, 10), GREY, &asked).unwrap();
        let mut slot = [0; 6];
        layout.copy(&[1, 2, 3, 99, 99, 4, 5, 6, 99, 99], &mut slot);
        assert_eq!(slot, [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn a_copy_of_yuyv_keeps_the_luma() {
        let asked = settings(4, 2, PixelFormat::Mono8);
        let layout = Layout::of(&given(YUYV, (4, 2), 10, 20), YUYV, &asked).unwrap();
        assert!(!layout.is_slot());
        let mut slot = [0; 8];
        let row = |first: u8| [first, 99, first + 1, 99, first + 2, 99, first + 3, 99, 77, 77];
        layout.copy(&[row(1), row(5)].concat(), &mut slot);
        assert_eq!(slot, [1, 2, 3, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn a_frame_is_whole_where_driver_and_memory_agree() {
        let asked = settings(8, 4, PixelFormat::Mono8);
        let layout = Layout::of(&given(GREY, (8, 4), 8, 32), GREY, &asked).unwrap();
        assert!(layout.is_whole(32, 32) && layout.is_whole(32, 4096));
        assert!(!layout.is_whole(31, 32), "a short frame");
        assert!(!layout.is_whole(32, 31), "a buffer that does not hold what its driver claims");
    }

    #[test]
    fn a_short_frame_is_copied_as_far_as_it_goes() {
        let asked = settings(3, 2, PixelFormat::Mono8);
        let layout = Layout::of(&given(GREY, (3, 2), 3, 6), GREY, &asked).unwrap();
        let mut slot = [9; 6];
        layout.copy(&[1, 2, 3, 4], &mut slot);
        assert_eq!(slot, [1, 2, 3, 9, 9, 9]);
    }

    #[test]
    fn what_was_not_asked_for_is_refused() {
        let asked = settings(8, 4, PixelFormat::Mono8);
        let refusal = |given: v4l2_pix_format| Layout::of(&given, GREY, &asked).unwrap_err().to_string();
        assert!(
            refusal(given(YUYV, (8, 4), 16, 64))
                .contains("pixel_format = GREY refused: the camera gives YUYV")
        );
        assert!(refusal(given(GREY, (16, 4), 16, 64)).contains("8x4 refused: the camera gives 16x4"));
        assert!(refusal(given(GREY, (8, 4), 7, 32)).contains("7 bytes a row"));
        assert!(refusal(given(GREY, (8, 4), 8, 31)).contains("31 a frame"));
        let interlaced = v4l2_pix_format { field: 4, ..given(GREY, (8, 4), 8, 32) };
        assert!(refusal(interlaced).contains("progressive"));
    }
}
