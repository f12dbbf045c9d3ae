"""Votes a second on the public sequence slider_depth, beside the C++ code of EMVS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.pipeline import DepthPipeline
from roller_recording.reading import open_recording

from .cases import depth_settings
from .rows import Row

#: 10^6 events/s of the reference C++ code (-O3) on this sequence by number of threads, on a
#: machine with two cores: 240×180 px, 100 planes, one reference view.
CPP_MEV_S = {1: 2.29, 2: 4.33}
_SETTINGS: dict[str, Any] = {
    "window.rule": "all",
    "depth_min_m": 0.47,
    "depth_max_m": 2.4,
    "paper.planes": 100,
    "packet_events": 1024,
    "paper.threshold_c": 5.0,
    "paper.full_scale_votes": 0.0,
    "paper.median_px": 5,
}


def run_slider(folder: Path, repeats: int) -> list[Row]:
    """Time the votes of the whole sequence with one thread and with two.

    Parameters
    ----------
    folder : path
        The sequence.
    repeats : int
        Runs that count; one more goes before them.

    Returns
    -------
    list of dict
        A row by number of threads: 10^6 events/s voting (poses and rays included, as in the C++
        figures) and to the finished depth map.

    Raises
    ------
    RecordingError
        If the folder can't be read.
    """
    recording = open_recording(folder)
    events = EventArray.concatenate([s.events for s in recording.steps() if len(s.events)])
    rows = []
    for threads, cpp in CPP_MEV_S.items():
        settings = depth_settings("emvs", threads=threads, **_SETTINGS)
        voting, whole, count, points = [], [], 0, 0
        for _ in range(max(repeats, 1) + 1):
            pipeline = DepthPipeline(settings, recording.camera, recording.track)
            pipeline.add_events(events)
            for found in pipeline.results(flush=True):
                if isinstance(found, DepthMap):
                    stages = found.milliseconds
                    voting.append(stages.get("packets", 0.0) + stages["votes"])
                    whole.append(stages["total"])
                    count, points = found.events, found.points
        votes, total = (count * 1e-3 / np.median(ms[1:]) for ms in (voting, whole))
        rows.append(
            {
                "measure": "slider_depth",
                "method": "emvs",
                "threads": threads,
                "events": count,
                "planes": _SETTINGS["paper.planes"],
                "points": points,
                "votes_mev_s": round(float(votes), 3),
                "depth_map_mev_s": round(float(total), 3),
                "cpp_mev_s": cpp,
                "ratio": round(float(votes / cpp), 3),
            }
        )
    return rows
