//! The driver's end: slots on loan, filled in place, sent.
//!
//! Laws of slot memory:
//! 1. A slot is memory of a mapped file, given out zeroed by the kernel or with the bytes of an earlier frame: never
//!    uninitialised, whatever the type says.
//! 2. A slot on loan is reached through its [`Slot`] alone: iceoryx2 hands out no other reference, and consumers get it when it is
//!    sent. Its address stays the same for the life of the publisher.

use std::error::Error;

use iceoryx2::port::DegradationAction;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut::SampleMut;
use rustix::fs::statvfs;

use crate::cleanup::forget_segments;
use crate::clock::{monotonic_ns, realtime_ns};
use crate::error::{Fault, IpcError, LoanError, LoanFailure, SettingError};
use crate::footing::{Footing, marks_of};
use crate::frame_service::{self, FrameService, WakeService};
use crate::header::FrameHeader;
use crate::prefetch::prefetch;
use crate::premises;
use crate::production::Production;
use crate::quirks::{Ipc, SHARED_MEMORY};
use crate::resident;
use crate::service::{Address, patiently};
use crate::settings::{ROOM_BYTES, Settings, shared_memory_needed, slots_needed};
use crate::wake_word::WakeWord;

/// Publishes the frames of one camera. There is one for each camera on a host.
#[derive(Debug)]
pub struct Publisher {
    // Dropped in this order: a successor that finds no publisher finds no notifier either, and nobody who writes to the wake word's page.
    wake_word: WakeWord,
    notifier: Notifier<Ipc>,
    publisher: iceoryx2::port::publisher::Publisher<Ipc, [u8], FrameHeader>,
    wake: WakeService,
    frames: FrameService,
    address: Address,
    frame_bytes: usize,
    loans: usize,
    production: Production,
    footing: Footing,
}

impl Publisher {
    /// Makes the services of `camera` and the memory for frames of `frame_bytes`, of which `loans` can be on loan at a time.
    ///
    /// Cleans up after killed programs first, and counts on from where the driver before ended. A predecessor that is just stopping, and
    /// consumers that hold services made with other settings, get 3 s to go. The memory of all slots is taken at once.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, another driver that publishes this camera, services of other
    /// settings still held, too little space in `/dev/shm`, files of another user.
    pub fn create(
        settings: &Settings,
        camera: &str,
        frame_bytes: usize,
        loans: usize,
    ) -> Result<Publisher, IpcError> {
        if frame_bytes == 0 || loans == 0 {
            let (key, found) = if loans == 0 { ("loans", loans) } else { ("frame_bytes", frame_bytes) };
            return Err(SettingError::new(key, found, "1 or more").into());
        }
        patiently(|| {
            let address = Address::for_publisher(settings, camera)?;
            Publisher::try_create(address, settings, frame_bytes, loans)
        })
    }

