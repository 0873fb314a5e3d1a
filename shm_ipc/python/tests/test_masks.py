"""Masks: in the frames, and beside them."""

import gc
import hashlib
import signal

import numpy as np
import PIL.Image
import pytest
import uvcam
from stage import Stage, next_frame, simulated, wait_until


def mask_of(subscriber: uvcam.Subscriber) -> tuple[uvcam.Frame, uvcam.Mask]:
    """A frame with its mask, which must come."""
    found: list[tuple[uvcam.Frame, uvcam.Mask]] = []

    def ask() -> bool:
        frame = next_frame(subscriber)
        try:
            mask = subscriber.mask_of(frame)
        except uvcam.Error as error:
            assert error.kind == "mask_pending"
            return False
        assert mask is not None
        found.append((frame, mask))
        return True

    wait_until("a mask", ask)
    return found[0]


def write_mask(stage: Stage, first_row: int) -> None:
    """Writes a mask that blanks all rows from one on."""
    mask = np.full((480, 752), 255, np.uint8)
    mask[first_row:] = 0
    # In one step: a driver reads the old one or the new one.
    PIL.Image.fromarray(mask).save(stage.folder / "new.png")
    (stage.folder / "new.png").rename(stage.folder / "mask.png")


def identity(mask: uvcam.Mask) -> str:
    """What a mask is known by: the hash of its binary PGM."""
    height, width = mask.array.shape
    return hashlib.sha256(b"P5\n%d %d\n255\n" % (width, height) + mask.array.tobytes()).hexdigest()[:32]


def test_a_frame_has_its_own_mask_however_often_it_changes(stage: Stage) -> None:
    write_mask(stage, 400)
    driver = stage.driver(simulated(mask="mask.png"))
    seen: list[str] = []
    with stage.subscriber() as subscriber:
        frame, mask = mask_of(subscriber)
        while len(seen) < 20:
            assert frame.header.flags == uvcam.Flags.MASKED | uvcam.Flags.SIMULATED
            assert mask.id == frame.header.mask_id == identity(mask)
            assert not frame.array[mask.array == 0].any()
            assert frame.array[mask.array == 255].any()
            if mask.id not in seen:
                seen.append(mask.id)
                write_mask(stage, 400 - len(seen))
                driver.send_signal(signal.SIGHUP)
            frame, mask = mask_of(subscriber)
        assert subscriber.lost == 0


def test_an_attached_mask_leaves_pixels_as_they_are(stage: Stage) -> None:
    write_mask(stage, 10)
    stage.driver(simulated(mask="mask.png", more='mask_mode = "attach"\n'))
    with stage.subscriber() as subscriber:
        frame, mask = mask_of(subscriber)
        assert frame.header.flags == uvcam.Flags.MASK_ATTACHED | uvcam.Flags.SIMULATED
        assert mask.id == frame.header.mask_id == identity(mask)
        assert not mask.array[10:].any()
        assert frame.array[mask.array == 0].any()


def test_a_mask_is_an_array_beside_its_frame(stage: Stage) -> None:
    stage.publisher("Mono8", "64")
    with stage.subscriber("padded") as subscriber:
        frame, mask = mask_of(subscriber)
        assert frame.header.flags == uvcam.Flags.MASK_ATTACHED
        assert mask.id == frame.header.mask_id == "a5" * 16
        expected = np.full((5, 30), 255)
        expected[1, 4:6] = expected[3, 28:30] = 0
        assert np.array_equal(mask.array, expected)
        assert mask.array.shape == frame.array.shape
        assert not mask.array.flags.writeable
        with pytest.raises(ValueError, match="WRITEABLE"):
            mask.array.flags.writeable = True
        assert mask.runs.tolist() == [[1, 4, 2], [3, 28, 2]]
        assert mask.masked_px == 4
        assert mask.provenance == {"method": "by hand"}
        array = mask.array
    del mask, subscriber
    gc.collect()
    assert np.array_equal(array, expected)


def test_a_mask_grows_to_each_side(stage: Stage) -> None:
    stage.publisher("Mono8", "64")
    with stage.subscriber("padded") as subscriber:
        _, mask = mask_of(subscriber)
    expected = np.full((5, 30), 255)
    expected[0:3, 3:7] = expected[2:5, 27:30] = 0
    assert np.array_equal(mask.grown(1), expected)
    assert np.array_equal(mask.grown(0), mask.array)
    with pytest.raises(OverflowError):
        mask.grown(-1)


def test_a_camera_without_a_mask_has_none(stage: Stage) -> None:
    stage.driver(simulated())
    with stage.subscriber() as subscriber:
        assert subscriber.mask_of(next_frame(subscriber)) is None
