"""From events to packets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray

from . import _kernels
from .errors import CodecError, PacketTimeError, UnknownEncodingError

#: Longest time from `time_base` to the last event that one packet can hold, ns.
MAX_SPAN_NS = {
    "mono": 2**32 - 1,
    "libcaer": (2**31 - 1) * 1000,
    "libcaer_cmp": (2**24 - 1) * 1000,
    "evt3": (2**23 - 1) * 1000,
}


def encode(encoding: str, events: EventArray, time_base_ns: int) -> npt.NDArray[np.uint8]:
    """Encode events in order of time as one packet.

    `mono` keeps nanoseconds; the others keep whole microseconds after `time_base_ns`. `evt3` has
    no time base: it holds the low 24 bits of the absolute time in microseconds.

    Parameters
    ----------
    encoding : str
        One of `mono`, `libcaer`, `libcaer_cmp`, `evt3`.
    events : EventArray
        Events in order of time, none before `time_base_ns`.
    time_base_ns : int
        Sensor time that the packet's times count from, ns.

    Returns
    -------
    ndarray of uint8
        The message's `events`.

    Raises
    ------
    UnknownEncodingError
        If the encoding can't be written.
    PacketTimeError
        If a time lies before the time base, runs backwards or beyond `MAX_SPAN_NS`.
    CodecError
        If a pixel doesn't fit the encoding.
    """
    if encoding not in MAX_SPAN_NS:
        raise UnknownEncodingError(
            f"can't encode events as '{encoding}'; known are {', '.join(MAX_SPAN_NS)}"
        )
    if not len(events):
        return np.empty(0, np.uint8)
    dt_ns = events.t_ns - time_base_ns
    if dt_ns[0] < 0 or np.any(np.diff(dt_ns) < 0) or dt_ns[-1] > MAX_SPAN_NS[encoding]:
        raise PacketTimeError(
            f"event times from {int(dt_ns.min())} to {int(dt_ns.max())} ns after the time base "
            f"don't fit one {encoding} packet; sort them and split packets"
        )
    limit = 0x7FF if encoding in ("libcaer_cmp", "evt3") else 0x7FFF
    if max(int(events.x.max()), int(events.y.max())) > limit:
        raise CodecError(f"{encoding} holds pixels up to {limit}; the events have larger ones")
    if encoding == "mono":
        return _encode_mono(events, dt_ns)
    if encoding == "libcaer":
        return _encode_libcaer(events, dt_ns // 1000)
    # Worst case: two time words, an address of the other axis and the event itself.
    words = np.empty(4 * len(events), np.uint16)
    if encoding == "libcaer_cmp":
        n = _kernels._encode_libcaer_cmp(events.x, events.y, dt_ns // 1000, events.p, words)
    else:
        n = _kernels._encode_evt3(events.x, events.y, events.t_ns // 1000, events.p, words)
    return words[:n].view(np.uint8)


def _encode_mono(events: EventArray, dt_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    words = dt_ns.astype(np.uint64)
    words |= events.x.astype(np.uint64) << np.uint64(32)
    words |= events.y.astype(np.uint64) << np.uint64(48)
    words |= events.p.astype(np.uint64) << np.uint64(63)
    return words.view(np.uint8)


def _encode_libcaer(events: EventArray, dt_us: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    pairs = np.empty((len(events), 2), np.uint32)
    pairs[:, 0] = (
        1
        | (events.p.astype(np.uint32) << 1)
        | (events.y.astype(np.uint32) << 2)
        | (events.x.astype(np.uint32) << 17)
    )
    pairs[:, 1] = dt_us.astype(np.uint32)
    return pairs.reshape(-1).view(np.uint8)
