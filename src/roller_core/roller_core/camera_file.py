"""A ROS camera_info YAML file: its entries as they are read, and its text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from .camera_errors import CameraError


def _numbers(entry: Any) -> list[float]:
    """The numbers of a matrix, row by row."""
    numbers = [float(value) for value in entry["data"]]
    if {"rows", "cols"} <= entry.keys() and int(entry["rows"]) * int(entry["cols"]) != len(numbers):
        raise CameraError(
            f"a matrix of {entry['rows']} × {entry['cols']} has {len(numbers)} numbers"
        )
    return numbers


def _coefficients(entry: Any) -> list[float]:
    """The same, where none may be given."""
    none = not entry or (len(entry) < 3 and "data" not in entry and 0 in entry.values())
    return [] if none else _numbers(entry)


#: How alike an entry's name must be to one that is missing to be meant for it.
_ALIKE = 0.8
#: Entries of a camera_info YAML file in the order of `from_matrix`: how each is read, and what
#: stands for one that is left out; None: it must be there.
_ENTRIES: tuple[tuple[str, Callable[[Any], Any], Any], ...] = (
    ("image_width", int, None),
    ("image_height", int, None),
    ("camera_matrix", _numbers, None),
    ("distortion_coefficients", _coefficients, ()),
    ("distortion_model", lambda model: str(model or "plumb_bob"), "plumb_bob"),
)


def entries_of(data: Any) -> list[Any]:
    """What a camera_info YAML file says, in the order of `Camera.from_matrix`.

    Parameters
    ----------
    data : object
        What YAML makes of the file.

    Raises
    ------
    CameraError
        If an entry is missing or wrong; the first is named.
    """
    found: list[Any] = []
    missing = [name for name, *_ in _ENTRIES if isinstance(data, dict) and name not in data]
    for given in data if missing else ():
        # Left out it would stand for a lens without distortion.
        for meant in get_close_matches(str(given), missing, 1, _ALIKE):
            raise CameraError(f"unknown entry '{given}'; is it '{meant}'?")
    for name, read, default in _ENTRIES:
        try:
            absent = default is not None and name not in data
            found.append(default if absent else read(data[name]))
        except CameraError as error:
            raise CameraError(f"entry '{name}': {error}") from error
        except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise CameraError(
                f"entry '{name}' is missing or wrong; expected ROS camera_info YAML "
                "(image_width, image_height, camera_matrix, distortion_coefficients)"
            ) from error
    return found


def file_text(
    name: str,
    size: tuple[int, int],
    k: npt.NDArray[np.float64],
    model: str,
    distortion: Sequence[float],
) -> str:
    """The text of a camera_info YAML file.

    Parameters
    ----------
    name : str
        Of the camera.
    size : tuple of int
        Width and height, px.
    k : ndarray of float64, shape (3, 3)
        Intrinsic matrix, px.
    model : str
        Of the distortion.
    distortion : sequence of float
        Its coefficients.
    """
    projection = np.hstack([k, np.zeros((3, 1))])
    data = {
        "image_width": size[0],
        "image_height": size[1],
        "camera_name": name,
        "camera_matrix": _matrix(k),
        "distortion_model": model,
        "distortion_coefficients": _matrix(np.array([distortion])),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(projection),
    }
    return str(yaml.safe_dump(data, sort_keys=False))


def _matrix(values: npt.NDArray[np.float64]) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": values.ravel().tolist()}
