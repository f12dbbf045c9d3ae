"""A message as it travels: from the graph to a bag, or out of one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class RawMessage:
    """A serialized message and its time; in order of time.

    Attributes
    ----------
    t_ns : int
        When it came, or was logged, ROS time, ns.
    topic : str
        Its topic.
    data : bytes
        The message in CDR.
    type : str
        Its type, where the topic alone doesn't say it.
    sender : bytes
        Who published it, where that is known.
    """

    t_ns: int
    topic: str
    data: bytes
    type: str = ""
    sender: bytes = b""
