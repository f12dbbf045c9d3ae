"""What happened a second, from counts that only grow."""

from __future__ import annotations

from dataclasses import dataclass

from .reader import ReaderStatus


@dataclass(frozen=True, slots=True)
class Rate:
    """Rates since the last look: events, bytes and packets a second; errors and overruns in all."""

    events: float = 0.0
    bytes: float = 0.0
    packets: float = 0.0
    errors: int = 0
    overruns: int = 0


class Rates:
    """Remembers the last look at a reader."""

    def __init__(self) -> None:
        self._at = 0.0
        self._last: tuple[int, int, int, int, int] | None = None

    def since_last(self, status: ReaderStatus, now_s: float) -> Rate:
        """Rates since the last call; zeros at the first."""
        new = (
            status.decoder.events,
            status.usb.bytes,
            status.packets,
            status.decoder.errors,
            status.usb.overruns,
        )
        old, seconds = self._last or new, max(now_s - self._at, 1e-6)
        self._at, self._last = now_s, new
        # A reader made anew counts from zero.
        d = [max(a - b, 0) for a, b in zip(new, old, strict=True)]
        return Rate(d[0] / seconds, d[1] / seconds, d[2] / seconds, d[3], d[4])
