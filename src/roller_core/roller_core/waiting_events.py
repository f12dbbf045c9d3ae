"""Events as they wait: in 9 bytes each in place of 13, as nodes of depth hold millions of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .events import EventArray

U32 = npt.NDArray[np.uint32]
I64 = npt.NDArray[np.int64]

#: What 32 bits tell, ns: 4.3 s.
_SHORT_NS = 2**32


@dataclass(frozen=True, slots=True)
class WaitingEvents:
    """Events that came at once, in order of time, at least one."""

    #: As of `EventArray`.
    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    p: npt.NDArray[np.uint8]
    #: From when on times are told, ns.
    start_ns: int
    #: Times; of 64 bits where these events last longer than 32 can tell.
    since_ns: U32 | I64

    @classmethod
    def of(cls, events: EventArray) -> WaitingEvents:
        """Events as they came; the arrays but the times are kept as they are."""
        t_ns, start_ns = events.t_ns, int(events.t_ns[0])
        if int(t_ns[-1]) - start_ns >= _SHORT_NS:
            return cls(events.x, events.y, events.p, 0, t_ns)
        # The low halves; what they differ by is right, whatever was cut off.
        since_ns = t_ns.astype(np.uint32)
        since_ns -= np.uint32(start_ns % _SHORT_NS)
        return cls(events.x, events.y, events.p, start_ns, since_ns)

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, index: slice) -> WaitingEvents:
        x, y, p, since_ns = self.x[index], self.y[index], self.p[index], self.since_ns[index]
        return replace(self, x=x, y=y, p=p, since_ns=since_ns)

    def time_of(self, number: int) -> int:
        """Time of an event, ns."""
        return self.start_ns + int(self.since_ns[number])

    def count_before(self, t_ns: int) -> int:
        """Events before a time that isn't beyond that of the last."""
        # Of the type that the times have: for another one numpy would copy them all.
        since_ns = self.since_ns.dtype.type(max(t_ns, self.time_of(0)) - self.start_ns)
        return int(np.searchsorted(self.since_ns, since_ns))


def joined(parts: Sequence[WaitingEvents]) -> EventArray:
    """All events of some parts in their order."""
    if not parts:
        return EventArray.empty()
    t_ns, end = np.empty(sum(map(len, parts)), np.int64), 0
    for part in parts:
        begin, end = end, end + len(part)
        t_ns[begin:end] = part.since_ns
        t_ns[begin:end] += part.start_ns
    return EventArray(
        _joined([part.x for part in parts]), _joined([part.y for part in parts]), t_ns,
        _joined([part.p for part in parts]),
    )  # fmt: skip


def _joined(arrays: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    return np.concatenate(arrays) if len(arrays) > 1 else arrays[0]
