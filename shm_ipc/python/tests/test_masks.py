"""Masks: in the frames, and beside them."""

import gc
import subprocess

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


def test_masked_pixels_are_black_and_the_mask_is_named(stage: Stage) -> None:
    mask = np.full((480, 752), 255, np.uint8)
    mask[400:] = 0
    PIL.Image.fromarray(mask).save(stage.folder / "mask.png")
    stage.driver(simulated(mask="mask.png"))
    with stage.subscriber() as subscriber:
        frame = next_frame(subscriber)
    assert frame.header.flags == uvcam.Flags.MASKED | uvcam.Flags.SIMULATED
    assert not frame.array[400:].any()
    assert frame.array[:400].any()
    check = stage.command("mask", "check", str(stage.folder / "mask.png"))
    said = subprocess.run(check, capture_output=True, text=True, check=True).stdout
    assert frame.header.mask_id is not None
    assert frame.header.mask_id in said


def test_a_mask_is_an_array_beside_its_frame(stage: Stage) -> None:
    stage.publisher("Mono8", 64)
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
    stage.publisher("Mono8", 64)
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
