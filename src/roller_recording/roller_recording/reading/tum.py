"""Poses in a text file, as the TUM RGB-D benchmark writes them."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from pathlib import Path

from roller_core.pose_track import NoPosesError, PoseError, PoseTrack
from roller_core.text_file import MOST_NUMBERS_BYTES, TextFileError, read_text


def read_tum(path: Path | str, max_gap_s: float = 0.1) -> PoseTrack:
    """Read lines `t x y z qx qy qz qw` (seconds, metres); `#` starts a comment.

    Parameters
    ----------
    path : Path or str
        The file.
    max_gap_s : float
        See `PoseTrack`.

    Returns
    -------
    PoseTrack
        Its poses.

    Raises
    ------
    PoseError
        If the file can't be read, a line is malformed or time runs backwards.
    """
    track = PoseTrack(max_gap_s)
    try:
        text = read_text(path, MOST_NUMBERS_BYTES)
    except TextFileError as error:
        raise PoseError(f"poses {error}") from error
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split("#")[0].split()
        if not fields:
            continue
        try:
            if len(fields) != 8:
                raise ValueError(f"{len(fields)} fields")
            t_ns = _nanoseconds(fields[0])
            values = [float(f) for f in fields[1:]]
        except ValueError as error:
            raise PoseError(
                f"poses {path}, line {number}: {error}; expected 't x y z qx qy qz qw'"
            ) from error
        try:
            track.append(t_ns, values[:3], values[3:])
        except PoseError as error:
            raise type(error)(f"poses {path}, line {number}: {error}") from error
    if not len(track):
        raise NoPosesError(f"poses {path}: the file holds no pose")
    return track


def _nanoseconds(text: str) -> int:
    """Decimal seconds as text to whole nanoseconds, without a detour over float64."""
    try:
        return int((Decimal(text) * 1_000_000_000).to_integral_value())
    except (InvalidOperation, OverflowError, ValueError) as error:
        raise ValueError(f"'{text}' is no time in seconds") from error
