"""A message on its way from the graph to the bag."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Taken:
    """A serialized message and when it came; in order of time.

    Attributes
    ----------
    t_ns : int
        Arrival, ROS time, ns.
    topic : str
        Its topic.
    data : bytes
        The message in CDR.
    """

    t_ns: int
    topic: str
    data: bytes
