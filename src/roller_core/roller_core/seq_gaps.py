"""Event packets that are missing, by the numbers of those that came."""

from __future__ import annotations

from dataclasses import dataclass

#: A leap over more numbers than this is no loss but another source: minutes of packets.
_MOST_LOST = 2**20
#: Gaps that are kept with their place; beyond it only their number counts.
_PLACES = 1000
#: Places that are told.
_MOST_TOLD = 5
#: More than this share of the event packets may not be missing from a scan that is to be good.
MOST_MISSING = 0.05
#: Packets from which on the share is told at once; of fewer at their end.
_LEAST_PACKETS = 200
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


class SeqGaps:
    """Counts missing packets by their `seq`, which rises by one from packet to packet.

    Attributes
    ----------
    lost : int
        Packets that are missing.
    gaps : int
        Places where some are.
    places : list of Gap
        The first of them.
    restarts : int
        Places where the numbers fall or leap: a source that started anew, or another one.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.gaps = 0
        self.restarts = 0
        self.places: list[Gap] = []
        self._last: dict[str, dict[bytes, int]] = {}

    def see(self, topic: str, seq: int, t_ns: int, sender: bytes = b"") -> None:
        """Take the number of the next packet; each sender counts its own."""
        senders = self._last.setdefault(topic, {})
        last = senders.pop(sender, None)
        self.restarts += last is None and bool(senders)
        if len(senders) >= _MOST_SENDERS:
            del senders[next(iter(senders))]  # silent for longest
        senders[sender] = seq
        if last is None:
            return
        if not last <= seq <= last + _MOST_LOST:
            self.restarts += 1
        elif seq > last + 1:
            self.lost += seq - last - 1
            self.gaps += 1
            if len(self.places) < _PLACES:
                self.places.append(Gap(topic, t_ns, seq - last - 1))

    def skip(self, topic: str, packets: int) -> None:
        """The next numbers came, but were not looked at."""
        for sender in self._last.get(topic, {}):
            self._last[topic][sender] += packets

    def forget(self, topic: str) -> None:
        """Another source follows: its first number says nothing."""
        if self._last.pop(topic, None) is not None:
            self.restarts += 1

    def told(self, start_ns: int) -> str:
        """Where they are missing, for people; seconds count from `start_ns`."""
        shown = [
            f"{gap.packets} before {(gap.t_ns - start_ns) * 1e-9:.3f} s"
            for gap in self.places[:_MOST_TOLD]
        ]
        return ", ".join(shown) + (", …" if self.gaps > _MOST_TOLD else "")


class LossShare:
    """Tells once a scan when too many of its packets are missing."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._came = self._missing = self._last_ns = 0
        self._told = False

    def see(self, t_ns: int, missing: int) -> tuple[int, str] | None:
        """Take a packet's arrival, ns, and how many are missing before it.

        Returns
        -------
        (int, str) or None
            When, ns, and how many; None while there is nothing to tell.
        """
        self._came += 1
        self._missing += missing
        self._last_ns = t_ns if missing else self._last_ns
        return self._tell() if missing and self._came >= _LEAST_PACKETS else None

    def end(self) -> tuple[int, str] | None:
        """The scan is over; see `see`."""
        told = self._tell()
        self._begin()
        return told

    def _tell(self) -> tuple[int, str] | None:
        every = self._came + self._missing
        if self._told or self._missing <= MOST_MISSING * every:
            return None
        self._told = True
        share = f"{self._missing / every:.0%} of the event packets were lost"
        return self._last_ns, f"{share}: {self._missing} of {every}"
