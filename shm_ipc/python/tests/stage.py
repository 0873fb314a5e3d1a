"""A stage for tests: the real driver, in a process, a folder and shared memory of the test's own."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvcam

PATIENCE_S = 20.0

# Where cargo puts the programs that the tests start.
BUILT = Path(os.environ.get("CARGO_TARGET_DIR", Path(__file__).parents[3] / "target")) / "debug"


def simulated(name: str = "left", *, mask: str = "none", source: str = "", more: str = "") -> str:
    """A configuration's table of a simulated camera of 752 x 480 px at 60 fps."""
    return (
        f'[[camera]]\nname = "{name}"\nsource = {{ kind = "simulated", serial = "{name}"{source} }}\n'
        f'width = 752\nheight = 480\nfps = 60\nexposure_us = 1000\nmask = "{mask}"\n{more}'
    )


def wait_until(what: str, condition: Callable[[], bool]) -> None:
    """Waits until a condition holds, which it must."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"not within {PATIENCE_S} s: {what}"
        time.sleep(0.005)


def next_frame(subscriber: uvcam.Subscriber) -> uvcam.Frame:
    """The next frame, which must come."""
    end = time.monotonic() + PATIENCE_S
    while True:
        frame = subscriber.receive()
        if frame is not None:
            return frame
        assert time.monotonic() < end, f"no frame within {PATIENCE_S} s"
        subscriber.wait(0.1)


class Stage:
    """A folder, a configuration and shared memory that no other test uses."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.address: dict[str, Any] = {"prefix": f"{folder.name}_", "root_path": folder / "ipc"}
        self.drivers: list[subprocess.Popen[bytes]] = []

    def write(self, cameras: str, ipc: str = "") -> None:
        """Writes the configuration: `cameras` behind an `[ipc]` table."""
        prefix, root_path = self.address["prefix"], self.address["root_path"]
        text = f'[ipc]\nprefix = "{prefix}"\nroot_path = "{root_path}"\n{ipc}\n{cameras}'
        (self.folder / "uvcam.toml").write_text(text)

    def command(self, *words: str) -> list[str]:
        """A command of `uvcam` with the stage's configuration."""
        return [str(BUILT / "uvcam"), *words, "--config", str(self.folder / "uvcam.toml")]

    def driver(self, cameras: str | None = None, ipc: str = "") -> "subprocess.Popen[bytes]":
        """Starts `uvcam run`, which ends with the test at the latest."""
        if cameras is not None:
            self.write(cameras, ipc)
        driver = subprocess.Popen(self.command("run"), stdin=subprocess.DEVNULL)
        self.drivers.append(driver)
        return driver

    def publisher(self, *words: str) -> "subprocess.Popen[bytes]":
        """Starts another driver than ours, of the camera "padded": 30 x 5 px, rows with padding, a mask beside the frames."""
        command = [str(BUILT / "examples" / "publisher"), *self.words(), *words]
        # It ends with its input.
        publisher = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.drivers.append(publisher)
        return publisher

    def subscriber(self, camera: str = "left", **more: Any) -> uvcam.Subscriber:
        """A consumer in this process."""
        return uvcam.Subscriber(camera, **self.address, **more)

    def words(self) -> list[str]:
        """The address as arguments of a program."""
        return [self.address["prefix"], str(self.address["root_path"])]

    def close(self) -> None:
        """Ends drivers and takes away what killed processes left behind."""
        for driver in self.drivers:
            if driver.poll() is None:
                driver.send_signal(signal.SIGTERM)
                driver.wait(PATIENCE_S)
            for pipe in (driver.stdin, driver.stdout):
                if pipe is not None:
                    pipe.close()
        for file in Path("/dev/shm").glob(f"{self.address['prefix']}*"):
            file.unlink(missing_ok=True)
