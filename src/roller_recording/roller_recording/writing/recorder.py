"""Between those who take messages and the bag: a queue, a thread that writes, an account."""

from __future__ import annotations

import threading
import time
import traceback
from collections import Counter
from collections.abc import Collection, Sequence

from roller_core.bag_writer import BagFullError, BagWriter
from roller_core.codecs import CodecError, RawPacket, count_events
from roller_core.errors import RollerError
from roller_recording.raw_message import RawMessage

from .losses import Losses, Progress
from .queue import ByteQueue

_CHECK_S = 0.5
_CHECK_BYTES = 16_000_000
_SYNC_S = 1.0


class Recorder:
    """Writes messages in a thread of its own and counts what is lost.

    Parameters
    ----------
    writer : BagWriter
        The bag; `stop` closes it.
    event_topics : collection of str
        Topics of event packets, whose `seq` is watched and whose events are counted.
    queue_bytes : int
        Most that may wait for the disk.
    """

    def __init__(
        self, writer: BagWriter, event_topics: Collection[str], queue_bytes: int = 512_000_000
    ) -> None:
        self.losses = Losses()
        self.fault: RollerError | None = None
        self.stopped = False
        self._writer = writer
        self.event_topics = frozenset(event_topics)
        self._queue = ByteQueue(queue_bytes)
        self._events = self._unflushed = self._written_ns = 0
        self._events_ns: tuple[int, int] | None = None
        self._give_up = threading.Event()
        self._done = threading.Event()
        # The first use compiles; when packets come it would hold them up.
        for encoding in ("libcaer_cmp", "evt3"):
            count_events(encoding, b"")
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._syncer = threading.Thread(target=self._sync, daemon=True)
        self._thread.start()
        self._syncer.start()

    def take(self, messages: Sequence[RawMessage]) -> None:
        """Take messages in order of arrival; returns at once. For one thread."""
        for message in messages:
            if message.topic in self.event_topics:
                self._see(message)
        refused = self._queue.put(messages)
        for message in refused:
            if self.fault is not None:
                self.losses.leave_out(message.topic, message.t_ns)
            else:
                self.losses.drop(message)

    def progress(self) -> Progress:
        """How it goes; may be called from any thread."""
        counts = self._writer.counts
        return Progress(
            counts,
            sum(counts.get(topic, 0) for topic in self.event_topics),
            self._events,
            self._writer.bytes_written,
            self._queue.waiting_bytes,
            self._queue.waiting,
            self.losses.before.lost,
            self.losses.before.restarts,
            self.losses.foreign_packets,
            self.losses.here,
        )

    @property
    def start_ns(self) -> int:
        """Arrival of the first message that was written, ns; 0 before it."""
        return self._writer.start_ns or 0

    @property
    def duration_s(self) -> float:
        """Time from the first message that was written to the last, s."""
        return max(self._written_ns - self.start_ns, 0) * 1e-9 if self.start_ns else 0.0

    @property
    def events_s(self) -> float:
        """Time from the first event packet to the last, s."""
        first_ns, last_ns = self._events_ns or (0, 0)
        return (last_ns - first_ns) * 1e-9

    def drain(self, timeout_s: float) -> bool:
        """Take no more and wait until all is written; False if that takes longer."""
        self._queue.close()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def stop(self) -> None:
        """Take no more, write the index and close the bag; what still waits is counted as lost.

        A fault, if there is one, is in `fault` afterwards.
        """
        if self.stopped:
            return
        self.stopped = True
        self._queue.close()
        self._give_up.set()
        self._thread.join()
        self._done.set()
        self._syncer.join()
        self._leave_out(self._queue.clear())
        try:
            self._writer.close(self.losses.notes())
        except BagFullError as error:
            self.fault = self.fault or error

    def _see(self, message: RawMessage) -> None:
        try:
            packet = RawPacket.parse(message.data)
        except CodecError:
            return  # it is recorded as it came
        self.losses.before.see(message.topic, packet.seq, message.t_ns, message.sender)

    def _run(self) -> None:
        try:
            self._write_all()
        except Exception as error:
            if not isinstance(error, BagFullError):
                # A fault of ours: a recorder that stands still without a word would be worse.
                traceback.print_exc()
                error = BagFullError(f"{self._writer.path}: recording failed ({error!r})")
            self._end(error)

    def _write_all(self) -> None:
        checked_s, checked_bytes = time.monotonic(), 0
        while not self._queue.finished and not self._give_up.is_set():
            message = self._queue.get(0.1)
            if message is not None:
                self._written_ns = message.t_ns
                self._writer.write(message.topic, message.t_ns, message.data)
                self._count(message)
            self._writer.tick()
            if not self._writer.pending:
                self._unflushed = 0
            now_s, size = time.monotonic(), self._writer.bytes_written
            if now_s - checked_s >= _CHECK_S or size - checked_bytes >= _CHECK_BYTES:
                self._writer.check_space()
                checked_s, checked_bytes = now_s, size
        self._writer.flush()

    def _end(self, error: BagFullError) -> None:
        """Account for what was not written and turn away what comes."""
        self.fault = error
        self._queue.close()
        lost = Counter(error.unwritten)
        try:
            self._writer.flush()
        except BagFullError as again:
            lost.update(again.unwritten)
        if lost:
            self._events -= self._unflushed
        for topic, count in lost.items():
            self.losses.leave_out(topic, self._written_ns, count)
        self._leave_out(self._queue.clear())

    def _leave_out(self, messages: Sequence[RawMessage]) -> None:
        for message in messages:
            self.losses.leave_out(message.topic, message.t_ns)

    def _count(self, message: RawMessage) -> None:
        if message.topic not in self.event_topics:
            return
        first_ns = message.t_ns if self._events_ns is None else self._events_ns[0]
        self._events_ns = (first_ns, message.t_ns)
        try:
            packet = RawPacket.parse(message.data)
        except CodecError:
            return
        count = count_events(packet.encoding, packet.payload)
        self._events += count
        self._unflushed += count

    def _sync(self) -> None:
        """Keep what is only in memory small: a power cut then costs seconds."""
        while not self._done.wait(_SYNC_S):
            try:
                self._writer.sync()
            except OSError:
                return  # the next write reports it
