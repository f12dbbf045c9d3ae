"""Streams of events to cut into windows."""

import numpy as np

from roller_core.events import EventArray
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.windows import RefusedWindow, Window, WindowCutter


def ticking(duration_ms: int, start_ns: int = 0, step_us: int = 100) -> EventArray:
    t = start_ns + np.arange(0, duration_ms * 1000, step_us) * 1000
    n = len(t)
    return EventArray.from_arrays(np.zeros(n), np.zeros(n), t, np.zeros(n))


def cut_all(cutter: WindowCutter, flush: bool = True) -> list[Window | RefusedWindow]:
    out = []
    while (window := cutter.cut(flush)) is not None:
        out.append(window)
    return out


def setting(**values: object) -> DepthSettings:
    return DepthSettings.create(values)
