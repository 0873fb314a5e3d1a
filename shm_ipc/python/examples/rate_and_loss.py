"""Prints once a second how many frames came and how many were lost.

python rate_and_loss.py left [PREFIX ROOT_PATH]
"""

import sys
import time

import uvcam

camera = sys.argv[1]
prefix, root_path = sys.argv[2:] or (None, None)
with uvcam.Subscriber(camera, prefix=prefix, root_path=root_path) as subscriber:
    since, frames, lost = time.monotonic(), 0, 0
    while True:
        subscriber.wait(1.0)
        while (frame := subscriber.receive()) is not None:
            if frame.epoch_changed:
                print("driver or camera started anew")
            del frame
        seconds = time.monotonic() - since
        if seconds >= 1.0:
            rate = (subscriber.frames - frames) / seconds
            print(f"{rate:.1f} frames a second, {subscriber.lost - lost} lost", flush=True)
            since, frames, lost = time.monotonic(), subscriber.frames, subscriber.lost
