"""What a test has to itself beside other tests and other checkouts on the same machine."""

import os
import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager

_PID = os.getpid()
#: Loopback address of this process, for servers whose port can't be chosen.
LOOPBACK = f"127.{1 + (_PID >> 16)}.{_PID >> 8 & 255}.{1 + (_PID & 255) % 254}"


@contextmanager
def ros_domain() -> Iterator[int]:
    """Hold a ROS domain that nobody else holds.

    Domain d has the ports from 7400 + 250 d on. The last of them, which no node reaches, is kept
    busy as a sign.
    """
    # Not the lowest: what an earlier test left behind may still be in that. Hypothesis seeds
    # `random` itself.
    for domain in random.SystemRandom().sample(range(1, 101), 100):
        with socket.socket() as sign:
            try:
                sign.bind(("127.0.0.1", 7400 + 250 * domain + 249))
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError("all ROS domains are in use")
