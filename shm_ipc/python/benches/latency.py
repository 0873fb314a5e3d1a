"""From the driver's send to a frame in a consumer's hands: in Rust (`uvcam watch`), in Python, and in a program of asyncio.

python latency.py [UVCAM] [FRAMES] [ROUNDS]

One driver with a simulated camera of 752x480 at 60 fps, the consumers one after the other, in rounds: only figures of one run compare.
"""

import asyncio
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import uvcam

binary = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).parents[3] / "target/release/uvcam")
frames, rounds = (int(word) for word in (sys.argv[2:4] if len(sys.argv) > 3 else (600, 5)))


def received(frame: uvcam.Frame) -> float:
    """How old a frame is, in us, with its array in hand."""
    array = frame.array
    now = time.monotonic_ns()
    assert array.shape == (480, 752)
    return (now - frame.header.send_monotonic_ns) / 1000


def rust() -> tuple[float, float]:
    words = [binary, "watch", "left", "--frames", str(frames), "--json", "--config", str(config)]
    latency = json.loads(subprocess.run(words, capture_output=True, check=True).stdout)["latency_us"]
    return latency["p50"], latency["p99"]


def quantiles(latencies: list[float]) -> tuple[float, float]:
    latencies.sort()
    return latencies[len(latencies) // 2], latencies[len(latencies) * 99 // 100]


def python() -> tuple[float, float]:
    with uvcam.Subscriber("left", prefix=prefix, root_path=root_path) as subscriber:
        return quantiles([received(frame) for _, frame in zip(range(frames), subscriber)])


def python_asyncio() -> tuple[float, float]:
    async def consume() -> list[float]:
        with uvcam.Subscriber("left", prefix=prefix, root_path=root_path) as subscriber:
            return [received(await anext(subscriber)) for _ in range(frames)]

    return quantiles(asyncio.run(consume()))


with tempfile.TemporaryDirectory(prefix="uvcam") as folder:
    config, root_path, prefix = Path(folder) / "uvcam.toml", Path(folder) / "ipc", f"{Path(folder).name}_"
    config.write_text(
        f'[ipc]\nprefix = "{prefix}"\nroot_path = "{root_path}"\n[[camera]]\nname = "left"\n'
        'source = { kind = "simulated", serial = "left" }\nwidth = 752\nheight = 480\nfps = 60\nexposure_us = 1000\nmask = "none"\n'
    )
    driver = subprocess.Popen([binary, "run", "--config", str(config)], stderr=subprocess.DEVNULL)
    try:
        consumers: list[Callable[[], tuple[float, float]]] = [rust, python, python_asyncio]
        measured = [[consumer() for consumer in consumers] for _ in range(rounds)]
    finally:
        driver.terminate()
        driver.wait()
    for file in Path("/dev/shm").glob(f"{prefix}*"):
        file.unlink()

print(f"{'send to receive, us':20}{'p50':>8}{'p99':>8}   medians of {rounds} rounds of {frames} frames")
for consumer, figures in zip(consumers, zip(*measured)):
    p50, p99 = (statistics.median(quantile) for quantile in zip(*figures))
    print(f"{consumer.__name__:20}{p50:8.1f}{p99:8.1f}")
