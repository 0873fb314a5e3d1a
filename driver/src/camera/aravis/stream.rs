//! Frames written by the library straight into the memory of slots.
//!
//! Laws, on which every `unsafe` here rests:
//! 1. A buffer's memory is that of the slot that [`SlotBuffer::queued`] holds. A slot's memory neither moves nor ends while the
//!    slot exists.
//! 2. The library writes into a buffer from the push until it is popped or its stream is dropped, and at no other time. All
//!    that while the slot lies in `queued`: nobody else can touch its pixels.
//! 3. There is one reference to the stream, in [`SlotStream`]. Dropping it joins the library's thread, and it is dropped before
//!    the slots, in `stop` as by the order of fields.
//! 4. One address has one buffer of one size for the life of a stream, however often slots come by: the library may bind what
//!    it knows about memory to the buffer that first came with it. Slots that exist at the same time never share an address.

use std::time::Duration;

use aravis::prelude::*;
use aravis::{Buffer, BufferStatus, Stream};
use uvcam_shm_ipc::{Slot, monotonic_ns};

/// A stream and the slots that it fills.
#[derive(Debug, Default)]
pub(super) struct SlotStream {
    // Law 3: first of the fields.
    stream: Option<Stream>,
    buffers: Vec<SlotBuffer>,
}

#[derive(Debug)]
struct SlotBuffer {
    address: usize,
    buffer: Buffer,
    queued: Option<Slot>,
}

/// A slot that the library is done with.
pub(super) struct Filled {
    pub(super) slot: Slot,
    pub(super) arrival_monotonic_ns: u64,
    /// What the device said of the frame; `None` where the frame is not whole, and the buffer still tells about an earlier one.
    pub(super) frame: Option<Frame>,
}

/// What the device says of a whole frame.
pub(super) struct Frame {
    pub(super) id: u64,
    pub(super) timestamp_ns: u64,
}

impl SlotStream {
    /// Hands over a slot to be filled entirely.
    pub(super) fn queue(&mut self, mut slot: Slot) {
        let address = slot.address();
        let place = match self.buffers.iter().position(|buffer| buffer.address == address) {
            Some(place) => place,
            None => {
                // SAFETY: laws 1 to 3: the slot is kept until the library is done with its memory.
                let buffer = unsafe { Buffer::new_preallocated_borrowed(slot.as_mut_ptr(), slot.len()) };
                self.buffers.push(SlotBuffer { address, buffer, queued: None });
                self.buffers.len() - 1
            }
        };
        let entry = &mut self.buffers[place];
        entry.queued = Some(slot);
        if let Some(stream) = &self.stream {
            stream.push_buffer(entry.buffer.clone());
        }
    }

    /// Takes the stream over, and gives it all slots queued so far.
    pub(super) fn start(&mut self, stream: Stream) {
        for entry in self.buffers.iter().filter(|entry| entry.queued.is_some()) {
            stream.push_buffer(entry.buffer.clone());
        }
        self.stream = Some(stream);
    }

    pub(super) fn is_started(&self) -> bool {
        self.stream.is_some()
    }

    /// Waits for the next slot that the library is done with.
    pub(super) fn next(&mut self, timeout: Duration) -> Option<Filled> {
        let timeout_us = u64::try_from(timeout.as_micros()).unwrap_or(u64::MAX);
        let buffer = self.stream.as_ref()?.timeout_pop_buffer(timeout_us)?;
        let arrival_monotonic_ns = monotonic_ns();
        let (address, received_bytes) = buffer.data();
        let entry = self.buffers.iter_mut().find(|entry| entry.address == address as usize)?;
        let slot = entry.queued.take()?;
        // Only a whole frame carries its own id: the others keep what their buffer held before.
        let whole = buffer.status() == BufferStatus::Success && received_bytes == slot.len();
        let frame = whole.then(|| Frame { id: buffer.frame_id(), timestamp_ns: buffer.timestamp() });
        Some(Filled { slot, arrival_monotonic_ns, frame })
    }

    /// Ends the stream and gives all slots back.
    pub(super) fn stop(&mut self) {
        // Law 3: in this order.
        self.stream = None;
        self.buffers.clear();
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use uvcam_shm_ipc::{Publisher, Settings};

    use super::*;
    use crate::camera::aravis::discovery;

    const SLOTS: usize = 4;

    #[test]
    fn the_library_writes_into_the_memory_of_the_slots() {
        let camera = discovery::open("Fake_1").unwrap().camera;
        camera.set_region(0, 0, 64, 48).unwrap();
        camera.set_float("AcquisitionFrameRate", 500.0).unwrap();
        let root = tempfile::Builder::new().prefix("uv").tempdir_in("/tmp").unwrap();
        let prefix = root.path().file_name().unwrap().to_str().unwrap().replace('.', "");
        let settings = Settings::new(prefix, root.path());
        let publisher = Publisher::create(&settings, "camera", 64 * 48, SLOTS).unwrap();

        let mut slots = SlotStream::default();
        let mut addresses = HashSet::new();
        for _ in 0..SLOTS {
            let slot = publisher.loan().unwrap();
            addresses.insert(slot.address());
            slots.queue(slot);
        }
        slots.start(camera.create_stream().unwrap());
        camera.start_acquisition().unwrap();
        for _ in 0..500 {
            let buffer = slots.stream.as_ref().unwrap().pop_buffer().unwrap();
            let (written_to, bytes) = buffer.data();
            let entry = slots.buffers.iter_mut().find(|entry| entry.buffer == buffer).unwrap();
            let mut slot = entry.queued.take().unwrap();
            assert_eq!((written_to, bytes), (slot.as_mut_ptr(), slot.len()));
            assert!(addresses.contains(&slot.address()));
            slots.queue(slot);
        }
        assert_eq!(slots.buffers.len(), SLOTS, "one buffer for each address");
    }
}
