"""Frames as they come: whole, in order, where the camera wrote them."""

import gc
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import uvcam
from numpy.typing import NDArray
from stage import Stage, next_frame, simulated, wait_until


def address(array: NDArray[np.uint8 | np.uint16]) -> int:
    """Where an array begins."""
    return int(array.__array_interface__["data"][0])


def place(array: NDArray[np.uint8 | np.uint16]) -> tuple[str, int, str]:
    """The mapped file that an array lies in, the offset there, and the mapping's rights."""
    begin = address(array)
    with open("/proc/self/maps") as maps:
        for line in maps:
            span, rights, offset, _, _, *path = line.split()
            first, end = (int(number, 16) for number in span.split("-"))
            if first <= begin < end:
                return path[0], begin - first + int(offset, 16), rights
    raise AssertionError(f"{begin:#x} is not mapped")


def published(stage: Stage) -> int:
    """How many frames the driver has published."""
    health = uvcam.health("left", **stage.address)
    assert health is not None
    return health["published"]


def test_every_frame_comes_once_and_in_order(stage: Stage) -> None:
    with stage.subscriber() as subscriber:
        stage.driver(simulated())
        sequences = []
        for frame in subscriber:
            sequences.append(frame.header.sequence)
            assert (frame.lost_before, frame.epoch_changed) == (0, False)
            if len(sequences) == 60:
                break
    # The camera may begin while the consumer still connects.
    assert sequences == list(range(sequences[0], sequences[0] + 60))
    assert (subscriber.frames, subscriber.lost, subscriber.epochs, subscriber.rejected) == (60, 0, 1, 0)


def test_the_header_tells_what_the_configuration_says(stage: Stage) -> None:
    stage.driver(simulated(more="gain_db = 3.0\n"))
    with stage.subscriber() as subscriber:
        before = time.monotonic_ns()
        frame = next_frame(subscriber)
        header = frame.header
        after = time.monotonic_ns()
    assert (header.width, header.height, header.stride, header.pixel_format) == (752, 480, 752, "Mono8")
    assert (header.exposure_us, header.gain_db) == (1000.0, 3.0)
    assert header.flags == uvcam.Flags.SIMULATED
    assert header.mask_id is None
    assert header.frame_period_ns == 16_666_666
    assert header.mid_exposure_monotonic_ns < header.arrival_monotonic_ns <= header.send_monotonic_ns < after
    assert abs(header.mid_exposure_realtime_ns - time.time_ns()) < after - before + 60_000_000_000
    assert header is frame.header
    with pytest.raises(AttributeError):
        header.width = 1  # type: ignore[misc]


def test_an_array_is_the_slot_itself_and_read_only(stage: Stage) -> None:
    stage.driver(simulated())
    with stage.subscriber() as one, stage.subscriber() as other:
        frame, theirs = next_frame(one), next_frame(other)
        while frame.header.sequence != theirs.header.sequence:
            if frame.header.sequence < theirs.header.sequence:
                frame = next_frame(one)
            else:
                theirs = next_frame(other)
        array = frame.array
        assert (array.shape, array.dtype.name, array.strides) == ((480, 752), "uint8", (752, 1))
        base: object = array.base
        assert base is frame
        assert address(frame.array) == address(array)
        file, offset, rights = place(array)
        assert file.startswith(f"/dev/shm/{stage.address['prefix']}")
        assert rights == "r--s"
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
        # The other consumer's picture of the same frame is the same memory.
        assert place(theirs.array) == (file, offset, rights)


@pytest.mark.parametrize(("pixel_format", "bits"), [("Mono10", 10), ("Mono12", 12), ("Mono16", 16)])
def test_pixels_of_more_than_8_bits_are_words(stage: Stage, pixel_format: str, bits: int) -> None:
    stage.driver(simulated(more=f'pixel_format = "{pixel_format}"\n'))
    with stage.subscriber() as subscriber:
        frame = next_frame(subscriber)
        array = frame.array
        assert (array.shape, array.dtype.name, array.strides) == ((480, 752), "uint16", (1504, 2))
        assert frame.header.pixel_format == pixel_format
        assert not array.flags.writeable
        # The simulated camera renders 8 bits; its markers have 240 of 255.
        assert not (array & ((1 << (bits - 8)) - 1)).any()
        assert 240 <= array.max() >> (bits - 8) <= 255


