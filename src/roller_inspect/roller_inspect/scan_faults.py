"""What was wrong with contact, force and data while a part was scanned."""

from __future__ import annotations

import math
from collections import Counter, deque

from roller_core.outputs import EVENTS_ENDED

#: Shorter than this the force may be out of its range, s; samples further apart say nothing.
_LEAST_S, _APART_S = 0.02, 0.1
#: That it was out of its range is said for so long, s: statuses come once a second.
_SAID_S = 1.5
#: So many pieces of slip after the last points aren't of lifting the roller.
_STILL_ON = 2
#: Samples of force, and faults, that wait for the points that follow them.
_MOST_WAITING = 100_000
#: Of a force that is no number.
_UNKNOWN = "the force is not known"


class ScanFaults:
    """Gathers faults of a scan and forces out of range between the points of a part.

    What comes before the first point and after the last is of the way to the part and back. But a
    roller that was lifted doesn't slip: where it is told to after the last points, more often than
    as it leaves, it is still on the part, and no depth comes of that; nor where events ended first.

    Parameters
    ----------
    range_n : tuple of float, optional
        Least and most force, N; without it force isn't watched.
    """

    def __init__(self, range_n: tuple[float, float] | None) -> None:
        self._range_n = range_n
        self._forces: deque[tuple[int, float]] = deque(maxlen=_MOST_WAITING)
        self._late: deque[tuple[int, str]] = deque(maxlen=_MOST_WAITING)
        self._from_ns: int | None = None
        self._to_ns = 0
        self._faults: Counter[str] = Counter()
        self._first: dict[str, str] = {}
        self._before_ns = 0
        #: Seconds of a force that is no number; seconds, and the worst force, of too little and of
        #: too much.
        self._unknown_s = self._light_s = self._hard_s = 0.0
        self._least_n, self._most_n = math.inf, 0.0
        #: Whether a force came between the points.
        self._measured = False
        #: What is, or a moment ago was, wrong with the force; empty: nothing.
        self.now = ""
        self._out_from_ns: int | None = None
        self._out_to_ns = 0

    def take_fault(self, t_ns: int, fault: str) -> None:
        """Take what a depth stage saw: slipping, contact lost, packets missing."""
        self._late.append((t_ns, fault))

    def take_force(self, t_ns: int, force_n: float) -> str:
        """Take the force of a moment; what of it is to be told at once, or nothing."""
        if self._range_n is None:
            return ""
        self._forces.append((t_ns, force_n))
        low, high = self._range_n
        if self._from_ns is None or low <= force_n <= high:
            self._out_from_ns = None
            if t_ns - self._out_to_ns > _SAID_S * 1e9:
                self.now = ""
            return ""
        if self._out_from_ns is None:
            self._out_from_ns = t_ns
        if t_ns - self._out_from_ns < _LEAST_S * 1e9:
            return ""
        before, what = self.now, "pressed too hard" if force_n > high else "pressed too lightly"
        was = f"{what}: {force_n:.1f} N"
        if math.isnan(force_n):
            was = what = _UNKNOWN
        self._out_to_ns = t_ns
        self.now = f"{was}, the recipe asks for {low:g} to {high:g} N"
        return "" if before.startswith(what) else self.now

    def passed(self, t_ns: int) -> None:
        """Points of this time have come: what was before them counts."""
        if self._from_ns is None:
            self._from_ns = t_ns
        self._to_ns = t_ns
        past = [late for late in self._late if late[0] < t_ns]
        for late in past:
            self._late.remove(late)
            # Points that follow show that events went on.
            if late[0] >= self._from_ns and not late[1].startswith(EVENTS_ENDED):
                self._count_fault(late[1])
        while self._forces and self._forces[0][0] < t_ns:
            at_ns, force_n = self._forces.popleft()
            if at_ns >= self._from_ns:
                self._measured = True
                self._count(at_ns, force_n)

    def _count_fault(self, fault: str) -> None:
        kind = _kind(fault)
        self._faults[kind] += 1
        self._first.setdefault(kind, fault)

    def _count(self, t_ns: int, force_n: float) -> None:
        assert self._range_n is not None
        (low, high), passed_s = self._range_n, (t_ns - self._before_ns) * 1e-9
        self._before_ns = t_ns
        passed_s = passed_s if 0.0 < passed_s < _APART_S else 0.0
        if force_n < low:
            self._light_s, self._least_n = self._light_s + passed_s, min(self._least_n, force_n)
        elif force_n > high:
            self._hard_s, self._most_n = self._hard_s + passed_s, max(self._most_n, force_n)
        elif math.isnan(force_n):
            self._unknown_s += passed_s

    def lines(self) -> tuple[str, ...]:
        """One line for each thing that was wrong; empty if nothing was."""
        if self._from_ns is not None:
            self.passed(self._to_ns)  # what was told of it after its last points
            slipping = [late for late in self._late if _kind(late[1]) == "slipping"]
            after = slipping if len(slipping) >= _STILL_ON else []
            after += [late for late in self._late if late[1].startswith(EVENTS_ENDED)]
            if after:
                for late in after:
                    self._late.remove(late)
                    self._count_fault(late[1])
        found = [
            self._first[kind] + (f" (and {n - 1} times more)" if n > 1 else "")
            for kind, n in self._faults.items()
        ]
        if self._range_n is not None:
            asked = "the recipe asks for {:g} to {:g} N".format(*self._range_n)
            if self._from_ns is not None and not self._measured:
                found.append(f"no force came; {asked}")
            if self._hard_s > _LEAST_S:
                worst = f"up to {self._most_n:.1f} N"
                found.append(f"pressed too hard for {self._hard_s:.2f} s, {worst}; {asked}")
            if self._light_s > _LEAST_S:
                worst = f"down to {self._least_n:.1f} N"
                found.append(f"pressed too lightly for {self._light_s:.2f} s, {worst}; {asked}")
            if self._unknown_s > _LEAST_S:
                found.append(f"{_UNKNOWN} for {self._unknown_s:.2f} s; {asked}")
        return tuple(found)


def _kind(fault: str) -> str:
    return fault.partition(":")[0]
