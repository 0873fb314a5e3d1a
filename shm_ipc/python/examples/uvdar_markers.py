"""Prints where blinking markers are in each frame, by the rule of UVDAR's detector: brighter than all of a ring around it.

python uvdar_markers.py left [PREFIX ROOT_PATH]
"""

import sys

import numpy as np
import uvcam
from numpy.typing import NDArray

THRESHOLD = 50
# Offsets (row, column) of the pixels of each ring, by the squares of their distances: radius 3, then 4.
SQUARES = np.add.outer(np.arange(-4, 5) ** 2, np.arange(-4, 5) ** 2)
RINGS = [np.argwhere(np.isin(SQUARES, squares)) - 4 for squares in ([8, 9, 10], [13, 16, 17])]


def markers(image: NDArray[np.uint8 | np.uint16]) -> list[tuple[int, int]]:
    """(column, row) of each marker in an 8-bit image, a few pixels from its border at least."""
    rows, columns = (np.argwhere(image[4:-4, 4:-4] >= THRESHOLD) + 4).T
    centre, undecided, chosen = image[rows, columns].astype(int), rows > 0, rows < 0
    for ring in RINGS:
        around = image[rows[:, None] + ring[:, 0], columns[:, None] + ring[:, 1]].astype(int)
        is_marker = undecided & (centre - around.max(axis=1) >= THRESHOLD // 2)
        is_sun = (centre >= 150) & (centre - around.min(axis=1) <= THRESHOLD // 2)
        chosen, undecided = chosen | is_marker, undecided & ~is_marker & ~is_sun
    found: list[tuple[int, int]] = []
    for column, row in zip(columns[chosen].tolist(), rows[chosen].tolist()):
        if all(max(abs(column - x), abs(row - y)) > 5 for x, y in found):
            found.append((column, row))
    return found


if __name__ == "__main__":
    camera = sys.argv[1]
    prefix, root_path = sys.argv[2:] or (None, None)
    with uvcam.Subscriber(camera, prefix=prefix, root_path=root_path) as subscriber:
        for frame in subscriber:
            print(f"{frame.header.device_frame_id}: {markers(frame.array)}", flush=True)
