//! A publisher that does not keep to the contract: consumers believe nothing that they have not checked.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod support;

use iceoryx2::prelude::*;
use support::*;
use uvcam_shm_ipc::{FrameHeader, frame_service_name, wake_service_name};

type Frames = iceoryx2::port::publisher::Publisher<ipc_threadsafe::Service, [u8], FrameHeader>;

/// The services of a camera, made without this crate.
fn raw_services(place: &Place) -> (Frames, impl Sized) {
    let config = place.settings.to_iceoryx2().unwrap();
    let node = NodeBuilder::new().config(&config).create::<ipc_threadsafe::Service>().unwrap();
    let wake = node
        .service_builder(&ServiceName::new(&wake_service_name(CAMERA)).unwrap())
        .event()
        .create()
        .unwrap();
    let frames = node
        .service_builder(&ServiceName::new(&frame_service_name(CAMERA)).unwrap())
        .publish_subscribe::<[u8]>()
        .user_header::<FrameHeader>()
        .subscriber_max_buffer_size(64)
        .create()
        .unwrap();
    let publisher = frames.publisher_builder().initial_max_slice_len(FRAME_BYTES).create().unwrap();
    (publisher, (frames, wake, node))
}

/// As a driver counts whose every frame goes out.
fn counted(sequence: u64) -> FrameHeader {
    with(header(7, sequence), |it| (it.counting, it.produced) = (1, sequence))
}

fn send(publisher: &Frames, header: FrameHeader, payload_len: usize) {
    let mut sample = publisher.loan_slice(payload_len).unwrap();
    *sample.user_header_mut() = header;
    sample
        .payload_mut()
        .iter_mut()
        .enumerate()
        .for_each(|(index, byte)| *byte = pixel(header.sequence, index));
    sample.send().unwrap();
}

#[test]
fn frames_that_lie_are_rejected_and_counted() {
    let place = Place::new();
    let (publisher, _services) = raw_services(&place);
    let mut subscriber = place.subscriber();
    let good = header(7, 0);
    let lies = [
        FrameHeader::default(),
        with(good, |it| it.magic = 0x5555_5555),
        with(good, |it| it.contract_version = 9),
        with(good, |it| it.header_size = 64),
        with(good, |it| it.pixel_format = 0x0210_0032),
        with(good, |it| (it.width, it.height, it.stride) = (u32::MAX, u32::MAX, u32::MAX)),
        with(good, |it| it.height = HEIGHT + 1),
        with(good, |it| it.stride = WIDTH - 1),
    ];
    lies.iter().for_each(|lie| send(&publisher, *lie, FRAME_BYTES));
    // A payload shorter than the header tells.
    send(&publisher, good, FRAME_BYTES - 1);
    assert!(subscriber.receive().unwrap().is_none());
    assert_eq!((subscriber.frames(), subscriber.rejected(), subscriber.epochs()), (0, 9, 0));

    send(&publisher, counted(0), FRAME_BYTES);
    send(&publisher, FrameHeader::default(), FRAME_BYTES);
    send(&publisher, counted(1), FRAME_BYTES);
    assert_pixels(&receive(&mut subscriber));
    assert_eq!(receive(&mut subscriber).lost_before(), 0);
    assert_eq!((subscriber.frames(), subscriber.rejected(), subscriber.lost()), (2, 10, 0));
}

#[test]
fn a_stream_that_runs_backwards_counts_no_loss() {
    let place = Place::new();
    let (publisher, _services) = raw_services(&place);
    let mut subscriber = place.subscriber();
    for sequence in [5, 3, 3, u64::MAX] {
        send(&publisher, counted(sequence), FRAME_BYTES);
    }
    let lost: Vec<_> = drain(&mut subscriber).into_iter().map(|(_, lost)| lost).collect();
    assert_eq!(lost, [0, 0, 0, u64::MAX - 4]);
}
