"""Events of the DSEC dataset: HDF5 with `events/{x,y,t,p}` and `t_offset`.

Format: https://dsec.ifi.uzh.ch/data-format. h5py, which reads it, is an extra, and so is
hdf5plugin with the compression (Blosc) that the dataset uses.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray

from .base import RecordingError, TruncatedRecordingError

ENCODING = "dsec"
_INSTALL = "pip install h5py hdf5plugin"
_COLUMNS = ("x", "y", "t", "p")
_CHUNK_EVENTS = 1_000_000
#: What polarities may be written as, OFF and ON.
_POLARITIES = ((0, 1), (-1, 1), (0, 255))


def event_stream(path: Path, wanted: str | None = None) -> tuple[int, int, int]:
    """How many events a file has; width and height as 0, as such a file doesn't say.

    Parameters
    ----------
    path : path
        The file.
    wanted : str, optional
        Such a file has one stream of events, so there is nothing to choose.

    Raises
    ------
    RecordingError
        If it isn't such a file, or what reads it isn't installed.
    """
    if wanted is not None:
        raise RecordingError(f"{path}: an HDF5 file has one stream of events; leave out --topic")
    with _open(path) as file:
        missing = [name for name in _COLUMNS if f"events/{name}" not in file]
        if missing:
            raise RecordingError(
                f"{path}: is not of the DSEC dataset: there is no events/{missing[0]}; "
                f"it has {', '.join(file) or 'nothing'}"
            )
        counts = {file[f"events/{name}"].shape for name in _COLUMNS}
        if len(counts) > 1 or len(next(iter(counts))) != 1:
            raise RecordingError(f"{path}: events/x, y, t and p are not of one length")
        if (kind := file["events/t"].dtype).kind not in "iu":
            raise RecordingError(f"{path}: events/t is of {kind}; expected whole microseconds")
        return int(next(iter(counts))[0]), 0, 0


def read_events(path: Path, count: int) -> Iterator[EventArray]:
    """Events of a file, block by block; times are `t_offset` + `t`, µs to ns.

    Raises
    ------
    RecordingError
        If it can't be read, or polarities are none.
    TruncatedRecordingError
        Where a block can't be read; what came before is good.
    """
    with _open(path) as file:
        offset_us = int(file["t_offset"][()]) if "t_offset" in file else 0
        for begin in range(0, count, _CHUNK_EVENTS):
            end = min(begin + _CHUNK_EVENTS, count)
            try:
                x, y, t, p = (file[f"events/{name}"][begin:end] for name in _COLUMNS)
            except OSError as error:
                if "registered" in str(error) or "plugin" in str(error):
                    raise RecordingError(
                        f"{path}: its compression needs hdf5plugin: {_INSTALL}"
                    ) from error
                raise TruncatedRecordingError(
                    f"{path}: damaged in events {begin} to {end} ({error}); "
                    "what came before is read"
                ) from error
            yield EventArray.from_arrays(
                x, y, (t.astype(np.int64) + offset_us) * 1000, _polarity(path, p)
            )


def _polarity(path: Path, values: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
    """Whether events are ON.

    Raises
    ------
    RecordingError
        Where that can't be told.
    """
    found = set(np.unique(values).tolist())
    if not any(found <= set(pair) for pair in _POLARITIES):
        known = " or ".join("{} and {}".format(*pair) for pair in _POLARITIES)
        raise RecordingError(
            f"{path}: events/p holds values from {min(found)} to {max(found)}; expected {known}"
        )
    return np.asarray(values > 0)


def _open(path: Path) -> Any:
    """The file, open; hdf5plugin, where it is installed, brings its compressions."""
    try:
        import h5py
    except ImportError as error:
        raise RecordingError(f"{path}: reading HDF5 needs h5py: {_INSTALL}") from error
    with suppress(ImportError):  # said where it is missed
        import hdf5plugin  # noqa: F401
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise RecordingError(f"{path}: can't be read as HDF5 ({error})") from error
