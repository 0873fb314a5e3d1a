"""Masked camera frames of uvcam as numpy arrays, in the memory that the camera wrote.

    import uvcam

    with uvcam.Subscriber("left") as subscriber:
        for frame in subscriber:
            print(frame.lost_before, "lost,", frame.array.mean())
"""

from ._uvcam import CONTRACT_VERSION, Frame, Mask, health
from .contract import Cause, Flags, Header, Health, Latency, PixelFormat, State
from .error import Error, Kind
from .subscriber import Subscriber

__all__ = [
    "CONTRACT_VERSION",
    "Cause",
    "Error",
    "Flags",
    "Frame",
    "Header",
    "Health",
    "Kind",
    "Latency",
    "Mask",
    "PixelFormat",
    "State",
    "Subscriber",
    "health",
]
