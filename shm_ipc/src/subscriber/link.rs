//! A consumer's connection to the services of its camera.

use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::{DegradationAction, ReceiveError};
use iceoryx2::prelude::{MessagingPattern, PortFactory};
use iceoryx2::sample::Sample;

use super::RETRY;
use crate::clock::{monotonic_ns, until};
use crate::error::{Fault, IpcError};
use crate::footing::Held;
use crate::frame_service::{self, FrameService, WakeService, wake_service_name};
use crate::header::FrameHeader;
use crate::prediction::{Prediction, Watch};
use crate::premises;
use crate::quirks::{Ipc, SHORTEST_WAIT};
use crate::service::Address;
use crate::wake_word::WakeWord;

/// A frame, none, or why it cannot be had.
pub(super) type Received = Result<Option<Sample<Ipc, [u8], FrameHeader>>, ReceiveError>;

/// A connection to the services of a camera. Ports are dropped before the services that they belong to.
#[derive(Debug)]
pub(super) struct Link {
    /// Made by the first wait for the event: nobody else costs the driver its notification.
    listener: Option<Listener<Ipc>>,
    /// Missing where the driver is just about to make it.
    wake_word: Option<WakeWord>,
    /// Frames announced and frames received at the last look.
    last_look: Option<(u32, u64)>,
    /// Frames that a consumer may hold.
    pub(super) most_held: usize,
    pub(super) subscriber: Subscriber<Ipc, [u8], FrameHeader>,
    wake: Held<WakeService>,
    frames: Held<FrameService>,
}

impl Link {
    pub(super) fn open(address: &Address, node: &Node<Ipc>) -> Result<Option<Link>, IpcError> {
        let Some((frames, wake)) = frame_service::open(address, node)? else {
            return address.check_version().map(|()| None);
        };
        let subscriber =
            frames.subscriber_builder().set_degradation_handler(|_, _| DegradationAction::DegradeAndFail);
        match subscriber.create() {
            Ok(subscriber) => {
                let wake_word = open_wake_word(address)?;
                address.take_small_files()?;
                let most_held = frames.static_config().subscriber_max_borrowed_samples();
                let (frames, wake) = (Held::new(frames, &address.config), Held::new(wake, &address.config));
                Ok(Some(Link {
                    listener: None,
                    wake_word,
                    last_look: None,
                    most_held,
                    subscriber,
                    wake,
                    frames,
                }))
            }
            Err(SubscriberCreateError::ExceedsMaxSupportedSubscribers) => {
                Err(Fault::TooManyConsumers(frames.name().as_str().to_owned()).into())
            }
            Err(source) => Err(address.failed("subscribing to", frames.name().as_str(), source)),
        }
    }

    /// Frames that the wake word has announced.
    pub(super) fn announced(&self) -> u32 {
        self.wake_word.as_ref().map_or(0, |word| word.frames())
    }

    /// Sleeps on the wake word until more frames are announced than were `seen`, at most `timeout`.
    pub(super) fn sleep(&mut self, seen: u32, timeout: Duration, address: &Address) -> Result<(), IpcError> {
        let Some(word) = &self.wake_word else {
            std::thread::sleep(timeout.min(RETRY));
            self.wake_word = open_wake_word(address)?;
            return Ok(());
        };
        if word.sleep(seen, timeout) && !word.is_current() {
            self.wake_word = open_wake_word(address)?;
        }
        Ok(())
    }

    /// Sleeps until a frame is soon due, then watches for it and takes it. Does neither and returns `None` where that takes longer than
    /// `timeout`, or where it could only watch on the driver's core.
    pub(super) fn watch(
        &self,
        seen: u32,
        watch: Watch,
        timeout: Duration,
        prediction: &mut Prediction,
    ) -> Option<Received> {
        let nap = until(watch.wake_ns, monotonic_ns());
        let word = self.wake_word.as_ref().filter(|_| nap <= timeout)?;
        let aside = word.step_aside()?;
        if !nap.is_zero() {
            word.sleep_exactly(seen, nap);
        }
        // Awake, it stays where it is, and is off the way of the frame.
        drop(aside);
        let woke_ns = monotonic_ns();
        if woke_ns >= watch.wake_ns {
            prediction.overslept(watch.wake_ns, woke_ns);
        }
        loop {
            // The frame itself: it is there before it is announced, and who asks for it all the time has at hand the code that takes it.
            let received = self.subscriber.receive();
            let watched_ns = monotonic_ns().saturating_sub(woke_ns);
            if !matches!(received, Ok(None)) || watched_ns >= watch.budget_ns {
                prediction.watched(watched_ns);
                return Some(received);
            }
            std::hint::spin_loop();
        }
    }

    /// Sleeps until the driver notifies the event, at most `timeout`. The first call returns at once: a frame may have come before the
    /// driver knew that somebody listens.
    pub(super) fn listen(&mut self, timeout: Duration, address: &Address) -> Result<(), IpcError> {
        let Some(listener) = &self.listener else {
            let Some(wake) = self.wake.get() else { return Ok(()) };
            premises::check_room(0)?;
            let listener = wake.listener_builder().create().map_err(|source| match source {
                ListenerCreateError::ExceedsMaxSupportedListeners => {
                    Fault::TooManyConsumers(wake.name().as_str().to_owned()).into()
                }
                _ => address.failed("listening to", wake.name().as_str(), source),
            })?;
            self.listener = Some(listener);
            return address.take_small_files();
        };
        match listener.timed_wait(|_| (), timeout.max(SHORTEST_WAIT)) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(source) => Err(address.failed("waiting for", &wake_service_name(&address.camera), source)),
        }
    }

    /// Whether nothing is unread and nothing can come: there is no driver, it uses other services under the same names, or it passes
    /// this consumer by. `received` counts the frames that have arrived. To be asked after a silence.
    pub(super) fn leads_nowhere(&mut self, received: u64, address: &Address) -> bool {
        let is_passed_by = self.is_passed_by(received);
        if matches!(self.subscriber.has_samples(), Ok(true)) {
            return false;
        }
        is_passed_by
            || self.frames.get().is_none_or(|frames| {
                frames.dynamic_config().number_of_publishers() == 0
                    || !address.finds(frames, MessagingPattern::PublishSubscribe)
            })
    }

    /// Whether the driver has announced frames since the last look and none of them arrived: it could not connect to this consumer when
    /// it tried, and tries once.
    fn is_passed_by(&mut self, received: u64) -> bool {
        let Some(word) = &self.wake_word else { return false };
        let now = (word.frames(), received);
        let last = self.last_look.replace(now);
        last.is_some_and(|last| last.0 != now.0 && last.1 == now.1)
    }
}

fn open_wake_word(address: &Address) -> Result<Option<WakeWord>, IpcError> {
    let path = address.wake_word();
    premises::check_ours(&path)?;
    WakeWord::open(&path)
        .map_err(|source| address.failed("opening the wake word", &path.display().to_string(), source))
}
