"""Poses in a text file, as the TUM RGB-D benchmark writes them."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from roller_core.pose_track import NoPosesError, PoseError, PoseTrack, PoseValueError
from roller_core.text_file import MOST_NUMBERS_BYTES, TextFileError, read_text
from roller_core.timing_settings import DEFAULT_MAX_POSE_GAP_S

#: Times are nanoseconds in 63 bits; poses that usually move faster than this are in millimetres,
#: m/s.
_MOST_NS, _FASTEST_M_S = 2**62, 50.0


def read_tum(
    path: Path | str,
    max_gap_s: float = DEFAULT_MAX_POSE_GAP_S,
    faults: list[PoseError] | None = None,
) -> PoseTrack:
    """Read lines `t x y z qx qy qz qw` (seconds, metres); `#` starts a comment.

    Parameters
    ----------
    path : Path or str
        The file.
    max_gap_s : float
        See `PoseTrack`.
    faults : list, optional
        Takes what is wrong, in place of an error: a pose that can't be one is left out; at a line
        that is malformed or goes back in time the poses end, unless there were none before it.

    Returns
    -------
    PoseTrack
        Its poses.

    Raises
    ------
    PoseError
        If the file can't be read, a line is malformed, time runs backwards, or the poses move as
        no sensor does.
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
            track.append(*_pose(fields))
        except PoseError as error:
            leaves_rest = isinstance(error, PoseValueError)
            kept = "" if leaves_rest or faults is None else "; what came before is kept"
            fault = type(error)(f"poses {path}, line {number}: {error}{kept}")
            if faults is None or not (len(track) or leaves_rest):
                raise fault from error
            faults.append(fault)
            if not leaves_rest:
                break
    if not len(track):
        raise NoPosesError(f"poses {path}: the file holds no pose")
    _check_unit(path, track)
    return track


def _check_unit(path: Path | str, track: PoseTrack) -> None:
    seconds = np.diff(track.times_ns) * 1e-9
    moved = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
    speeds = (moved / np.maximum(seconds, 1e-9))[moved > 0]
    if len(speeds) and np.median(speeds) > _FASTEST_M_S:
        raise PoseError(
            f"poses {path}: they move at {np.median(speeds):.3g} m/s; are positions in millimetres "
            "in place of metres?"
        )


def _pose(fields: Sequence[str]) -> tuple[int, list[float], list[float]]:
    """Time, ns, position and quaternion of a line."""
    try:
        if len(fields) != 8:
            raise ValueError(f"{len(fields)} fields")
        values = [float(f) for f in fields[1:]]
        return _nanoseconds(fields[0]), values[:3], values[3:]
    except ValueError as error:
        raise PoseError(f"{error}; expected 't x y z qx qy qz qw'") from error


def _nanoseconds(text: str) -> int:
    """Decimal seconds as text to whole nanoseconds, without a detour over float64."""
    try:
        t_ns = int((Decimal(text) * 1_000_000_000).to_integral_value())
    except (ArithmeticError, ValueError) as error:
        raise ValueError(f"'{text}' is no time in seconds") from error
    if abs(t_ns) > _MOST_NS:
        raise ValueError(f"'{text}' is no time in seconds; is it in nanoseconds?")
    return t_ns
