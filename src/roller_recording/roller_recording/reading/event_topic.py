"""Which topic of a bag the events are on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from roller_core.bags import EVENT_ARRAY, EVENT_PACKET
from roller_core.outputs import EVENTS, bag_topic

from .base import MissingTopicError, RecordingError

#: Where the graph of this workspace, and the usual drivers, have them.
USUAL = bag_topic(EVENTS)


def event_topic(topics: Mapping[str, str], path: Path, wanted: str | None = None) -> str:
    """Choose the topic of the event packets.

    It is the one that is wanted; else the usual one; else the only one there is.

    Parameters
    ----------
    topics : mapping
        Type by topic.
    path : path
        Of the bag, for messages.
    wanted : str, optional
        Name of a topic.

    Raises
    ------
    MissingTopicError
        If there is none, or not the one that is wanted.
    RecordingError
        If there are several and none is wanted.
    """
    found = sorted(name for name, kind in topics.items() if kind in (EVENT_PACKET, EVENT_ARRAY))
    if wanted is not None and wanted not in found:
        raise MissingTopicError(
            f"bag {path}: {wanted} is no topic of event packets; "
            f"those are {', '.join(found) or 'none'}"
        )
    if not found:
        raise MissingTopicError(
            f"bag {path}: there is no topic of type {EVENT_PACKET}; it has {listed(topics)}"
        )
    if wanted is None and USUAL not in found and len(found) > 1:
        raise RecordingError(
            f"bag {path}: there are events on {' and '.join(found)}; choose one with --topic "
            "(topic:= for replay.launch.xml)"
        )
    return wanted or (USUAL if USUAL in found else found[0])


def listed(topics: Mapping[str, str]) -> str:
    """The topics of a bag, for a message."""
    return ", ".join(sorted(topics)) or "no topics"
