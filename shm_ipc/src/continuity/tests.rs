use std::collections::VecDeque;

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::production::Production;

fn step(continuity: &mut Continuity, epoch: u64, counting: u64, produced: u64) -> (u64, bool) {
    let header = FrameHeader { epoch, counting, produced, ..FrameHeader::default() };
    let step = continuity.step(&header);
    (step.lost, step.epoch_changed)
}

#[test]
fn frames_before_the_first_are_nobodys_loss() {
    assert_eq!(step(&mut Continuity::default(), 7, 1, 1000), (0, false));
}

#[test]
fn all_that_was_produced_between_two_frames_is_lost() {
    let mut continuity = Continuity::default();
    step(&mut continuity, 7, 1, 1);
    assert_eq!(step(&mut continuity, 7, 1, 2), (0, false));
    assert_eq!(step(&mut continuity, 7, 1, 6), (3, false));
}

#[test]
fn an_epoch_slept_over_is_told_by_the_next() {
    let mut continuity = Continuity::default();
    step(&mut continuity, 7, 1, 500);
    assert_eq!(step(&mut continuity, 8, 1, 501), (0, true));
    assert_eq!(step(&mut continuity, 10, 1, 624), (122, true));
    assert_eq!(step(&mut continuity, 10, 1, 625), (0, false));
}

#[test]
fn a_count_that_begins_anew_tells_all_of_itself() {
    let mut continuity = Continuity::default();
    step(&mut continuity, 7, 1, 500);
    assert_eq!(step(&mut continuity, 8, 2, 1), (0, true));
    assert_eq!(step(&mut continuity, 9, 3, 4), (3, true));
    assert_eq!(step(&mut continuity, 9, 3, 5), (0, false));
}

#[test]
fn nonsense_saturates() {
    let mut continuity = Continuity::default();
    step(&mut continuity, 7, 1, u64::MAX);
    assert_eq!(step(&mut continuity, 7, 1, 0), (0, false));
    assert_eq!(step(&mut continuity, 7, 1, u64::MAX), (u64::MAX - 1, false));
    assert_eq!(step(&mut continuity, 7, 2, 0), (0, true));
}

/// Frames that wait for a consumer that does not read.
const BUFFER: usize = 3;

/// What may happen, in any order.
#[derive(Debug, Clone)]
enum Act {
    /// A frame is published.
    Frame,
    /// Frames are lost.
    Lose(u64),
    /// The camera comes back, by a clock that anybody may have set.
    Reconnect(u64),
    /// The driver ends or is killed between two frames.
    End,
    /// The driver is killed when it has counted a frame and not sent it.
    KillBeforeSend,
    /// A driver starts, where none is.
    Start,
    /// The camera's page is removed, where no driver is.
    RemovePage,
    /// The consumer wakes up and reads as many frames.
    Read(usize),
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        10 => Just(Act::Frame),
        3 => (1..4u64).prop_map(Act::Lose),
        2 => any::<u32>().prop_map(|now_ns| Act::Reconnect(now_ns.into())),
        1 => Just(Act::End),
        1 => Just(Act::KillBeforeSend),
        2 => Just(Act::Start),
        1 => Just(Act::RemovePage),
        3 => (0..6usize).prop_map(Act::Read),
    ]
}

/// A camera, its drivers, and one consumer that mostly sleeps.
#[derive(Default)]
struct World {
    page: Option<Production>,
    driver: Option<Production>,
    /// All that the device produced.
    produced: u64,
    /// Of these, all before the page was last removed.
    forgotten: u64,
    countings: u64,
    /// What the driver has sent and the consumer has not read.
    sent: VecDeque<FrameHeader>,
    /// The same of drivers before.
    left_behind: VecDeque<FrameHeader>,
    /// Whether the consumer was awake since the driver started: else it never hears of what that one sends.
    is_connected: bool,
    continuity: Continuity,
    /// The counting and epoch of the last frame that was read.
    stream: Option<(u64, u64)>,
    received: u64,
    told: u64,
}

impl World {
    fn take(&mut self, act: &Act) {
        match (act, self.driver) {
            (Act::Frame, Some(production)) => {
                let Production { counting, produced, epoch } = self.keep(production.after(1));
                self.produced += 1;
                self.sent.push_back(FrameHeader { counting, produced, epoch, ..FrameHeader::default() });
                if self.sent.len() > BUFFER {
                    self.sent.pop_front();
                }
            }
            (Act::Lose(frames), Some(production)) => {
                self.keep(production.after(*frames));
                self.produced += frames;
            }
            (Act::Reconnect(now_ns), Some(production)) => _ = self.keep(production.in_next_epoch(*now_ns)),
            (Act::End, Some(_)) => self.end(),
            (Act::KillBeforeSend, Some(production)) => {
                self.keep(production.after(1));
                self.produced += 1;
                self.end();
            }
            (Act::Start, None) => {
                self.countings += 1;
                let production = Production::resume(self.page, self.countings);
                self.keep(production.in_next_epoch(0));
            }
            (Act::RemovePage, None) if self.page.take().is_some() => self.forgotten = self.produced,
            (Act::Read(frames), driver) => {
                self.is_connected |= driver.is_some();
                (0..*frames).for_each(|_| self.read());
            }
            _ => {}
        }
    }

    /// As the driver keeps the page.
    fn keep(&mut self, production: Production) -> Production {
        self.page = Some(production);
        *self.driver.insert(production)
    }

    fn end(&mut self) {
        self.driver = None;
        if std::mem::take(&mut self.is_connected) {
            self.left_behind.append(&mut self.sent);
        }
        self.sent.clear();
    }

    fn read(&mut self) {
        let unread = self.left_behind.pop_front().or_else(|| self.sent.pop_front());
        let Some(header) = unread else { return };
        let step = self.continuity.step(&header);
        let stream = (header.counting, header.epoch);
        assert_eq!(step.epoch_changed, self.stream.replace(stream).is_some_and(|before| before != stream));
        self.received += 1;
        self.told += step.lost;
    }
}

proptest! {
    #[test]
    fn received_and_told_is_what_was_produced(acts in vec(act(), 0..200)) {
        let mut world = World::default();
        let first = [Act::Start, Act::Frame, Act::Read(1)];
        // In the end, a last frame tells of all before it.
        let last = [Act::Start, Act::Frame, Act::Read(usize::from(u8::MAX))];
        for act in first.iter().chain(&acts).chain(&last) {
            let (page, starts) = (world.page, world.driver.is_none());
            world.take(act);
            if let (Some(before), Some(now)) = (page, world.driver) {
                let begins = starts || matches!(act, Act::Reconnect(_));
                prop_assert_eq!(before.epoch < now.epoch, begins, "{:?}", act);
                prop_assert!(before.epoch <= now.epoch && before.counting == now.counting);
            }
            let known = world.received + world.told;
            prop_assert!(known <= world.produced, "told too much after {:?}", act);
        }
        let known = world.received + world.told;
        if world.forgotten == 0 {
            prop_assert_eq!(known, world.produced);
        } else {
            // At the least, all of the count that the last frame is of.
            prop_assert!(known >= world.produced - world.forgotten);
        }
    }
}
