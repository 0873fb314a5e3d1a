"""What is refused, and what is said then."""

import math
import os
from pathlib import Path
from typing import Any, get_args

import pytest
import uvcam
from stage import Stage, next_frame, simulated


@pytest.mark.parametrize(
    ("arguments", "kind", "text"),
    [
        ({"camera": "a b"}, "camera_name", 'camera name "a b": use 1 to 64 letters'),
        ({"camera": "left", "prefix": ""}, "setting", 'prefix = "": use 1 to 32 letters'),
        ({"camera": "left", "root_path": "ipc"}, "setting", "root_path = ipc: use an absolute path"),
        ({"camera": "left", "root_path": Path("ipc")}, "setting", "root_path = ipc: use an absolute path"),
    ],
)
def test_what_cannot_be_is_refused_with_the_remedy(arguments: dict[str, Any], kind: str, text: str) -> None:
    for call in (uvcam.Subscriber, uvcam.health):
        with pytest.raises(uvcam.Error) as caught:
            call(**arguments)
        assert caught.value.kind == kind
        assert str(caught.value).startswith(text)
        assert str(caught.value) == f"{caught.value.message}: {caught.value.remedy}"


def test_wrong_arguments_are_refused_with_what_is_allowed(stage: Stage) -> None:
    with pytest.raises(ValueError, match='wakeup = "poll": use "futex", "predictive" or "event"'):
        stage.subscriber(wakeup="poll")
    with stage.subscriber() as subscriber:
        for timeout in (-1.0, math.nan, math.inf):
            with pytest.raises(ValueError, match="use seconds from 0 on, or None"):
                subscriber.wait(timeout)
        with pytest.raises(TypeError):
            subscriber.wait("soon")  # type: ignore[arg-type]


def test_another_users_driver_is_named(stage: Stage) -> None:
    stage.address["root_path"].mkdir()
    os.chown(stage.address["root_path"], 65534, 65534)
    with pytest.raises(uvcam.Error, match="belongs to user nobody.*as one user") as caught:
        stage.subscriber()
    assert caught.value.kind == "permission"


def test_a_place_too_few_is_told(stage: Stage) -> None:
    stage.driver(simulated(), ipc="max_subscribers = 1\n")
    with stage.subscriber() as first:
        next_frame(first)
        with pytest.raises(uvcam.Error, match="raise max_subscribers of the driver") as caught:
            stage.subscriber()
    assert caught.value.kind == "too_many_consumers"
    assert caught.value.kind in get_args(uvcam.Kind)


def test_a_newer_contract_is_refused_with_both_versions(stage: Stage) -> None:
    newer = stage.publisher("newer")
    assert newer.stdout is not None
    assert newer.stdout.readline() == b"ready\n"
    for call in (uvcam.Subscriber, uvcam.health):
        with pytest.raises(uvcam.Error) as caught:
            call("padded", **stage.address)
        assert caught.value.kind == "other_version"
        assert "under version 9 of the contract" in caught.value.message
        assert f"this program has version {uvcam.CONTRACT_VERSION}" in caught.value.message
        assert caught.value.remedy == "use driver and consumer of one version"


def in_fork(stage: Stage, subscriber: uvcam.Subscriber, frame: uvcam.Frame) -> None:
    """What a forked process sees of its parent's objects, and what it can do itself."""
    uses = (
        subscriber.receive,
        subscriber.wait,
        subscriber.close,
        lambda: next(subscriber),
        lambda: frame.array,
        lambda: frame.header,
        lambda: subscriber.mask_of(frame),
    )
    for use in uses:
        with pytest.raises(uvcam.Error, match="forked from it: open a subscriber in each process") as caught:
            use()
        assert caught.value.kind == "forked"
    del uses, use, subscriber, frame
    with stage.subscriber() as own:
        assert next_frame(own).array.shape == (480, 752)


def test_a_forked_process_is_told_and_harms_no_one(stage: Stage) -> None:
    stage.driver(simulated())
    subscriber = stage.subscriber()
    frame = next_frame(subscriber)
    array = frame.array
    copy = array.copy()
    child = os.fork()
    if child == 0:
        failed = True
        try:
            objects, frame, subscriber = (subscriber, frame), None, None  # type: ignore[assignment]
            in_fork(stage, *objects)
            del objects, array
            failed = False
        finally:
            os._exit(failed)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    # The parent has lost neither its place nor its slot.
    for _, later in zip(range(180), subscriber):
        assert later.header.epoch == frame.header.epoch
    assert (array == copy).all()
    subscriber.close()
