//! A consumer's end: frames read where the driver wrote them.
//!
//! Laws of a received frame:
//! 1. The header is copied once, and only the copy is checked and believed.
//! 2. A driver does not write a slot that it has sent until every consumer has dropped it. One that breaks this can change pixels
//!    under a reader's eyes, never sizes: these come from the copy.
//! 3. What iceoryx2 itself keeps in shared memory is trusted: driver and consumers run under one user.

use std::sync::Arc;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::ReceiveError;
use iceoryx2::sample::Sample;

use crate::cleanup::cleanup;
use crate::clock::{after, monotonic_ns, until};
use crate::continuity::{Continuity, Step};
use crate::error::{Fault, IpcError};
use crate::header::FrameHeader;
use crate::mask::{Mask, MaskReader};
use crate::prediction::Prediction;
use crate::premises;
use crate::quirks::{Ipc, Received};
use crate::service::Address;
use crate::settings::Settings;
use crate::wakeup::Wakeup;

mod link;

use link::Link;

/// Time between attempts to find a driver.
const RETRY: Duration = Duration::from_millis(50);
/// Silence after which services without a driver are let go, so that the next driver can make them as it likes.
const SILENCE: Duration = Duration::from_secs(1);
/// How long a failing system is tried again before it is reported: files that others just make or remove come and go.
const TOLERANCE: Duration = Duration::from_secs(3);
/// Longest sleep before a look at whether the driver is still there.
const NAP: Duration = Duration::from_millis(100);

/// Reads the frames of one camera. Finds the driver when it comes, and again when it comes back.
#[derive(Debug)]
pub struct Subscriber {
    link: Option<Link>,
    node: Option<Node<Ipc>>,
    address: Address,
    /// When to look next whether there is a driver, CLOCK_MONOTONIC in ns: each frame puts it off.
    next_look_ns: u64,
    failing_since_ns: Option<u64>,
    continuity: Continuity,
    wakeup: Wakeup,
    prediction: Prediction,
    masks: MaskReader,
    /// Came while it was watched for.
    watched: Option<Sample<Ipc, [u8], FrameHeader>>,
    /// One more for each frame in the caller's hands.
    held: Arc<()>,
    frames: u64,
    lost: u64,
    epochs: u64,
    rejected: u64,
}

impl Subscriber {
    /// Prepares to read the frames of `camera`. The driver may come later: a consumer never makes a service.
    ///
    /// # Errors
    /// [`IpcError`]: a setting or camera name that cannot be, files of another user, a service of another version, or one with as
    /// many consumers as it can have.
    pub fn open(settings: &Settings, camera: &str) -> Result<Subscriber, IpcError> {
        let address = Address::new(settings, camera)?;
        premises::check_shared_memory()?;
        // Consumers that were killed give their places to this one.
        cleanup(&address.config);
        let mut subscriber = Subscriber {
            link: None,
            node: None,
            address,
            next_look_ns: 0,
            failing_since_ns: None,
            continuity: Continuity::default(),
            wakeup: Wakeup::default(),
            prediction: Prediction::default(),
            masks: MaskReader::default(),
            watched: None,
            held: Arc::default(),
            frames: 0,
            lost: 0,
            epochs: 0,
            rejected: 0,
        };
        subscriber.look_after_link(monotonic_ns())?;
        Ok(subscriber)
    }

    /// The oldest unread frame, or `None` where there is none. Never waits. Called after each [`Subscriber::wait`] until it gives
    /// `None`, it yields every frame.
    ///
    /// # Errors
    /// [`IpcErrorKind::TooManyHeld`](crate::IpcErrorKind::TooManyHeld) where the caller holds as many frames as the driver allows, and
    /// those of [`Subscriber::open`].
    pub fn receive(&mut self) -> Result<Option<Frame>, IpcError> {
        let now_ns = monotonic_ns();
        self.look_after_link(now_ns)?;
        while let Some(sample) = self.take_sample()? {
            let received = Received::new(sample);
            // Law 1.
            let header = *received.header();
            match header.validate(received.payload().len()) {
                Ok(image_bytes) => {
                    let step = self.accept(&header, now_ns);
                    let held = Arc::clone(&self.held);
                    return Ok(Some(Frame { received, header, image_bytes, step, _held: held }));
                }
                Err(_) => self.rejected += 1,
            }
        }
        Ok(None)
    }

