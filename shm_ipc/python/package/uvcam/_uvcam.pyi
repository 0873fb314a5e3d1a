"""The native part: the crate uvcam-shm-ipc as Python sees it."""

import os
from collections.abc import Iterator
from typing import Final, Literal, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self, disjoint_base

from .contract import Header, Health

__all__ = ["CONTRACT_VERSION", "Frame", "Mask", "Subscriber", "health"]

CONTRACT_VERSION: Final[int]
"""Version of the contract between driver and consumers."""

@final
class Frame:
    """One frame, in the memory that the camera wrote. Its slot goes back to the driver when the frame, its arrays and their views are gone."""

    @property
    def header(self) -> Header:
        """What is to be known besides the pixels."""

    @property
    def array(self) -> NDArray[np.uint8 | np.uint16]:
        """The pixels where they lie, read-only: shape (height, width), uint8 of Mono8, else uint16.

        Strides are those of the camera: rows may have padding. The frame is the base of the array, or of the array that this one is a
        view of. Each call gives another array of the same memory.
        """

    @property
    def lost_before(self) -> int:
        """Frames that the device produced since the frame before and that did not reach this consumer, for whatever reason."""

    @property
    def epoch_changed(self) -> bool:
        """Whether the driver or its camera started anew since the frame before: what was tracked across frames is old."""

@final
class Mask:
    """A mask that frames name, in the memory that the driver wrote."""

    @property
    def id(self) -> str:
        """Identity: the `Header.mask_id` of its frames."""

    @property
    def array(self) -> NDArray[np.uint8]:
        """The image where it lies, read-only: shape (height, width), 0 discard, 255 keep. The mask is its base."""

    @property
    def runs(self) -> NDArray[np.uint32]:
        """The masked runs, a row of (row, first column, length) for each, downwards and from left to right; a copy."""

    @property
    def masked_px(self) -> int:
        """Masked pixels."""

    @property
    def provenance(self) -> dict[str, str]:
        """Where it comes from, such as camera, method and time of a generated one; empty where nothing is known."""

    def grown(self, pixels: int) -> NDArray[np.uint8]:
        """A copy of the image in which the masked areas reach `pixels` further to each side, by columns and rows.

        Who looks around a pixel by no more than that, and leaves out what is masked here, does not see the edge of a black area.
        """

@disjoint_base
class Subscriber:
    """What `uvcam.Subscriber` extends."""

    def __new__(
        cls,
        camera: str,
        *,
        prefix: str | None = None,
        root_path: str | os.PathLike[str] | None = None,
        wakeup: Literal["futex", "predictive", "event"] = "futex",
    ) -> Self:
        """Prepares to read the frames of `camera`.

        `prefix` and `root_path` are those of `[ipc]` in the driver's configuration, "uvcam_" and "/tmp/uvcam" by default. `wakeup` is how to
        wait: "futex" sleeps; "predictive" wakes up shortly before the next frame and watches for it, for less than 1 % of a core more;
        "event" sleeps on the camera's iceoryx2 event.
        """

    def receive(self) -> Frame | None:
        """The oldest unread frame, or None where there is none. Never waits.

        Raises `uvcam.Error` of kind "too_many_held" where as many frames are held as the driver's `borrowed` allows.
        """

    def receive_latest(self) -> Frame | None:
        """The newest unread frame, or None where there is none. Older ones are passed over and are not lost. Never waits."""

    def mask_of(self, frame: Frame) -> Mask | None:
        """The mask of a frame, blanked in it or beside it (`Flags`); None where its camera flies without. Never waits.

        Raises `uvcam.Error` of kind "mask_pending" where it has not come yet, within a second or two of the first call and of a start of
        the driver: go on with the next frame.
        """

    def wait(self, timeout: float | None = None) -> bool:
        """Waits until a frame is there, `timeout` seconds at most, and returns whether one is. Other threads run meanwhile."""

    def close(self) -> None:
        """Lets go of the camera."""

    @property
    def camera(self) -> str:
        """Its name."""

    @property
    def frames(self) -> int:
        """Frames given out or passed over."""

    @property
    def lost(self) -> int:
        """Sum of `Frame.lost_before` over all frames."""

    @property
    def epochs(self) -> int:
        """Streams seen: 1 with the first frame, one more with each start of the driver and each reconnection of its camera."""

    @property
    def rejected(self) -> int:
        """Frames dropped because their header was not to be trusted."""

    @property
    def is_connected(self) -> bool:
        """Whether services of a driver were open when the subscriber was last used."""

    @property
    def is_closed(self) -> bool:
        """Whether `close` was called."""

    def __iter__(self) -> Iterator[Frame]: ...
    def __next__(self) -> Frame: ...

def health(
    camera: str,
    *,
    prefix: str | None = None,
    root_path: str | os.PathLike[str] | None = None,
    timeout: float | None = 2.0,
) -> Health | None:
    """The newest record of how a camera is; None where no driver told of it within `timeout` seconds."""
