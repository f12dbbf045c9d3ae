"""What it costs to decode a stream of packets."""

from __future__ import annotations

import time

import numpy as np

from roller_core.codecs import encode
from roller_core.event_stream import EventStream

from .scans import Scan

_ENCODING = "libcaer_cmp"
#: Length of a packet, and how often all are decoded.
_PACKET_NS, _RUNS = 1_000_000, 3


def decoding_cpu_ns(scan: Scan) -> float:
    """Processor time of `EventStream` for an event of a scan, ns; the median of some runs."""
    events, camera = scan.even, scan.camera
    times = np.arange(events.t_ns[0], events.t_ns[-1] + _PACKET_NS, _PACKET_NS)
    ends = np.searchsorted(events.t_ns, times)
    packets = [
        (int(t), encode(_ENCODING, events[a:b], int(t)))
        for t, a, b in zip(times[:-1], ends[:-1], ends[1:], strict=True)
    ]
    spent = []
    for _ in range(_RUNS):
        stream = EventStream(camera.width, camera.height)
        begin = time.process_time()
        for seq, (t, payload) in enumerate(packets):
            stream.push(_ENCODING, camera.width, camera.height, seq, t, t, payload)
        spent.append((time.process_time() - begin) * 1e9 / max(stream.counts.events, 1))
    return round(float(np.median(spent)), 1)