@pytest.mark.parametrize(("pixel_format", "item_size", "stride"), [("Mono8", 1, 64), ("Mono16", 2, 77)])
def test_padding_is_passed_over(stage: Stage, pixel_format: str, item_size: int, stride: int) -> None:
    stage.publisher(pixel_format, str(stride))
    with stage.subscriber("padded") as subscriber:
        array = next_frame(subscriber).array
    assert (array.shape, array.strides) == ((5, 30), (stride, item_size))
    # Padding is 255, the pixels of each row are its number.
    assert array.tolist() == [[row] * 30 for row in range(5)]


def test_an_array_outlives_its_frame_and_the_subscriber(stage: Stage) -> None:
    stage.driver(simulated())
    with stage.subscriber() as subscriber:
        array = next_frame(subscriber).array
        view = array[100:200, 300:]
        copy = view.copy()
        begin = address(view)
    del array, subscriber
    gc.collect()
    # The driver goes through all of its slots meanwhile; one that was given back would be written.
    end = published(stage) + 300
    wait_until("three hundred frames more", lambda: published(stage) > end)
    assert address(view) == begin
    assert np.array_equal(view, copy)


def test_who_holds_too_many_is_told_to_drop_arrays(stage: Stage) -> None:
    stage.driver(simulated(), ipc="borrowed = 3\n")
    with stage.subscriber() as subscriber:
        arrays, sequence = [], 0
        with pytest.raises(uvcam.Error, match="keep array.copy") as caught:
            for frame in subscriber:
                arrays.append(frame.array)
                sequence = frame.header.sequence
        assert caught.value.kind == "too_many_held"
        assert len(arrays) == 3
        del frame
        arrays.pop()
        later = next_frame(subscriber)
        assert later.header.sequence == sequence + 1 + later.lost_before


def test_a_loss_in_the_camera_is_told(stage: Stage) -> None:
    with stage.subscriber() as subscriber:
        faults = ', faults = [{ kind = "lost", at_frame = 60, count = 3 }]'
        stage.driver(simulated(source=faults))
        lost = {}
        for frame in subscriber:
            lost[frame.header.sequence] = frame.lost_before
            if frame.header.sequence >= 70:
                break
    assert {sequence: count for sequence, count in lost.items() if count > 0} == {60: 3}
    assert subscriber.lost == 3


def test_who_reads_too_late_is_told_how_many_it_lost(stage: Stage) -> None:
    stage.driver(simulated())
    with stage.subscriber() as subscriber:
        first = next_frame(subscriber).header
        wait_until("more than the queue holds", lambda: published(stage) > first.sequence + 60)
        second = next_frame(subscriber)
        assert second.lost_before == second.header.produced - first.produced - 1 > 0
        assert subscriber.lost == second.lost_before
        # The newest one passes over others without a loss.
        newest = subscriber.receive_latest()
        assert newest is not None
        assert newest.header.sequence > second.header.sequence + 1
        assert newest.lost_before == 0


def test_a_driver_that_comes_back_begins_a_new_epoch(stage: Stage) -> None:
    driver = stage.driver(simulated())
    with stage.subscriber() as subscriber:
        last = next_frame(subscriber)
        driver.kill()
        driver.wait()
        stage.driver()
        received = 1
        while not (frame := next_frame(subscriber)).epoch_changed:
            last, received = frame, received + 1
        assert frame.header.epoch > last.header.epoch
        assert frame.lost_before == frame.header.produced - last.header.produced - 1
        assert (subscriber.frames, subscriber.epochs) == (received + 1, 2)


def test_consumers_that_stop_or_die_cost_others_nothing(stage: Stage) -> None:
    stage.driver(simulated())
    script = (
        "import sys, uvcam\n"
        "with uvcam.Subscriber('left', prefix=sys.argv[1], root_path=sys.argv[2]) as subscriber:\n"
        "    for frame in subscriber:\n"
        "        print(frame.header.sequence, flush=True)\n"
    )
    words = [sys.executable, "-c", script, *stage.words()]
    others = [subprocess.Popen(words, stdout=subprocess.PIPE) for _ in range(2)]
    for other in others:
        assert other.stdout is not None
        other.stdout.readline()
    with stage.subscriber() as subscriber:
        next_frame(subscriber)
        others[0].send_signal(signal.SIGSTOP)
        others[1].kill()
        for _, frame in zip(range(180), subscriber):
            assert frame.lost_before == 0
    for other in others:
        other.kill()
        other.communicate()
