"""Events of AEDAT4 files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import aedat
import numpy as np

from roller_core.events import EventArray

from .base import RecordingError, TruncatedRecordingError

ENCODING = "aedat4"


def event_stream(path: Path, wanted: str | None = None) -> tuple[int, int, int]:
    """Number, width and height, px, of the stream of events of an AEDAT4 file.

    Raises
    ------
    RecordingError
        If there is none, or several and none is wanted.
    """
    found = {
        str(number): (number, int(stream["width"]), int(stream["height"]))
        for number, stream in sorted(_decoder(path).id_to_stream().items())
        if stream["type"] == "events"
    }
    if not found:
        raise RecordingError(f"{path}: the AEDAT4 file holds no event stream")
    if wanted is None and len(found) > 1:
        raise RecordingError(
            f"{path}: the AEDAT4 file holds several event streams; choose with --topic: "
            f"{', '.join(found)}"
        )
    if wanted is not None and wanted not in found:
        raise RecordingError(
            f"{path}: stream {wanted} is none of events; those are {', '.join(found)}"
        )
    return found[wanted] if wanted is not None else next(iter(found.values()))


def read_events(path: Path, stream: int) -> Iterator[EventArray]:
    """Events of a stream of an AEDAT4 file, packet by packet, times as recorded (µs to ns).

    Raises
    ------
    RecordingError
        If the file can't be opened.
    TruncatedRecordingError
        Where the file breaks off.
    """
    packets = iter(_decoder(path))
    count, first_ns, last_ns = 0, 0, 0
    while True:
        try:
            packet = next(packets, None)
        except BaseException as error:
            raise TruncatedRecordingError(
                f"{path}: cut off or broken after {(last_ns - first_ns) * 1e-9:.3f} s "
                f"({_reason(error)}); the {count} events before are read"
            ) from error
        if packet is None:
            return
        if "events" not in packet or packet["stream_id"] != stream:
            continue
        e = packet["events"]
        events = EventArray.from_arrays(
            e["x"], e["y"], e["t"].astype(np.int64) * 1000, e["on"].astype(np.uint8)
        )
        if len(events):
            first_ns = first_ns if count else int(events.t_ns[0])
            last_ns = int(events.t_ns[-1])
        count += len(events)
        yield events


def _decoder(path: Path) -> Any:
    try:
        return aedat.Decoder(str(path))
    except BaseException as error:
        raise RecordingError(f"{path}: not a readable AEDAT4 file ({_reason(error)})") from error


def _reason(error: BaseException) -> str:
    """What the library says; it panics on some broken files, which is no `Exception`."""
    if isinstance(error, KeyboardInterrupt | SystemExit):
        raise error
    return str(error)