    fn try_create(
        address: Address,
        settings: &Settings,
        frame_bytes: usize,
        loans: usize,
    ) -> Result<Publisher, IpcError> {
        let node = address.driver_node(open_files(settings), premises::MAPPED_BYTES)?;
        let (frames, wake) = frame_service::create(&address, &node, settings)?;
        if frames.dynamic_config().number_of_publishers() > 0 {
            return Err(Fault::AlreadyPublishing(address.camera).into());
        }
        let turn = premises::take_turn(&address.config);
        let need_bytes = check_space(&address.camera, &frames, frame_bytes, loans)?;
        let publisher = frames
            .publisher_builder()
            .initial_max_slice_len(frame_bytes)
            .max_loaned_samples(loans)
            .allocation_strategy(AllocationStrategy::Static)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            // A consumer that cannot be reached notices it by itself; the others get their frames, and nobody writes a log here.
            .set_degradation_handler(|_, _| DegradationAction::Ignore)
            .create()
            .map_err(|source| match source {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    Fault::AlreadyPublishing(address.camera.clone()).into()
                }
                PublisherCreateError::UnableToCreateDataSegment => {
                    forget_segments(&address.config, node.id().value());
                    not_mapped(&address.camera, need_bytes, Box::new(source))
                }
                _ => address.failed("creating the publisher of", frames.name().as_str(), source),
            })?;
        let notifier = wake
            .notifier_builder()
            .create()
            .map_err(|source| address.failed("creating the notifier of", wake.name().as_str(), source))?;
        let path = address.wake_word();
        premises::check_ours(&path)?;
        let wake_word = WakeWord::create(&path).map_err(|source| {
            address.failed("creating the wake word", &path.display().to_string(), source)
        })?;
        let production = Production::resume(wake_word.kept(), realtime_ns());
        let ports = [publisher.id().value(), node.id().value()].map(|number| number.to_string());
        let marks = [marks_of(&frames), marks_of(&wake), ports].concat();
        let mut footing = Footing::of(&address.config, &marks);
        footing.add(path);
        let publisher = Publisher {
            footing,
            wake_word,
            notifier,
            publisher,
            wake,
            frames,
            address,
            frame_bytes,
            loans,
            production,
        };
        publisher.take_memory()?;
        publisher.address.take_small_files()?;
        drop(turn);
        Ok(publisher)
    }

    /// Takes the memory of all slots from the system, so that no frame has to wait for it.
    fn take_memory(&self) -> Result<(), IpcError> {
        let failed = |source: Box<dyn Error + Send + Sync>| {
            let on = self.frames.name().as_str().to_owned();
            IpcError::from(Fault::System { doing: "taking the memory of", on, source })
        };
        // All slots lie in one mapping.
        let slot = self.loan().map_err(|error| failed(Box::new(error)))?;
        resident::make_present(slot.sample.payload().as_ptr().expose_provenance())
            .map_err(|error| failed(Box::new(error)))
    }

    /// Takes a slot on loan. Never waits. Fails only when `loans` of them are out: slots that consumers hold are counted apart.
    ///
    /// # Errors
    /// [`LoanError::AllOnLoan`], or [`LoanError::Failed`] where iceoryx2 itself fails.
    pub fn loan(&self) -> Result<Slot, LoanError> {
        match self.publisher.loan_slice_uninit(self.frame_bytes) {
            // SAFETY: law 1.
            Ok(sample) => Ok(Slot { sample: unsafe { sample.assume_init() } }),
            Err(iceoryx2::port::LoanError::ExceedsMaxLoans) => Err(LoanError::AllOnLoan(self.loans)),
            Err(source) => Err(LoanError::Failed(LoanFailure(source))),
        }
    }

    /// To be called when a frame is there, and is worked on before it is published: what [`Publisher::publish`] writes to is fetched
    /// meanwhile.
    #[inline]
    pub fn prefetch(&self, slot: &Slot) {
        prefetch(self.wake_word.kept_in());
        prefetch(slot.sample.user_header());
    }

    /// Sends a filled slot under a copy of `header`, wakes consumers that sleep, and returns how many consumers got it.
    ///
    /// Never waits: a consumer whose buffer is full loses its oldest frame. Fills `counting`, `produced` and `send_monotonic_ns`.
    ///
    /// # Errors
    /// [`IpcErrorKind::Header`](crate::IpcErrorKind::Header) where the header does not describe the slot;
    /// [`IpcErrorKind::System`](crate::IpcErrorKind::System) where iceoryx2 fails. The frame was then
    /// not counted: it is one for [`Publisher::count_lost`].
    #[inline]
    pub fn publish(&mut self, mut slot: Slot, header: &FrameHeader) -> Result<usize, IpcError> {
        header.validate(slot.len())?;
        let produced = self.production.after(1);
        // Before the frame goes out: a driver that is killed in between has lost it, and its successor's first frame says so.
        self.wake_word.keep(&produced);
        let sent = slot.sample.user_header_mut();
        *sent = *header;
        sent.counting = produced.counting;
        sent.produced = produced.produced;
        sent.send_monotonic_ns = monotonic_ns();
        let reached = self.send(slot)?;
        self.production = produced;
        Ok(reached)
    }

    /// Counts frames that the device produced and that will not be published: the next frame tells, of whichever epoch.
    #[inline]
    pub fn count_lost(&mut self, frames: u64) {
        self.production = self.production.after(frames);
        self.wake_word.keep(&self.production);
    }

    /// Begins an epoch, and returns its identity for [`FrameHeader::epoch`]: CLOCK_REALTIME in ns, always above the one before, whoever
    /// began that.
    pub fn begin_epoch(&mut self) -> u64 {
        self.production = self.production.in_next_epoch(realtime_ns());
        self.wake_word.keep(&self.production);
        self.production.epoch
    }

    /// iceoryx2's part of it, which stays in one piece: spread over its caller, it becomes slower.
    #[inline(never)]
    fn send(&self, slot: Slot) -> Result<usize, IpcError> {
        let reached = slot.sample.send().map_err(|source| {
            self.address.failed("sending a frame through", self.frames.name().as_str(), source)
        })?;
        self.wake_word.announce();
        if self.wake.dynamic_config().number_of_listeners() > 0 {
            // As for the wake word: who cannot be woken finds the frame when its own wait ends.
            let _ = self.notifier.notify();
        }
        Ok(reached)
    }

    /// Consumers connected at this moment. One that was killed counts until [`cleanup_dead_nodes`](crate::cleanup_dead_nodes).
    pub fn subscribers(&self) -> usize {
        self.frames.dynamic_config().number_of_subscribers()
    }

    /// The files that consumers find this publisher by. Where one is no longer in place, this publisher is to be dropped, and another one
    /// made.
    pub fn footing(&self) -> &Footing {
        &self.footing
    }

    /// Bytes of one slot.
    pub fn frame_bytes(&self) -> usize {
        self.frame_bytes
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.wake_word.keep_anew(&self.production);
    }
}

