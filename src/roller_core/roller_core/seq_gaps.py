"""Event packets that are missing, by the numbers of those that came."""

from __future__ import annotations

from dataclasses import dataclass

#: A leap over more numbers than this is no loss but another source: minutes of packets.
_MOST_LOST = 2**20
#: A number from a gap of no more than this is of a packet that came late.
_SHUFFLED = 8
#: Gaps that are kept with their place; beyond it only their number counts.
_PLACES = 1000
#: Places that are described.
_MOST_SHOWN = 5
#: More than this share of the event packets may not be missing from a scan that is to be good.
MOST_MISSING = 0.05
#: Senders of a topic whose numbers are kept.
_MOST_SENDERS = 100


@dataclass(frozen=True, slots=True)
class Gap:
    """Packets that are missing between two that came."""

    #: Where.
    topic: str
    #: Arrival of the packet after the gap, ns.
    t_ns: int
    #: How many are missing.
    packets: int


@dataclass(slots=True)
class _Numbers:
    """Of a sender: the last number, the last before a leap or a fall, and what the leap counts."""

    last: int
    other: int | None = None
    leap: Gap | None = None
    #: Whether both go on, in turns.
    two: bool = False
    #: The first number of all.
    first: int = -1

    def turn_to(self, seq: int) -> None:
        """Make the one that a number follows the last."""
        if self.other is None or seq in (self.last, self.last + 1):
            return
        nearer = self.two and self.other < seq and not self.other < self.last < seq
        if nearer or seq == self.other + 1:
            self.last, self.other, self.two = self.other, self.last, True


class SeqGaps:
    """Counts missing packets by their `seq`, which rises by one from packet to packet.

    Where a bag doesn't tell two senders apart, a leap is no loss if the numbers before it go on.

    Attributes
    ----------
    lost : int
        Packets that are missing.
    gaps : int
        Places where some are.
    places : list of Gap
        The first of them.
    late : int
        Packets that came after later ones.
    restarts : int
        Places where the numbers fall or leap: a source that started anew, or another one.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.gaps = 0
        self.restarts = self.late = 0
        self.places: list[Gap] = []
        self._last: dict[str, dict[bytes, _Numbers]] = {}

    def see(self, topic: str, seq: int, t_ns: int, sender: bytes = b"") -> None:
        """Take the number of the next packet; each sender counts its own."""
        senders = self._last.setdefault(topic, {})
        numbers = senders.pop(sender, None)
        self.restarts += numbers is None and bool(senders)
        if len(senders) >= _MOST_SENDERS:
            del senders[next(iter(senders))]  # silent for longest
        senders[sender] = numbers = numbers or _Numbers(seq, first=seq)
        if self._fills(numbers, seq):
            return
        numbers.turn_to(seq)
        if numbers.two and numbers.leap is not None:
            self._count(numbers.leap, -1)
            self.restarts += 1
            numbers.leap = None
        last, numbers.last = numbers.last, seq
        gap = Gap(topic, t_ns, seq - last - 1)
        if not last <= seq <= last + _MOST_LOST:
            self.restarts += 1
            numbers.other, numbers.leap, numbers.two = last, None, False
        elif gap.packets > 0:
            self._count(gap)
            if not numbers.two:
                numbers.other, numbers.leap = last, gap

    def _fills(self, numbers: _Numbers, seq: int) -> bool:
        """Whether a packet is one of those that were missing just before."""
        gap, before = numbers.leap, numbers.other
        if seq == numbers.first - 1 and numbers.last == numbers.first:
            self.late += 1  # the first two
            return True
        if gap is None or before is None or gap.packets > _SHUFFLED:
            return False
        if not before < seq < numbers.last:
            return False
        self.late += 1
        self._count(gap, -1)
        numbers.leap = Gap(gap.topic, gap.t_ns, gap.packets - 1) if gap.packets > 1 else None
        if numbers.leap is not None:
            self._count(numbers.leap)
        return True

    def _count(self, gap: Gap, sign: int = 1) -> None:
        self.lost += sign * gap.packets
        self.gaps += sign
        if sign < 0:
            self.places = [place for place in self.places if place is not gap]
        elif len(self.places) < _PLACES:
            self.places.append(gap)

    def skip(self, topic: str, packets: int) -> None:
        """The next numbers came, but were not looked at."""
        for numbers in self._last.get(topic, {}).values():
            numbers.last += packets

    def forget(self, topic: str) -> None:
        """Another source follows: its first number says nothing."""
        if self._last.pop(topic, None) is not None:
            self.restarts += 1

    def describe(self, start_ns: int) -> str:
        """Where they are missing, for people; seconds count from `start_ns`."""
        shown = [
            f"{gap.packets} before {(gap.t_ns - start_ns) * 1e-9:.3f} s"
            for gap in self.places[:_MOST_SHOWN]
        ]
        return ", ".join(shown) + (", …" if self.gaps > _MOST_SHOWN else "")
