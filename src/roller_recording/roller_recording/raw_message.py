"""A message as it travels: from the graph to a bag, or out of one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class RawMessage:
    """A serialized message and its time; in order of time."""

    #: When it came, or was logged, ROS time, ns.
    t_ns: int
    #: Its topic.
    topic: str
    #: The message in CDR.
    data: bytes
    #: Its type, where the topic alone doesn't say it.
    type: str = ""
    #: Who published it, where that is known.
    sender: bytes = b""
