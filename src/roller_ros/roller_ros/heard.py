"""Whether those who listen have heard.

A publisher knows a subscriber before the subscriber knows the publisher: what is sent in between
is lost where it isn't kept, and a scan that begins then begins without its first poses.
"""

from __future__ import annotations

import threading
import time

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy

_POLL_S = 0.01


def wait_until_heard(publisher: Publisher, timeout_s: float, stop: threading.Event) -> bool:
    """Wait until all subscribers that are known have acknowledged what was published.

    Parameters
    ----------
    publisher : Publisher
        One of best effort isn't waited for: nobody acknowledges it.
    timeout_s : float
        How long to wait at most.
    stop : Event
        Ends the wait.

    Returns
    -------
    bool
        Whether they have.
    """
    if publisher.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
        return True
    end = time.monotonic() + timeout_s
    # In short looks: the call itself lets no other thread of Python run while it waits.
    while not publisher.wait_for_all_acked(Duration()):
        if time.monotonic() > end or stop.wait(_POLL_S):
            return False
    return True
