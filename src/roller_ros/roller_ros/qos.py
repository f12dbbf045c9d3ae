"""Qualities of service of the graph's topics, in one place."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, reliable: bool, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


#: Event packets, as the existing drivers publish them.
EVENTS = _profile(1000, reliable=False)
#: Values that a late subscriber needs: camera_info, the map.
LATCHED = _profile(1, reliable=True, latched=True)
#: The same from who sends them over and over.
REPEATED = _profile(1, reliable=False)
TF = _profile(100, reliable=True)
#: For who must not miss a pose: four seconds of an e-series robot may wait.
EVERY_TF = _profile(2000, reliable=True)
TF_STATIC = _profile(100, reliable=True, latched=True)
#: For who comes late and must have what every publisher latched: the queue is one for all of them.
EVERY_LATCHED = _profile(2000, reliable=True, latched=True)
#: Pictures for people.
PREVIEW = _profile(5, reliable=False)
DEPTH = _profile(50, reliable=True)
#: Patches of the surface, kept for RViz that starts late.
SURFACE = _profile(50, reliable=True, latched=True)
BRAILLE = _profile(100, reliable=True)
#: Each holds the text so far, or its end: who comes late has it with the last.
TEXT = _profile(100, reliable=True, latched=True)
#: Of each cell; a page of them is kept for RViz that starts late.
MARKERS = _profile(1000, reliable=True, latched=True)
DIAGNOSTICS = _profile(20, reliable=True)
