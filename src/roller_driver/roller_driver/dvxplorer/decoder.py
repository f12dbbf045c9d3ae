"""From the camera's transfers to events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray

from . import _kernels, protocol

_EVENTS_A_WORD = 16


@dataclass(frozen=True, slots=True)
class DecoderCounts:
    """What the decoder saw since it was made."""

    #: Decoded events and read-out frames.
    events: int = 0
    frames: int = 0
    #: Times that a frame didn't come later than the one before: a time-stamp reference was lost.
    lost_references: int = 0
    #: Times that a column wasn't further right than the one before: the start of a frame was lost.
    column_jumps: int = 0
    #: Frames left out, wholly or in part, because their time wasn't known; pixel words in them.
    dropped_frames: int = 0
    dropped_words: int = 0
    #: Words that are zero.
    padding: int = 0
    #: Words of no known kind or beyond the sensor; references out of turn.
    bad_words: int = 0
    bad_references: int = 0
    #: Times that the camera's clock was set again.
    time_steps: int = 0

    @property
    def errors(self) -> int:
        """All faults of the stream."""
        return self.lost_references + self.column_jumps + self.bad_words + self.bad_references


class WordDecoder:
    """Decodes the stream of 32-bit words, transfer by transfer.

    Times are the sensor's, in ns, extended over the overflow of the 22-bit millisecond reference.
    All events of a read-out frame have one time. A frame whose reference was lost is left out up
    to the next reference, and counted.

    Parameters
    ----------
    words : int
        Largest transfer expected, in words; longer ones enlarge the buffers.
    """

    def __init__(self, words: int = 32768) -> None:
        self._counts = np.zeros(_kernels.COUNTS, np.int64)
        self._events = 0
        self._allocate(words)
        self._state = np.empty(_kernels.STATE_SIZE, np.int64)
        self._rest, self._cut_bytes = b"", 0
        self.reset()
        # Compiles the kernel before the first transfer waits for it.
        self.decode(np.empty(0, np.uint8))

    def reset(self) -> None:
        """Forget all state, as after the camera was restarted; the counts stay."""
        self._state[:] = -1
        self._state[_kernels.EXTENDED] = self._state[_kernels.TIME_US] = 0
        self._state[_kernels.STARTED] = 0
        self._rest, self._cut_bytes = b"", 0

    def leave_gap(self, missing_bytes: int) -> None:
        """Transfers are missing: what follows is left out up to the next time-stamp reference.

        Parameters
        ----------
        missing_bytes : int
            How long they were: where the next whole word begins.
        """
        self._state[[_kernels.REFERENCE, _kernels.COLUMN]] = -1
        self._cut_bytes = -(len(self._rest) - self._cut_bytes + missing_bytes) % 4
        self._rest = b""

    def decode(self, transfer: bytes | memoryview | npt.NDArray[np.uint8]) -> EventArray:
        """Decode one transfer.

        Parameters
        ----------
        transfer : bytes or ndarray of uint8
            What came over USB; a word may continue in the next transfer.

        Returns
        -------
        EventArray
            Times in sensor time, ns. The arrays are views that hold until the next call.
        """
        raw = np.frombuffer(transfer, np.uint8)
        if self._cut_bytes:  # the end of a word whose beginning is missing
            begin = min(self._cut_bytes, len(raw))
            self._cut_bytes -= begin
            raw = raw[begin:]
        if self._rest:
            raw = np.concatenate([np.frombuffer(self._rest, np.uint8), raw])
        whole = len(raw) & ~3
        self._rest = raw[whole:].tobytes()
        words = raw[:whole].view("<u4")
        if len(words) * _EVENTS_A_WORD > len(self._x):
            self._allocate(len(words))
        x, y, t, p = self._x, self._y, self._t, self._p
        n = _kernels._decode_words(
            words, protocol.WIDTH, protocol.HEIGHT, self._state, self._counts, x, y, t, p
        )
        self._events += n
        return EventArray(x[:n], y[:n], t[:n], p[:n])

    @property
    def counts(self) -> DecoderCounts:
        """What was seen so far."""
        k, c = _kernels, [int(v) for v in self._counts]
        return DecoderCounts(
            events=self._events,
            frames=c[k.FRAMES],
            lost_references=c[k.LOST_REFERENCES],
            column_jumps=c[k.COLUMN_JUMPS],
            dropped_frames=c[k.DROPPED_FRAMES],
            dropped_words=c[k.DROPPED_WORDS],
            padding=c[k.PADDING],
            bad_words=c[k.BAD_WORDS],
            bad_references=c[k.BAD_REFERENCES],
            time_steps=c[k.TIME_STEPS],
        )

    def _allocate(self, words: int) -> None:
        size = max(words, 1) * _EVENTS_A_WORD
        self._x = np.empty(size, np.uint16)
        self._y = np.empty(size, np.uint16)
        self._t = np.empty(size, np.int64)
        self._p = np.empty(size, np.uint8)
