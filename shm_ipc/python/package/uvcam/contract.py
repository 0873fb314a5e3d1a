"""What a driver tells: the header of a frame, the health of a camera."""

import enum
from dataclasses import dataclass
from typing import Literal, TypedDict

PixelFormat = Literal["Mono8", "Mono10", "Mono12", "Mono16"]
"""A PFNC name. Pixels of more than 8 bits lie in 16, value in the low bits."""


class Flags(enum.IntFlag):
    """What was done to a frame and where it comes from."""

    MASKED = 1
    """A mask was applied, and what it masks is black: `Header.mask_id` tells which."""
    SIMULATED = 2
    """The frame was rendered, not taken."""
    REPLAYED = 4
    """The frame was read from a file."""
    INCOMPLETE = 8
    """Parts of the frame are missing."""
    NO_DEVICE_CLOCK = 16
    """The device has no clock: `Header.device_timestamp_ns` says nothing."""
    MASK_ATTACHED = 32
    """A mask was not applied and travels beside the frame: the own airframe is in sight."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Header:
    """What is to be known of a frame besides its pixels: a checked copy of what lies before them in memory."""

    width: int
    """Pixels in a row."""
    height: int
    """Rows."""
    stride: int
    """Bytes from the start of one row to the start of the next."""
    pixel_format: PixelFormat
    """How a pixel lies in memory."""
    flags: Flags
    """What was done to the frame and where it comes from."""
    mask_id: str | None
    """Identity of the mask that was applied or travels beside the frame, 32 hexadecimal digits as `uvcam` prints them, or None."""
    exposure_us: float
    """Exposure time in us, as read back from the camera."""
    gain_db: float
    """Gain in dB, as read back from the camera."""

    epoch: int
    """Identity of an uninterrupted stream: rises with every start of the driver and every reconnection of the camera."""
    sequence: int
    """Place among the published frames of this epoch, from 0."""
    device_frame_id: int
    """The device's own count of this frame in this epoch, from 0."""
    counting: int
    """Identity of the count `produced`."""
    produced: int
    """Frames that the device is known to have produced up to and including this one, published or not."""

    frame_period_ns: int
    """Time between frames, as read back from the camera."""
    device_timestamp_ns: int
    """The device's own clock at this frame, from an arbitrary start."""
    arrival_monotonic_ns: int
    """CLOCK_MONOTONIC (`time.monotonic_ns`) when the driver had the whole frame."""
    send_monotonic_ns: int
    """CLOCK_MONOTONIC when the frame was sent."""
    mid_exposure_monotonic_ns: int
    """CLOCK_MONOTONIC at the middle of the exposure: when the picture was taken."""
    mid_exposure_realtime_ns: int
    """CLOCK_REALTIME (`time.time_ns`) at the middle of the exposure, for other hosts."""
    mid_exposure_uncertainty_ns: int
    """Half width of the interval around either mid-exposure stamp that holds the true time."""


State = Literal["starting", "streaming", "generating", "reconnecting", "refused", "stopped"]
"""What a camera's driver does with it."""

Cause = Literal[
    "none",
    "absent",
    "disconnected",
    "silent",
    "incomplete",
    "device",
    "settings",
    "mask",
    "shared memory",
    "stuck",
]
"""Why a camera does not publish, or last did not."""


class Latency(TypedDict):
    """How long frames took through one stage since the driver started."""

    count: int
    p50_ns: int
    p90_ns: int
    p99_ns: int
    p999_ns: int
    max_ns: int


class Health(TypedDict):
    """A record that the driver writes every second and with every change of state. Counters begin with its process."""

    state: State
    cause: Cause
    """Of what last ended or kept off a stream; it stays when the camera streams again."""
    last_error: str
    written_monotonic_ns: int
    """CLOCK_MONOTONIC. Older than three seconds, the record speaks of a driver that is gone or stuck."""
    state_since_monotonic_ns: int
    started_monotonic_ns: int
    process_id: int
    frame_rate: float
    """Frames published a second, over the last second."""
    temperature_c: float | None
    published: int
    lost: int
    """Frames that the device produced and no stream published."""
    incomplete: int
    """Frames that arrived with a part missing; they are among the lost."""
    no_free_slot: int
    epochs: int
    failures: int
    resident_bytes: int
    cpu_ns: int
    mask_id: str | None
    """Identity of the mask in force, 32 hexadecimal digits."""
    config_digest: str
    """Beginning of the configuration's SHA-256, 32 hexadecimal digits."""
    arrival_to_masked: Latency
    masked_to_sent: Latency
