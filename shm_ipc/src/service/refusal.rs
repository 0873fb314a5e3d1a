//! Why iceoryx2 does not open or make a service: it has words of its own for each pattern, which come to the same.

use std::error::Error;

use iceoryx2::service::builder::event::EventCreateError;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseCreateError, RequestResponseOpenError, RequestResponseOpenOrCreateError,
};

/// What such an error comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reason {
    /// It is not there, half made or half removed.
    Absent,
    /// This user may not.
    Permission,
    /// All places are taken.
    Full,
    /// It was made with other settings or by another version.
    Incompatible,
    /// Anything else.
    Other,
}

/// An error of iceoryx2 with such a reason.
pub(crate) trait Refusal: Error + Send + Sync + 'static {
    fn reason(&self) -> Reason;
}

macro_rules! refusals {
    ($($open:ident, $create:ident, $open_or_create:ident: $($incompatible:ident)|+;)+) => {$(
        impl Refusal for $open {
            fn reason(&self) -> Reason {
                use $open::*;
                match self {
                    DoesNotExist | ServiceInCorruptedState | IsMarkedForDestruction | HangsInCreation => Reason::Absent,
                    InsufficientPermissions => Reason::Permission,
                    ExceedsMaxNumberOfNodes => Reason::Full,
                    IncompatibleMessagingPattern | IncompatibleAttributes | VersionMismatch | DoesNotSupportRequestedAmountOfNodes
                    | $($incompatible)|+ => Reason::Incompatible,
                    _ => Reason::Other,
                }
            }
        }

        impl Refusal for $open_or_create {
            fn reason(&self) -> Reason {
                match self {
                    $open_or_create::$open(open) => open.reason(),
                    $open_or_create::$create($create::InsufficientPermissions) => Reason::Permission,
                    _ => Reason::Other,
                }
            }
        }
    )+};
}

refusals! {
    PublishSubscribeOpenError, PublishSubscribeCreateError, PublishSubscribeOpenOrCreateError:
        IncompatibleTypes | IncompatibleOverflowBehavior | DoesNotSupportRequestedMinBufferSize
        | DoesNotSupportRequestedMinHistorySize | DoesNotSupportRequestedMinSubscriberBorrowedSamples
        | DoesNotSupportRequestedAmountOfPublishers | DoesNotSupportRequestedAmountOfSubscribers;
    EventOpenError, EventCreateError, EventOpenOrCreateError:
        DoesNotSupportRequestedAmountOfNotifiers | DoesNotSupportRequestedAmountOfListeners | DoesNotSupportRequestedMaxEventId;
    RequestResponseOpenError, RequestResponseCreateError, RequestResponseOpenOrCreateError:
        IncompatibleRequestOrResponseType | IncompatibleOverflowBehaviorForResponses | DoesNotSupportRequestedResponseBufferSize
        | DoesNotSupportRequestedAmountOfServers | DoesNotSupportRequestedAmountOfClients
        | DoesNotSupportRequestedAmountOfActiveRequestsPerClient;
}
