"""What was sent on a topic, held against what each process took and what it says it missed.

A look is taken in a quiet stretch, when nothing is under way any more. A status is known by who
sent it, not by its node's name: the last one of a process that was killed is not its successor's.
"""

from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Status:
    """A node's status: who sent it, when it came (s), what it said."""

    sender: bytes
    at_s: float
    values: Mapping[str, str]
    message: str = ""


class Statuses:
    """The newest statuses of each node."""

    def __init__(self) -> None:
        self._newest: dict[str, deque[Status]] = defaultdict(lambda: deque(maxlen=2))

    def take(self, node: str, status: Status) -> None:
        """Keep a status."""
        self._newest[node].append(status)

    def newest(self, node: str) -> Status | None:
        """The last one; None before the first."""
        return self._newest[node][-1] if self._newest[node] else None

    def figure(self, node: str, key: str, since_s: float = 0.0) -> float | None:
        """A figure of a node's newest status; None if there is none that is newer."""
        status = self.newest(node)
        text = "" if status is None or status.at_s <= since_s else status.values.get(key, "")
        return float(text) if text else None

    def settled(
        self, node: str, keys: tuple[str, ...], since_s: float, summed: tuple[str, ...] = ()
    ) -> Status | None:
        """The newest status if it and the one before came since then, of one sender and alike.

        Alike are the values of `keys`, and the sum of those of `summed`.
        """
        pair = self._newest[node]
        if len(pair) < 2 or pair[0].at_s <= since_s or pair[0].sender != pair[1].sender:
            return None
        if any(key not in s.values for s in pair for key in (*keys, *summed)):
            return None
        alike = all(pair[0].values[key] == pair[1].values[key] for key in keys)
        sums = {sum(float(s.values[key]) for key in summed) for s in pair}
        return pair[1] if alike and len(sums) == 1 else None


@dataclass(frozen=True, eq=False)
class Flow:
    """A topic from one node to another, and the keys of their statuses that count its messages."""

    topic: str
    source: str
    sent: str
    consumer: str
    taken: str
    #: With what one of each counts for.
    missed: Mapping[str, float]
    #: Those that are 0 when nothing is under way, and those that are there when it can take any.
    waiting: tuple[str, ...]
    ready: tuple[str, ...] = ()
    #: How many of them wait to be taken, where the consumer says so: it may never be done.
    queued: str = ""


@dataclass
class Account:
    """What one process took and missed of what another sent, since the first look.

    Attributes
    ----------
    sent, counted : int
        Messages sent, and those that the consumer says it missed.
    uncounted : int
        Neither taken nor counted, at a look and at one before which all that waited then has been
        taken: what was lost last is noticed with the next message.
    open : int
        Neither, at the last look alone.
    """

    flow: Flow
    begin: tuple[float, float, float]
    sent: int = 0
    counted: int = 0
    uncounted: int = 0
    open: int = 0
    _looks: list[tuple[float, float, int]] = field(default_factory=list)

    def look(self, sent: float, taken: float, missed: float, queued: float = 0.0) -> None:
        """Take the counts of a quiet moment."""
        self.sent = int(sent - self.begin[0])
        self.counted = int(missed - self.begin[2])
        short = max(0, self.sent - int(taken + queued - self.begin[1]) - self.counted)
        passed = [look for look in self._looks if not queued or taken - look[0] > look[1]]
        self.uncounted = min(passed[-1][2], short) if passed else 0
        self.open = short - self.uncounted
        self._looks = [look for look in self._looks if look not in passed[:-1]]
        self._looks.append((taken, queued, short))

    def __str__(self) -> str:
        return (
            f"{self.flow.topic} to {self.flow.consumer}: {self.sent} sent, {self.counted} missed "
            f"and counted, {self.uncounted} not counted, {self.open} open"
        )


class Ledger:
    """The accounts of all flows, each between two processes as long as both live."""

    def __init__(self, flows: tuple[Flow, ...]) -> None:
        self._flows = flows
        self._running: dict[Flow, tuple[tuple[bytes, bytes], Account]] = {}
        self._closed: list[Account] = []

    @property
    def accounts(self) -> list[Account]:
        """All, those that are closed too."""
        return [*self._closed, *(account for _, account in self._running.values())]

    def look(self, statuses: Statuses, since_s: float) -> None:
        """Hold what was taken against what was sent; all has been quiet since then."""
        for flow in self._flows:
            summed = (flow.taken, flow.queued) if flow.queued else ()
            ours = flow.waiting if flow.queued else (flow.taken, *flow.missed, *flow.waiting)
            sent = statuses.settled(flow.source, (flow.sent,), since_s)
            got = statuses.settled(flow.consumer, ours, since_s, summed)
            if sent is None or got is None or not set(flow.ready) <= set(got.values):
                continue
            if any(float(got.values[k]) for k in flow.waiting):
                continue
            pair = sent.sender, got.sender
            counts = (
                float(sent.values[flow.sent]),
                float(got.values[flow.taken]),
                sum(each * float(got.values[key]) for key, each in flow.missed.items()),
            )
            queued = float(got.values[flow.queued]) if flow.queued else 0.0
            if flow in self._running and self._running[flow][0] != pair:
                self._closed.append(self._running.pop(flow)[1])
            begin = (counts[0], counts[1] + queued, counts[2])
            account = self._running.setdefault(flow, (pair, Account(flow, begin)))[1]
            account.look(*counts, queued)

    def close(self, *consumers: str) -> None:
        """End the running accounts of some consumers; the next look begins new ones."""
        for flow in [f for f in self._running if f.consumer in consumers]:
            self._closed.append(self._running.pop(flow)[1])