    /// The newest unread frame, or `None` where there is none. Older ones are dropped, and do not count as lost: they could have been
    /// read. Never waits.
    ///
    /// # Errors
    /// As [`Subscriber::receive`].
    pub fn receive_latest(&mut self) -> Result<Option<Frame>, IpcError> {
        let mut passed_over = Step { lost: 0, epoch_changed: false };
        while let Some(mut frame) = self.receive()? {
            frame.step.lost = frame.step.lost.saturating_add(passed_over.lost);
            frame.step.epoch_changed |= passed_over.epoch_changed;
            if !self.has_unread() {
                return Ok(Some(frame));
            }
            passed_over = frame.step;
        }
        Ok(None)
    }

    /// Chooses how [`Subscriber::wait`] waits. [`Wakeup::Predictive`] learns the rhythm from the frames that come after.
    pub fn set_wakeup(&mut self, wakeup: Wakeup) {
        self.wakeup = wakeup;
    }

    /// Waits until a frame may be there, at most `timeout`. Returns whether one is. Works where the driver is not there yet, dies,
    /// comes back, or makes its services anew. A signal handler does not end it.
    ///
    /// # Errors
    /// Those of [`Subscriber::open`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, IpcError> {
        let mut now_ns = monotonic_ns();
        let deadline_ns = after(timeout, now_ns);
        loop {
            self.look_after_link(now_ns)?;
            // Before the look for a frame: one that comes after it is seen by the sleep.
            let seen = self.link.as_ref().map_or(0, Link::announced);
            if self.has_unread() {
                return Ok(true);
            }
            let left = until(deadline_ns, now_ns);
            if left.is_zero() {
                return Ok(false);
            }
            let has_room = !self.is_full_handed();
            match &mut self.link {
                None => std::thread::sleep(left.min(RETRY)),
                Some(link) if self.wakeup == Wakeup::Event => link.listen(left.min(NAP), &self.address)?,
                Some(link) => {
                    let watch = match self.wakeup {
                        Wakeup::Predictive if has_room => self.prediction.next(now_ns),
                        _ => None,
                    };
                    let nap = left.min(NAP);
                    match watch.and_then(|watch| link.watch(seen, watch, nap, &mut self.prediction)) {
                        None => link.sleep(seen, nap, &self.address)?,
                        Some(Ok(Some(sample))) => {
                            self.watched = Some(sample);
                            return Ok(true);
                        }
                        Some(Err(ReceiveError::ConnectionFailure(_))) => self.let_go(),
                        // Nothing came, or the caller holds as many frames as it may: the next look tells.
                        Some(Ok(None) | Err(ReceiveError::ExceedsMaxBorrows)) => {}
                    }
                }
            }
            now_ns = monotonic_ns();
        }
    }

    /// The mask of a frame, blanked in it or beside it ([`Flags`](crate::Flags)); `None` where its camera flies without. Costs nothing while
    /// the mask stays the same, and never waits. A frame is only ever given its own mask, whichever is in force by now.
    ///
    /// # Errors
    /// [`IpcErrorKind::MaskPending`](crate::IpcErrorKind::MaskPending) where the mask has not come yet: for at most a second or two after
    /// the first call, and after the driver started anew. Go on with the next frame. It does not come any more where the frame was kept
    /// while more than four masks came.
    /// [`IpcErrorKind::TooManyHeld`](crate::IpcErrorKind::TooManyHeld) where the caller holds as many masks as it may, and those of
    /// [`Subscriber::open`].
    pub fn mask_of(&mut self, frame: &Frame) -> Result<Option<Mask>, IpcError> {
        let header = frame.header();
        if !header.has_mask() {
            return Ok(None);
        }
        self.masks.mask_of(header, &self.address, self.node.as_ref()).map(Some)
    }

    /// Frames given out or passed over by [`Subscriber::receive_latest`].
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Sum of [`Frame::lost_before`] over all frames.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Streams seen: 1 with the first frame, one more with each start of the driver and each reconnection of its camera.
    pub fn epochs(&self) -> u64 {
        self.epochs
    }

    /// Frames dropped because their header was not to be trusted.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Whether services of a driver are open at this moment, be the driver alive or not.
    pub fn is_connected(&self) -> bool {
        self.link.is_some()
    }

    fn accept(&mut self, header: &FrameHeader, now_ns: u64) -> Step {
        let step = self.continuity.step(header);
        if self.wakeup == Wakeup::Predictive {
            self.prediction.frame(header);
        }
        self.next_look_ns = after(SILENCE, now_ns);
        if self.frames == 0 || step.epoch_changed {
            self.epochs += 1;
        }
        self.frames += 1;
        self.lost = self.lost.saturating_add(step.lost);
        step
    }

    fn take_sample(&mut self) -> Result<Option<Sample<Ipc, [u8], FrameHeader>>, IpcError> {
        if let Some(sample) = self.watched.take() {
            return Ok(Some(sample));
        }
        if self.is_full_handed() {
            return if self.has_unread() { Err(self.too_many_held()) } else { Ok(None) };
        }
        let Some(link) = &self.link else { return Ok(None) };
        match link.subscriber.receive() {
            Ok(sample) => Ok(sample),
            Err(ReceiveError::ExceedsMaxBorrows) => Err(self.too_many_held()),
            Err(ReceiveError::ConnectionFailure(_)) => {
                self.let_go();
                Ok(None)
            }
        }
    }

    /// Whether the caller holds as many frames as it may. iceoryx2 counts them by publisher: where all are of a driver that is gone, it
    /// would pass over the rest of that one's frames and give out its successor's.
    fn is_full_handed(&self) -> bool {
        self.link.as_ref().is_some_and(|link| Arc::strong_count(&self.held) > link.most_held)
    }

    fn too_many_held(&self) -> IpcError {
        Fault::TooManyHeld(self.address.camera.clone()).into()
    }

    fn has_unread(&mut self) -> bool {
        if self.watched.is_some() {
            return true;
        }
        let unread = self.link.as_ref().map(|link| link.subscriber.has_samples());
        unread.unwrap_or(Ok(false)).unwrap_or_else(|_| {
            self.let_go();
            false
        })
    }

    /// A publisher that could not be connected to is not tried again by iceoryx2: all is opened anew.
    #[cold]
    fn let_go(&mut self) {
        self.next_look_ns = after(RETRY, monotonic_ns());
        self.link = None;
        self.masks.let_go();
        self.node = None;
    }

    /// Connects where there is no link; lets go of one that has no driver behind it. Mostly too early for either.
    #[inline]
    fn look_after_link(&mut self, now_ns: u64) -> Result<(), IpcError> {
        if now_ns < self.next_look_ns { Ok(()) } else { self.attend_to_link(now_ns) }
    }

    #[cold]
    fn attend_to_link(&mut self, now_ns: u64) -> Result<(), IpcError> {
        self.next_look_ns = after(RETRY, now_ns);
        let received = self.frames + self.rejected;
        match &mut self.link {
            Some(link) => {
                if link.leads_nowhere(received, &self.address) {
                    self.let_go();
                }
            }
            None => match self.connect() {
                Ok(link) => {
                    self.link = link;
                    self.failing_since_ns = None;
                }
                Err(error)
                    if error.may_pass()
                        && until(now_ns, *self.failing_since_ns.get_or_insert(now_ns)) < TOLERANCE => {}
                Err(error) => return Err(error),
            },
        }
        if self.link.is_some() {
            self.next_look_ns = after(SILENCE, now_ns);
        }
        Ok(())
    }

    fn connect(&mut self) -> Result<Option<Link>, IpcError> {
        if self.node.is_none() {
            self.node = self.address.visiting_node()?;
        }
        self.node.as_ref().map_or(Ok(None), |node| Link::open(&self.address, node))
    }
}

