use proptest::array::uniform32;
use proptest::prelude::*;

use super::*;

/// What a consumer finds in memory that anybody may have written.
fn from_bytes(bytes: &[u8; size_of::<FrameHeader>()]) -> FrameHeader {
    // SAFETY: as many bytes as the header has, and any bytes are a valid header.
    unsafe { bytes.as_ptr().cast::<FrameHeader>().read_unaligned() }
}

fn valid() -> FrameHeader {
    FrameHeader::new(752, 480, 752, PixelFormat::Mono8)
}

#[test]
fn a_new_header_describes_its_image() {
    assert_eq!(valid().validate(752 * 480), Ok(752 * 480));
    let padded = FrameHeader::new(100, 10, 256, PixelFormat::Mono12);
    assert_eq!(padded.validate(256 * 10), Ok(256 * 9 + 200));
    assert_eq!(padded.pixel_format(), Ok(PixelFormat::Mono12));
}

#[test]
fn a_header_in_memory_begins_with_the_magic() {
    let header = valid();
    // SAFETY: a header has this many bytes, and no padding.
    let bytes = unsafe { *(&raw const header).cast::<[u8; 8]>() };
    assert_eq!(&bytes, b"UVCM\x02\x00\xc0\x00");
}

#[test]
fn a_slot_without_a_header_is_refused() {
    assert_eq!(FrameHeader::default().validate(usize::MAX), Err(HeaderError::Magic(0)));
}

#[test]
fn every_wrong_field_is_named() {
    let refusal = |spoil: fn(&mut FrameHeader)| {
        let mut header = valid();
        spoil(&mut header);
        header.validate(752 * 480).unwrap_err()
    };
    assert_eq!(refusal(|header| header.magic ^= 1), HeaderError::Magic(MAGIC ^ 1));
    assert_eq!(refusal(|header| header.contract_version = 1), HeaderError::ContractVersion(1));
    assert_eq!(refusal(|header| header.header_size = 191), HeaderError::HeaderSize(191));
    assert!(matches!(refusal(|header| header.pixel_format = 0), HeaderError::PixelFormat(_)));
    assert_eq!(refusal(|header| header.width = 0), HeaderError::Size { width: 0, height: 480 });
    assert_eq!(refusal(|header| header.height = 65_536), HeaderError::Size { width: 752, height: 65_536 });
    assert_eq!(refusal(|header| header.stride = 751), HeaderError::Stride { stride: 751, row_bytes: 752 });
    let too_long = HeaderError::Payload { image_bytes: 753 * 479 + 752, payload_len: 752 * 480 };
    assert_eq!(refusal(|header| header.stride = 753), too_long);
}

#[test]
fn mask_and_flag_go_together() {
    let mut header = valid();
    header.set_flag(Flags::SIMULATED, true);
    header.set_mask(Some([7; 16]));
    assert!(header.flags.contains(Flags::MASKED | Flags::SIMULATED));
    assert_eq!(header.mask_id, [7; 16]);
    assert_eq!(format!("{:?}", header.flags), "0x3 [MASKED | SIMULATED]");
    // A bit that this version does not know, as a later one may write it.
    let unknown = header.flags | Flags::from_bits_retain(1 << 31);
    assert_eq!(format!("{unknown:?}"), "0x80000003 [MASKED | SIMULATED | 0x80000000]");
    assert_eq!(format!("{:?}", Flags::NONE), "0x0 []");
    header.set_mask(None);
    assert_eq!(header.flags, Flags::SIMULATED);
    assert_eq!(header.mask_id, [0; 16]);
}

/// Sizes as they are met, and at their borders.
fn side() -> impl Strategy<Value = u32> {
    prop_oneof![0..5u32, 700..800u32, 65_530..65_540u32, any::<u32>()]
}

fn pixel_format() -> impl Strategy<Value = u32> {
    prop_oneof![4 => proptest::sample::select(PixelFormat::ALL.to_vec()).prop_map(PixelFormat::code), 1 => any::<u32>()]
}

proptest! {
    #[test]
    fn any_bytes_are_judged_without_panic(head in uniform32(any::<u8>()), tail: u8, payload_len: usize, sign: bool) {
        let mut bytes = [tail; size_of::<FrameHeader>()];
        bytes[..32].copy_from_slice(&head);
        if sign {
            bytes[..8].copy_from_slice(b"UVCM\x02\x00\xc0\x00");
        }
        if let Ok(image_bytes) = from_bytes(&bytes).validate(payload_len) {
            prop_assert!(image_bytes <= payload_len);
        }
    }

    #[test]
    fn what_passes_lies_within_the_payload(
        width in side(),
        height in side(),
        stride in side(),
        pixel_format in pixel_format(),
        payload_len in prop_oneof![0..2_000_000usize, any::<usize>()],
    ) {
        let header = FrameHeader { width, height, stride, pixel_format, ..valid() };
        let expected = PixelFormat::from_code(pixel_format).and_then(|format| {
            let row_bytes = u128::from(width) * format.bytes_per_pixel() as u128;
            let image_bytes = u128::from(stride) * u128::from(height).checked_sub(1)? + row_bytes;
            let fits = (1..=65_535).contains(&width) && height <= 65_535 && row_bytes <= u128::from(stride);
            (fits && image_bytes <= payload_len as u128).then_some(image_bytes as usize)
        });
        prop_assert_eq!(header.validate(payload_len).ok(), expected);
    }
}
