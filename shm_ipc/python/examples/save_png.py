"""Saves the newest frame as a PNG. Needs Pillow (python3-pil).

python save_png.py left left.png [PREFIX ROOT_PATH]
"""

import sys

import PIL.Image
import uvcam

camera, png = sys.argv[1:3]
prefix, root_path = sys.argv[3:] or (None, None)
with uvcam.Subscriber(camera, prefix=prefix, root_path=root_path) as subscriber:
    if not subscriber.wait(5.0) or (frame := subscriber.receive_latest()) is None:
        raise SystemExit(f"{camera}: no frame for 5 s; is `uvcam run` running?")
    PIL.Image.fromarray(frame.array).save(png)
    print(f"{png}: frame {frame.header.sequence}, mask {frame.header.mask_id or 'none'}")
