//! Slots that a device fills: by itself, through user pointers, or by one copy from a buffer of the kernel.
//!
//! Laws, on which every `unsafe` here rests:
//! 1. The memory of a user-pointer buffer is that of the slot that [`UserBuffer::Device`] holds. A slot's memory neither moves
//!    nor ends while the slot exists.
//! 2. The device writes into a buffer from its queueing until it is dequeued, the stream is switched off, or the device is
//!    closed, and at no other time. All that while the buffer is [`UserBuffer::Device`]: nobody else can touch the slot's pixels.
//! 3. Where the stream cannot be switched off, the slots stay until the device is closed: it is the first of the fields.
//! 4. A mapping is memory that the kernel filled, of the length that it was mapped with, until it is unmapped. While its buffer
//!    is dequeued nobody writes into it.

use std::collections::VecDeque;
use std::ffi::c_void;
use std::io;
use std::time::{Duration, Instant};

use uvcam_shm_ipc::{Slot, monotonic_ns};

use super::device::{Dequeued, Device, Ready};
use super::format::Layout;
use crate::camera::source::V4l2Memory;

/// The most buffers that a device has (VIDEO_MAX_FRAME).
const MOST_BUFFERS: usize = 32;

/// An open device, and the slots that it fills.
pub(super) struct Stream {
    // Law 3: first of the fields.
    device: Device,
    buffers: Buffers,
    /// Slots that the device does not know of.
    waiting: VecDeque<Slot>,
}

enum Buffers {
    None,
    UserPointer(Vec<UserBuffer>),
    Mapped(Vec<Mapping>),
}

/// A place for a slot's memory, by who has it.
enum UserBuffer {
    /// Nobody. The last slot lay at `address`: the kernel prepares memory that comes to another place than before anew, at some cost.
    Free { address: usize },
    /// The device: it writes into this slot.
    Device(Slot),
}

impl UserBuffer {
    /// Takes the slot back from the device, which must be done with it; `None` where it had none.
    fn take(&mut self) -> Option<Slot> {
        let UserBuffer::Device(slot) = self else { return None };
        let free = UserBuffer::Free { address: slot.address() };
        match std::mem::replace(self, free) {
            UserBuffer::Device(slot) => Some(slot),
            UserBuffer::Free { .. } => None,
        }
    }
}

/// A slot that a frame came into.
pub(super) struct Filled {
    pub(super) slot: Slot,
    pub(super) arrival_monotonic_ns: u64,
    /// What the driver says of the frame; `None` where it is not whole.
    pub(super) frame: Option<Frame>,
    /// Whether the driver gave its buffer back without any data, as it does with all of them where a transfer ends: there was no frame.
    pub(super) is_untouched: bool,
}

/// What the driver says of a whole frame.
pub(super) struct Frame {
    pub(super) sequence: u32,
    pub(super) timestamp_ns: Option<u64>,
    pub(super) is_of_exposure_start: bool,
}

impl Stream {
    pub(super) fn new(device: Device) -> Self {
        Stream { device, buffers: Buffers::None, waiting: VecDeque::new() }
    }

    pub(super) fn device(&self) -> &Device {
        &self.device
    }

    pub(super) fn is_started(&self) -> bool {
        !matches!(self.buffers, Buffers::None)
    }

    /// Hands over a slot to be filled entirely.
    pub(super) fn queue(&mut self, slot: Slot) -> io::Result<()> {
        self.waiting.push_back(slot);
        self.hand_over()
    }

    /// Starts the device with all slots queued so far, with the first of these memories that it takes, and returns that one.
    pub(super) fn start(&mut self, memories: &[V4l2Memory], layout: &Layout) -> io::Result<V4l2Memory> {
        let mut outcome = Err(io::Error::from(io::ErrorKind::Unsupported));
        for memory in memories {
            outcome = self.prepare(*memory, layout).map(|()| *memory);
            if outcome.is_ok() {
                break;
            }
            self.release();
        }
        let memory = outcome?;
        self.device.stream_on()?;
        Ok(memory)
    }

    /// Waits for the next slot that a frame came into. A frame for which there is no slot is lost.
    pub(super) fn next(&mut self, layout: &Layout, timeout: Duration) -> io::Result<Option<Filled>> {
        let start = Instant::now();
        let memory = match self.buffers {
            Buffers::Mapped(_) => V4l2Memory::Mapped,
            _ => V4l2Memory::UserPointer,
        };
        let mut ready = Ready::Nothing;
        loop {
            if let Some(done) = self.device.dequeue(memory)? {
                let arrival_monotonic_ns = monotonic_ns();
                let is_untouched = done.damaged && done.bytes_used == 0;
                if let Some((slot, frame)) = self.take(&done, layout)? {
                    return Ok(Some(Filled { slot, arrival_monotonic_ns, frame, is_untouched }));
                }
            } else if ready == Ready::Failed {
                return Err(io::Error::other("its driver reports an error (POLLERR) and no cause"));
            }
            let left = timeout.saturating_sub(start.elapsed());
            ready = self.device.wait(left)?;
            if ready == Ready::Nothing && left.is_zero() {
                return Ok(None);
            }
        }
    }

    /// Stops the device and gives all slots back.
    pub(super) fn stop(&mut self) {
        self.release();
        self.waiting.clear();
    }

