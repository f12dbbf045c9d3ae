"""The soak's account of what was sent and taken."""

from soak.ledger import Flow, Ledger, Status, Statuses

BUSY = Flow(
    "/events", "camera", "sent", "emvs", "packets", {"lost": 1.0}, (), queued="waiting_packets"
)
FLOW = Flow("/events", "camera", "sent", "emvs", "packets", {"lost": 1.0}, ("waiting",))


class Night:
    """A scan a second, at the end of which both nodes say twice how far they are."""

    def __init__(self, flow: Flow = FLOW) -> None:
        self.statuses, self.ledger, self.now_s = Statuses(), Ledger((flow,)), 0.0

    def scan(
        self, sent: int, packets: int, lost: int = 0, consumer: bytes | None = b"1", queued: int = 0
    ) -> None:
        """One more, with the counts at its end; no consumer: its process is gone.

        A consumer that is behind takes five more of what waits until its next status.
        """
        self.now_s += 1.0
        for late_s in (0.1, 0.2):
            at_s = self.now_s + late_s
            self.statuses.take("camera", Status(b"c", at_s, {"sent": str(sent)}))
            if consumer is not None:
                values = {"packets": str(packets), "lost": str(lost), "waiting": "0"}
                values["waiting_packets"] = str(queued)
                self.statuses.take("emvs", Status(consumer, at_s, values))
                packets, queued = packets + min(queued, 5), queued - min(queued, 5)
        self.ledger.look(self.statuses, self.now_s)

    @property
    def totals(self) -> tuple[int, int, int, int]:
        """Sent, counted, not counted, open."""
        each = [(a.sent, a.counted, a.uncounted, a.open) for a in self.ledger.accounts]
        sent, counted, uncounted, left = (sum(column) for column in zip(*each, strict=True))
        return sent, counted, uncounted, left


def test_the_last_status_of_a_process_that_was_killed_is_not_its_successors() -> None:
    night = Night()
    night.scan(sent=6000, packets=6000)
    night.scan(sent=6400, packets=6400)  # killed after its status; looked at with the next alive
    night.scan(sent=6800, packets=380, consumer=b"2")
    night.scan(sent=7200, packets=780, consumer=b"2")
    assert night.totals == (800, 0, 0, 0)


def test_what_was_lost_last_is_open_until_the_next_message_shows_it() -> None:
    night = Night()
    night.scan(sent=100, packets=100)
    night.scan(sent=200, packets=190)
    assert night.totals == (100, 0, 0, 10)
    night.scan(sent=300, packets=290, lost=10)
    assert night.totals == (200, 10, 0, 0)


def test_what_nobody_counts_is_found() -> None:
    night = Night()
    for scan in range(3):
        night.scan(sent=100 * scan, packets=100 * scan - 10 * (scan > 0))
    assert night.totals == (200, 0, 10, 0)


def test_what_is_still_under_way_is_not_looked_at() -> None:
    night = Night()
    night.scan(sent=100, packets=100)
    night.now_s += 1.0
    for at, packets in ((0.1, 120), (0.2, 180)):  # it still takes
        night.statuses.take("camera", Status(b"c", night.now_s + at, {"sent": "200"}))
        values = {"packets": str(packets), "lost": "0", "waiting": "0"}
        night.statuses.take("emvs", Status(b"1", night.now_s + at, values))
    night.ledger.look(night.statuses, night.now_s)
    assert night.totals == (0, 0, 0, 0)


def test_a_queue_that_is_never_empty_is_accounted_for() -> None:
    night = Night(BUSY)
    night.scan(sent=100, packets=60, queued=40)
    night.scan(sent=200, packets=120, queued=80)
    assert night.totals == (100, 0, 0, 0)
    night.scan(sent=300, packets=180, queued=110)  # 10 don't arrive; the gap waits behind 80 others
    night.scan(sent=400, packets=240, queued=150)
    assert night.totals == (300, 0, 0, 10)
    night.scan(sent=500, packets=340, lost=10, queued=150)
    assert night.totals == (400, 10, 0, 0)


def test_what_nobody_counts_is_found_behind_a_queue() -> None:
    night = Night(BUSY)
    night.scan(sent=100, packets=60, queued=40)
    night.scan(sent=200, packets=120, queued=70)  # 10 don't arrive
    night.scan(sent=300, packets=180, queued=110)
    assert night.totals == (200, 0, 0, 10)
    night.scan(sent=400, packets=300, queued=90)
    assert night.totals == (300, 0, 10, 0)
