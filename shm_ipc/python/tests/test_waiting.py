"""Waiting: other threads run, signals end it, other threads close it, asyncio goes on."""

import asyncio
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import pytest
import uvcam
from stage import PATIENCE_S, Stage, next_frame, simulated, wait_until


def test_other_threads_run_while_one_waits(stage: Stage) -> None:
    turns = 0
    with stage.subscriber() as subscriber, ThreadPoolExecutor(1) as thread:
        waits = thread.submit(subscriber.wait, 0.5)
        while not waits.done():
            turns += 1
            time.sleep(0)
        assert waits.result() is False
    # With the interpreter lock held, there would be none but the first and the last.
    assert turns > 100


@pytest.mark.parametrize("wakeup", ["futex", "predictive", "event"])
def test_a_wait_ends_with_a_frame(stage: Stage, wakeup: Literal["futex", "predictive", "event"]) -> None:
    with stage.subscriber(wakeup=wakeup) as subscriber:
        assert subscriber.wait(0) is False
        assert not subscriber.is_connected
        stage.driver(simulated())
        assert subscriber.wait() is True
        assert subscriber.is_connected
        for _, _ in zip(range(40), subscriber):
            pass
        assert (subscriber.frames, subscriber.lost) == (40, 0)


@pytest.mark.parametrize("statement", ["subscriber.wait()", "next(subscriber)", "uvcam.health('left', **address, timeout=None)"])
def test_an_interrupt_ends_a_wait(stage: Stage, statement: str) -> None:
    script = (
        "import sys, uvcam\n"
        "address = dict(prefix=sys.argv[1], root_path=sys.argv[2])\n"
        "subscriber = uvcam.Subscriber('left', **address)\n"
        "print('waits', flush=True)\n"
        f"{statement}\n"
    )
    words = [sys.executable, "-c", script, *stage.words()]
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert program.stdout is not None
    assert program.stdout.readline() == "waits\n"
    status = Path(f"/proc/{program.pid}/status")
    wait_until("its sleep", lambda: "S (sleeping)" in status.read_text())
    program.send_signal(signal.SIGINT)
    _, said = program.communicate(timeout=PATIENCE_S)
    assert "KeyboardInterrupt" in said


def test_another_thread_may_close_a_subscriber_that_waits(stage: Stage) -> None:
    with stage.subscriber() as subscriber, ThreadPoolExecutor(1) as thread:
        frames = thread.submit(list[uvcam.Frame], subscriber)
        wait_until("its wait", lambda: is_in_use(subscriber))
        subscriber.close()
        assert frames.result(PATIENCE_S) == []
        assert subscriber.is_closed


def is_in_use(subscriber: uvcam.Subscriber) -> bool:
    """Whether another thread waits with it, which is told and does not block."""
    try:
        subscriber.receive()
    except uvcam.Error as error:
        assert error.kind == "in_use"
        assert "open a subscriber for each thread" in str(error)
        return True
    return False


def test_a_closed_subscriber_says_so(stage: Stage) -> None:
    with stage.subscriber() as subscriber:
        pass
    for use in (subscriber.receive, subscriber.receive_latest, subscriber.wait):
        with pytest.raises(uvcam.Error, match="is closed: open another one") as caught:
            use()
        assert caught.value.kind == "closed"
    assert list(subscriber) == []
    subscriber.close()
    assert (subscriber.frames, subscriber.is_closed) == (0, True)


def test_asyncio_serves_cameras_side_by_side(stage: Stage) -> None:
    stage.driver(simulated("left") + simulated("right"))

    async def consume(camera: str) -> list[int]:
        sequences: list[int] = []
        with stage.subscriber(camera) as subscriber:
            async for frame in subscriber:
                sequences.append(frame.header.sequence)
                if len(sequences) == 60:
                    break
        assert subscriber.lost == 0
        return sequences

    async def main() -> None:
        for sequences in await asyncio.gather(consume("left"), consume("right")):
            assert sequences == list(range(sequences[0], sequences[0] + 60))

    asyncio.run(main())


def test_a_cancelled_task_loses_no_frame(stage: Stage) -> None:
    async def main() -> None:
        cancelled, sequences = 0, list[int]()
        with stage.subscriber() as subscriber:
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(anext(subscriber), 0.01)
            stage.driver(simulated())
            while len(sequences) < 60:
                try:
                    frame = await asyncio.wait_for(anext(subscriber), 0.004)
                    sequences.append(frame.header.sequence)
                except asyncio.TimeoutError:
                    cancelled += 1
        # The camera may begin while the consumer still connects.
        assert sequences == list(range(sequences[0], sequences[0] + 60))
        assert cancelled > 60

    asyncio.run(main())


def test_close_ends_an_async_loop(stage: Stage) -> None:
    async def main() -> None:
        with stage.subscriber() as subscriber:
            asyncio.get_running_loop().call_later(0.01, subscriber.close)
            assert [frame async for frame in subscriber] == []
        with pytest.raises(StopAsyncIteration):
            await anext(subscriber)

    asyncio.run(main())
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("uvcam")]


def test_counters_can_be_read_while_another_thread_waits(stage: Stage) -> None:
    driver = stage.driver(simulated())
    with stage.subscriber() as subscriber, ThreadPoolExecutor(1) as thread:
        next_frame(subscriber)
        driver.kill()
        driver.wait()
        frames = thread.submit(lambda: sum(1 for _ in subscriber))
        wait_until("its wait", lambda: is_in_use(subscriber))
        assert subscriber.epochs == 1
        assert subscriber.frames >= 1
        subscriber.close()
        assert 1 + frames.result(PATIENCE_S) == subscriber.frames
