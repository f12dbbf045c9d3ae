"""Results of a recording: those that it holds, else those of a replay of it."""

from __future__ import annotations

import sys
from pathlib import Path

from roller_core.errors import RollerError
from roller_core.outputs import DEPTH_IMAGE, SURFACE_POINTS, bag_topic
from roller_core.progress import progress_bar
from roller_inspect.pipeline import PipelineSettings
from roller_inspect.replay import replay
from roller_inspect.results.recorded import gather
from roller_inspect.results.run_report import Report
from roller_recording.reading import open_recording
from roller_recording.reading.bag_reader import BagReader

_DEPTH, _POINTS = bag_topic(DEPTH_IMAGE), bag_topic(SURFACE_POINTS)
#: Options that `roller replay` has and `roller view` hasn't.
_OPTIONS_OF_REPLAY = ("--poses", "--camera", "--topic")


def results_of(source: Path, folder: Path) -> Path:
    """Write a recording's results into a folder, and give the folder.

    Raises
    ------
    RollerError
        If the recording can't be read.
    """
    topics = _topics(source) if source.is_dir() else set()
    cells = sorted(name.removesuffix(_POINTS) for name in topics if name.endswith(_POINTS))
    if len(cells) > 1:
        raise RollerError(
            f"{source}: it holds results of {len(cells)} cells ({', '.join(cells)}); record each "
            "into a bag of its own"
        )
    for cell in cells:
        method = "focus" if cell + _DEPTH in topics else "surface"
        report = Report(str(source), method, {}, source.name)
        gather(source, folder, None, report, cell)
        return folder
    settings = PipelineSettings.load()
    try:
        recording = open_recording(source, max_gap_s=settings.max_pose_gap_s)
    except RollerError as error:
        if not any(option in str(error) for option in _OPTIONS_OF_REPLAY):
            raise
        raise RollerError(
            f"{error}; `roller replay` takes that: view the folder that it writes"
        ) from error
    print(f"{source} holds no results yet: replaying it", file=sys.stderr)
    with progress_bar(f"replay {source.name}") as progress:
        replay(recording, settings, folder, source, progress=progress)
    return folder


def _topics(source: Path) -> set[str]:
    """Topics of a bag that hold messages; none where it is another kind of recording."""
    try:
        return {name for name, count in BagReader(source).counts.items() if count}
    except RollerError:
        return set()
