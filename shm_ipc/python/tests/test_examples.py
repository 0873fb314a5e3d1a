"""The examples, run as their reader runs them."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import uvcam
from stage import Stage, next_frame, simulated

EXAMPLES = Path(__file__).parents[1] / "examples"

# The simulated camera's markers: which frames of sixteen each is lit in.
CODES = [0b1110_0110_1010_0101, 0b1100_1011_0010_1101]
SIZE = (752, 480)


def start(stage: Stage, example: str, *words: str) -> "subprocess.Popen[str]":
    """Starts an example for the camera "left"."""
    command = [sys.executable, str(EXAMPLES / example), "left", *words, *stage.words()]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def lines(program: "subprocess.Popen[str]", count: int) -> list[str]:
    """The first lines that a program prints, which is then stopped."""
    assert program.stdout is not None
    read = [program.stdout.readline() for _ in range(count)]
    program.kill()
    program.communicate()
    return read


def test_rate_and_loss(stage: Stage) -> None:
    program = start(stage, "rate_and_loss.py")
    stage.driver(simulated(source=', faults = [{ kind = "lost", at_frame = 90, count = 3 }]'))
    said = lines(program, 6)
    assert sum(int(line.split()[-2]) for line in said) == 3, said
    assert max(float(line.split()[0]) for line in said) > 50, said


def test_save_png(stage: Stage) -> None:
    stage.driver(simulated(source=", still = true"))
    with stage.subscriber() as subscriber:
        expected = next_frame(subscriber).array.copy()
    png = stage.folder / "left.png"
    said, _ = start(stage, "save_png.py", str(png)).communicate()
    assert said.startswith(f"{png}: frame ") and said.endswith("mask none\n")
    with PIL.Image.open(png) as image:
        assert np.array_equal(np.asarray(image), expected)


def marker(number: int, frame: int) -> tuple[int, int] | None:
    """Where the simulated camera draws a marker, at its upper left pixel."""
    if not CODES[number] >> (frame % 16) & 1:
        return None
    angle = frame * 0.004 + number * 2.0
    x = (0.5 + 0.35 * np.sin(angle)) * SIZE[0]
    y = (0.25 + 0.15 * np.cos(1.7 * angle)) * SIZE[1]
    return int(x), int(y)


def test_markers_are_every_blinking_one_and_none_on_the_airframe(stage: Stage) -> None:
    # As bright as for a mask, where the airframe has what a detector takes for markers.
    no_airframe = '[camera.generate]\nignore = ["::0:300"]\n'
    stage.write(simulated(mask="mask.png", more=no_airframe).replace("exposure_us = 1000", "exposure_us = 5000"))
    subprocess.run(stage.command("generate", "left", "--accept"), check=True, capture_output=True)
    program = start(stage, "uvdar_markers.py")
    stage.driver()
    for line in lines(program, 120):
        frame_id, found = line.split(": ", 1)
        expected = [place for number in range(2) if (place := marker(number, int(frame_id)))]
        assert sorted(ast.literal_eval(found)) == sorted(expected), line


def test_without_the_mask_there_are_markers_on_the_airframe(stage: Stage) -> None:
    stage.driver(simulated().replace("exposure_us = 1000", "exposure_us = 5000"))
    sys.path.insert(0, str(EXAMPLES))
    from uvdar_markers import markers

    with stage.subscriber() as subscriber:
        frame = next_frame(subscriber)
        assert not frame.header.flags & uvcam.Flags.MASKED
        on_airframe = [(x, y) for x, y in markers(frame.array) if y > 300]
        assert on_airframe
