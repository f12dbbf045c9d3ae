"""Images as arrays; for who needs neither camera nor clouds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image

from roller_core.errors import RollerError


class ImageError(RollerError):
    """An image that can't be read."""


def image_to_array(message: Image) -> npt.NDArray[np.generic]:
    """Pixels, shape (height, width), of a 32FC1 or mono8 image.

    Raises
    ------
    ImageError
        If the encoding is another one, or the data don't fit its size.
    """
    kinds = {"32FC1": "<f4", "mono8": "u1"}
    if message.encoding not in kinds:
        raise ImageError(f"image encoding '{message.encoding}' is not one of {', '.join(kinds)}")
    kind = np.dtype(kinds[message.encoding])
    size, step = (message.width, message.height), message.step
    if len(message.data) != message.height * step or step < message.width * kind.itemsize:
        raise ImageError(
            f"image of {size[0]}×{size[1]} px has {len(message.data)} bytes in rows of {step}"
        )
    if step % kind.itemsize:
        raise ImageError(f"rows of {step} bytes hold no whole number of {message.encoding} pixels")
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    return rows[:, : message.width * kind.itemsize].view(kind)