/// Files that a publisher has open once all consumers that there can be are connected.
fn open_files(settings: &Settings) -> u64 {
    premises::FILES.saturating_add(2 * settings.max_subscribers as u64)
}

fn not_mapped(camera: &str, need_bytes: u64, source: Box<dyn Error + Send + Sync>) -> IpcError {
    Fault::NotMapped { camera: camera.to_owned(), need_bytes, source }.into()
}

/// Refuses with figures before memory is taken.
fn check_space(
    camera: &str,
    frames: &FrameService,
    frame_bytes: usize,
    loans: usize,
) -> Result<u64, IpcError> {
    let found = frames.static_config();
    let slots = slots_needed(
        found.max_subscribers(),
        found.subscriber_max_buffer_size(),
        found.subscriber_max_borrowed_samples(),
        loans,
    );
    let need_bytes = shared_memory_needed(slots, frame_bytes);
    let free = statvfs(SHARED_MEMORY).map_err(|source| Fault::System {
        doing: "reading the free space of",
        on: SHARED_MEMORY.to_owned(),
        source: Box::new(source),
    })?;
    let free_bytes = free.f_bavail.saturating_mul(free.f_frsize);
    // Consumers need some room as well.
    let need_free_bytes = need_bytes.saturating_add(ROOM_BYTES);
    if need_free_bytes > free_bytes {
        let need_bytes = need_free_bytes;
        return Err(
            Fault::SharedMemoryFull { camera: camera.to_owned(), slots, need_bytes, free_bytes }.into()
        );
    }
    if let Some(left_bytes) = premises::address_space_left().filter(|left_bytes| *left_bytes < need_bytes) {
        let source = format!("{} MB of address space are left", left_bytes / 1_000_000);
        return Err(not_mapped(camera, need_bytes, source.into()));
    }
    Ok(need_bytes)
}

/// Shared memory for one frame, in the hands of whoever holds this. Dropped, it goes back unsent.
#[derive(Debug)]
pub struct Slot {
    sample: SampleMut<Ipc, [u8], FrameHeader>,
}

impl Slot {
    /// The first byte. Valid for [`Slot::len`] bytes, for reads and writes, until the slot is published or dropped; 64-byte aligned.
    pub fn as_mut_ptr(&mut self) -> *mut u8 {
        self.pixels_mut().as_mut_ptr()
    }

    /// The address of the first byte: names this piece of memory for the life of the publisher.
    pub fn address(&self) -> usize {
        self.sample.payload().as_ptr().addr()
    }

    /// Bytes in the slot: the frame size that the publisher was created with.
    #[allow(clippy::len_without_is_empty, reason = "a slot is never empty")]
    pub fn len(&self) -> usize {
        self.sample.payload().len()
    }

    /// The bytes, to be written. Holds an earlier frame's, or zeros.
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        self.sample.payload_mut()
    }
}
