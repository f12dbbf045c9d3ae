"""From packets to events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray, TriggerArray

from . import _kernels
from .errors import PacketLengthError, PacketTimeError, UnknownEncodingError

Payload = bytes | bytearray | memoryview | npt.NDArray[np.uint8]

#: Times from here on (146 years) are no times: sums with them would leave 64 bits.
_MOST_NS = 2**62
#: Of encodings whose words begin with a code of four bits: a bit for each code that is one.
_KNOWN_CODES = {"libcaer_cmp": np.uint16(0x003F), "evt3": np.uint16(0xC5FD)}
_NO_TRIGGERS = TriggerArray.empty()
_WORD_BYTES = {"mono": 8, "trigger": 8, "libcaer": 8, "libcaer_cmp": 2, "evt3": 2}


@dataclass(frozen=True, slots=True)
class DecodedPacket:
    """What one packet held."""

    #: Events in the packet's order; times in sensor time, ns.
    events: EventArray
    #: Edges on the trigger inputs.
    triggers: TriggerArray
    #: Events left out because their pixel lies outside the image.
    outside: int = 0
    #: Events left out because no time had come before them (`evt3`).
    untimed: int = 0
    #: Whether the events are known to be in order of time.
    ordered: bool = False


def unknown_words(encoding: str, payload: Payload) -> npt.NDArray[np.intp]:
    """Where a payload has words that mean nothing in its encoding, bytes from its begin.

    The decoder leaves them out. In encodings whose words are whole events there are none.
    """
    known = _KNOWN_CODES.get(encoding)
    if known is None:
        return np.empty(0, np.intp)
    raw = np.frombuffer(payload, np.uint8)
    words = raw[: len(raw) // 2 * 2].view("<u2")
    return 2 * np.flatnonzero((known >> (words >> 12)) & 1 == 0)


class PacketDecoder:
    """Decodes the packets of one stream in order.

    `evt3` carries time from packet to packet, so one decoder serves one stream.

    Parameters
    ----------
    encoding : str
        One of `mono`, `libcaer`, `libcaer_cmp`, `evt3`, `trigger`.
    width, height : int
        Image size in pixels; events outside it are counted and left out.

    Raises
    ------
    UnknownEncodingError
        If the encoding isn't known.
    """

    def __init__(self, encoding: str, width: int, height: int) -> None:
        if encoding not in _WORD_BYTES:
            raise UnknownEncodingError(
                f"event packets are encoded as '{encoding}'; known are {', '.join(_WORD_BYTES)}"
            )
        self.encoding = encoding
        self.width = width
        self.height = height
        self._evt3 = np.zeros(_kernels.EVT3_STATE_SIZE, np.int64)

    def decode(self, payload: Payload, time_base_ns: int = 0) -> DecodedPacket:
        """Decode one packet.

        Parameters
        ----------
        payload : bytes-like or ndarray of uint8
            The message's `events`.
        time_base_ns : int
            The message's `time_base`, ns.

        Raises
        ------
        PacketLengthError
            If the payload is no whole number of words; the decoder's state is unchanged.
        PacketTimeError
            If `time_base` is no time.
        """
        if not 0 <= time_base_ns < _MOST_NS:
            raise PacketTimeError(
                f"{self.encoding} packet with time_base {time_base_ns} ns: that is no sensor time"
            )
        raw = np.frombuffer(payload, np.uint8)
        word = _WORD_BYTES[self.encoding]
        if len(raw) % word:
            raise PacketLengthError(
                f"{self.encoding} packet of {len(raw)} bytes is no whole number of "
                f"{word}-byte words; the packet is cut off or not {self.encoding}"
            )
        if self.encoding == "trigger":
            return DecodedPacket(EventArray.empty(), _triggers(raw, time_base_ns))
        if self.encoding == "mono":
            return self._inside(*_decode_mono(raw, time_base_ns))
        if self.encoding == "libcaer":
            return self._inside(*_decode_libcaer(raw, time_base_ns))
        words = raw.view("<u2")
        # As those of a message in memory that isn't ours are: kernels are then of one kind.
        words.flags.writeable = False
        if self.encoding == "libcaer_cmp":
            count = _kernels._count_libcaer_cmp(words)
            x, y, t, p = _allocate(count + _kernels.VECTOR)
            n, ordered = _kernels._decode_libcaer_cmp(
                words, time_base_ns, self.width, self.height, _kernels.SET_BITS, x, y, t, p
            )
            events = EventArray(x[:n], y[:n], t[:n], p[:n])
            return DecodedPacket(events, _NO_TRIGGERS, count - n, ordered=ordered)
        count, m = _kernels._count_evt3(words)
        fields = _allocate(count)
        ids, times, edges = np.empty(m, np.uint16), np.empty(m, np.int64), np.empty(m, np.uint8)
        n, m = _kernels._decode_evt3(words, self._evt3, *fields, ids, times, edges)
        x, y, t, p = fields
        packet = self._inside(x[:n], y[:n], t[:n], p[:n])
        return DecodedPacket(
            packet.events, TriggerArray(ids[:m], times[:m], edges[:m]), packet.outside, count - n
        )

    def _inside(
        self,
        x: npt.NDArray[np.uint16],
        y: npt.NDArray[np.uint16],
        t: npt.NDArray[np.int64],
        p: npt.NDArray[np.uint8],
    ) -> DecodedPacket:
        n = _kernels._keep_inside(x, y, t, p, self.width, self.height)
        events = EventArray(x[:n], y[:n], t[:n], p[:n])
        return DecodedPacket(events, _NO_TRIGGERS, len(x) - n)


def _allocate(
    n: int,
) -> tuple[
    npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.int64], npt.NDArray[np.uint8]
]:
    return (
        np.empty(n, np.uint16),
        np.empty(n, np.uint16),
        np.empty(n, np.int64),
        np.empty(n, np.uint8),
    )


def _decode_mono(raw: npt.NDArray[np.uint8], time_base_ns: int):  # type: ignore[no-untyped-def]
    words = raw.view("<u8")
    t = time_base_ns + (words & 0xFFFFFFFF).astype(np.int64)
    x = ((words >> np.uint64(32)) & np.uint64(0xFFFF)).astype(np.uint16)
    y = ((words >> np.uint64(48)) & np.uint64(0x7FFF)).astype(np.uint16)
    return x, y, t, (words >> np.uint64(63)).astype(np.uint8)


def _triggers(raw: npt.NDArray[np.uint8], time_base_ns: int) -> TriggerArray:
    x, _, t, edge = _decode_mono(raw, time_base_ns)
    return TriggerArray(x, t, edge)


def _decode_libcaer(raw: npt.NDArray[np.uint8], time_base_ns: int):  # type: ignore[no-untyped-def]
    pairs = raw.view("<u4").reshape(-1, 2)
    pairs = pairs[(pairs[:, 0] & 1) == 1]  # bit 0: the event is valid
    data = pairs[:, 0]
    t_us = pairs[:, 1].view(np.int32).astype(np.int64)
    # 31-bit microseconds start again at zero after 2^31 µs.
    if len(t_us) > 1:
        wraps = np.cumsum(np.diff(t_us, prepend=t_us[0]) < -(2**30))
        t_us = t_us + wraps * np.int64(2**31)
    return (
        ((data >> 17) & 0x7FFF).astype(np.uint16),
        ((data >> 2) & 0x7FFF).astype(np.uint16),
        time_base_ns + t_us * 1000,
        ((data >> 1) & 1).astype(np.uint8),
    )