    /// Gets buffers, and hands them and the slots to the device.
    fn prepare(&mut self, memory: V4l2Memory, layout: &Layout) -> io::Result<()> {
        match memory {
            V4l2Memory::UserPointer => {
                let count = self.device.request_buffers(memory, MOST_BUFFERS)?.min(MOST_BUFFERS);
                self.buffers =
                    Buffers::UserPointer((0..count).map(|_| UserBuffer::Free { address: 0 }).collect());
                self.hand_over()
            }
            V4l2Memory::Mapped => {
                let wanted = self.waiting.len().clamp(2, MOST_BUFFERS);
                let count = self.device.request_buffers(memory, wanted)?.min(MOST_BUFFERS);
                self.buffers = Buffers::Mapped(Vec::new());
                let mappings: Vec<Mapping> =
                    (0..count).map(|index| Mapping::of(&self.device, index)).collect::<io::Result<_>>()?;
                if let Some(short) = mappings.iter().find(|mapping| mapping.length < layout.frame_bytes()) {
                    let (bytes, needed) = (short.length, layout.frame_bytes());
                    let cause = format!("its driver has buffers of {bytes} bytes for frames of {needed}");
                    return Err(io::Error::other(cause));
                }
                self.buffers = Buffers::Mapped(mappings);
                (0..count).try_for_each(|index| self.device.queue_mapped(index))
            }
        }
    }

    /// Hands waiting slots to the device, as far as it has places for them.
    fn hand_over(&mut self) -> io::Result<()> {
        let Buffers::UserPointer(buffers) = &mut self.buffers else { return Ok(()) };
        while let Some(mut slot) = self.waiting.pop_front() {
            let is_free = |buffer: &UserBuffer| matches!(buffer, UserBuffer::Free { .. });
            let is_its_own = |buffer: &UserBuffer| match buffer {
                UserBuffer::Free { address } => *address == slot.address(),
                UserBuffer::Device(_) => false,
            };
            let place = buffers.iter().position(is_its_own).or_else(|| buffers.iter().position(is_free));
            let Some(place) = place else {
                self.waiting.push_front(slot);
                return Ok(());
            };
            // SAFETY: laws 1 and 2: the buffer is the device's from here on.
            let outcome = unsafe { self.device.queue_user_pointer(place, slot.as_mut_ptr(), slot.len()) };
            if let Err(error) = outcome {
                self.waiting.push_front(slot);
                return Err(error);
            }
            buffers[place] = UserBuffer::Device(slot);
        }
        Ok(())
    }

    /// The slot that the frame is in; `None` where there was none for it.
    fn take(&mut self, done: &Dequeued, layout: &Layout) -> io::Result<Option<(Slot, Option<Frame>)>> {
        let frame_within = |memory_bytes: usize| {
            (!done.damaged && layout.is_whole(done.bytes_used, memory_bytes)).then_some(Frame {
                sequence: done.sequence,
                timestamp_ns: done.timestamp_ns,
                is_of_exposure_start: done.is_of_exposure_start,
            })
        };
        let unknown = || io::Error::other(format!("its driver returned the unknown buffer {}", done.index));
        match &mut self.buffers {
            Buffers::UserPointer(buffers) => {
                let buffer = buffers.get_mut(done.index).ok_or_else(unknown)?;
                let slot = buffer.take().ok_or_else(unknown)?;
                let frame = frame_within(slot.len());
                self.hand_over()?;
                Ok(Some((slot, frame)))
            }
            Buffers::Mapped(mappings) => {
                let mapping = mappings.get(done.index).ok_or_else(unknown)?;
                let frame = frame_within(mapping.length);
                let mut slot = self.waiting.pop_front();
                if let (Some(_), Some(slot)) = (&frame, slot.as_mut()) {
                    layout.copy(mapping.bytes(), slot.pixels_mut());
                }
                self.device.queue_mapped(done.index)?;
                Ok(slot.map(|slot| (slot, frame)))
            }
            Buffers::None => Err(unknown()),
        }
    }

    /// Takes everything back from the device.
    fn release(&mut self) {
        if !self.is_started() {
            return;
        }
        // Law 3. A device that is gone does not answer any more.
        if self.device.stream_off().is_err() {
            return;
        }
        let memory = match std::mem::replace(&mut self.buffers, Buffers::None) {
            Buffers::None => return,
            Buffers::UserPointer(mut buffers) => {
                self.waiting.extend(buffers.iter_mut().filter_map(UserBuffer::take));
                V4l2Memory::UserPointer
            }
            // Unmapped here: the kernel frees no buffer that is mapped.
            Buffers::Mapped(_) => V4l2Memory::Mapped,
        };
        // Where it fails, the next format is refused.
        let _ = self.device.request_buffers(memory, 0);
    }
}

/// A buffer of the kernel.
struct Mapping {
    memory: *mut c_void,
    length: usize,
}

// SAFETY: law 4: the pages belong to the process, not to a thread.
unsafe impl Send for Mapping {}

impl Mapping {
    fn of(device: &Device, index: usize) -> io::Result<Self> {
        let (offset, length) = device.query_buffer(index)?;
        Ok(Mapping { memory: device.map(offset, length)?, length })
    }

    /// What the device wrote. Its buffer must be dequeued.
    fn bytes(&self) -> &[u8] {
        // SAFETY: law 4.
        unsafe { std::slice::from_raw_parts(self.memory.cast(), self.length) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: law 4: this is its end. It fails only for what is no mapping.
        let _ = unsafe { rustix::mm::munmap(self.memory, self.length) };
    }
}
