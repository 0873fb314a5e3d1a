"""A consumer's end, with what is Python's own: the context manager and asyncio."""

import asyncio
from concurrent.futures import Future, ThreadPoolExecutor

from . import _uvcam
from ._uvcam import Frame
from .error import Error

_NAP_S = 0.1
"""Longest wait of the thread, which goes on for as long where its task was cancelled."""


class Subscriber(_uvcam.Subscriber):
    """Reads the frames of one camera. The driver may come later, go, and come back.

    `for frame in subscriber` waits for each frame and gives every one, oldest first, until the subscriber is closed; `async for` does
    the same in a program of asyncio. Both end with `close`, which another thread may call.
    """

    _thread: ThreadPoolExecutor | None = None
    _wait: "Future[bool] | None" = None

    def __enter__(self) -> "Subscriber":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Lets go of the camera. Frames and arrays stay as they are."""
        super().close()
        if self._thread is not None:
            self._thread.shutdown(wait=False)

    def __aiter__(self) -> "Subscriber":
        return self

    async def __anext__(self) -> Frame:
        # The thread only waits. The frame is taken here, so that a task which is cancelled meanwhile loses none.
        while not self.is_closed:
            if self._wait is None or self._wait.done():
                frame = self.receive()
                if frame is not None:
                    return frame
                if self._thread is None:
                    self._thread = ThreadPoolExecutor(1, f"uvcam {self.camera}")
                self._wait = self._thread.submit(self.wait, _NAP_S)
            try:
                await asyncio.wrap_future(self._wait)
            except Error:
                if not self.is_closed:
                    raise
        raise StopAsyncIteration