/// One frame, in the memory that the driver wrote. Dropped, it gives its slot back; a consumer may hold
/// [`Settings::borrowed`] of them, also beyond the life of its [`Subscriber`].
#[derive(Debug)]
pub struct Frame {
    received: Received<FrameHeader>,
    header: FrameHeader,
    image_bytes: usize,
    step: Step,
    _held: Arc<()>,
}

impl Frame {
    /// The header: a checked copy.
    pub fn header(&self) -> &FrameHeader {
        &self.header
    }

    /// The image, row by row from the top, [`FrameHeader::stride`] bytes apart; ends with the last pixel of the last row.
    pub fn pixels(&self) -> &[u8] {
        self.received.payload().get(..self.image_bytes).unwrap_or_default()
    }

    /// The rows of the image from the top, each of `width * bytes_per_pixel` bytes: what lies between rows is left out.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[u8]> + DoubleEndedIterator + Clone {
        let stride = self.header.stride as usize;
        // What the last row has; `pixels` ends with it.
        let row_bytes = self.image_bytes - stride * (self.header.height as usize - 1);
        self.pixels().chunks(stride).map(move |row| row.get(..row_bytes).unwrap_or_default())
    }

    /// Frames that the device produced since the frame before and that did not reach this consumer: those that were never published
    /// and those that it was too slow to read, also where epochs and drivers have changed since. Frames before the first one are
    /// nobody's loss.
    pub fn lost_before(&self) -> u64 {
        self.step.lost
    }

    /// Whether the driver or its camera started anew since the frame before. How long that took is in the stamps.
    pub fn epoch_changed(&self) -> bool {
        self.step.epoch_changed
    }
}
