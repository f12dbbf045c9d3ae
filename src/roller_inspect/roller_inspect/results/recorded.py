"""Results of a live run from its recording, in the same files as a replay's."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from roller_braille.cells import Cell, certain_dots
from roller_braille.page_order import PageOrder
from roller_braille.reader_settings import BrailleSettings
from roller_braille.translation import ALL_DOTS, LineCell, TextLine
from roller_core import outputs
from roller_core.bags import typestore
from roller_core.errors import RollerError
from roller_core.outputs import stamp_ns
from roller_core.window_account import WindowAccount, account_of
from roller_emvs.depth_map import DepthMap
from roller_emvs.methods.surface import SurfacePatch
from roller_emvs.patch import SURFACE_PROPERTIES
from roller_emvs.ply import PlyWriter
from roller_recording.raw_message import RawMessage
from roller_recording.reading.bag_reader import BagReader

from .result_writer import write_braille
from .run_report import Report
from .truth_tally import SurfaceTally, TruthTally

#: What is found from events, as soon as it is.
_FOUND = frozenset({outputs.DEPTH_IMAGE, outputs.SURFACE_POINTS, outputs.BRAILLE_CELLS})
#: What each window came to, by method.
_ACCOUNTS = {True: outputs.SURFACE_ACCOUNT, False: outputs.DEPTH_ACCOUNT}


class RecordedResultsError(RollerError):
    """A recording without what a live run should have published."""


@dataclass
class _Recorded:
    """What a graph published."""

    #: Points of each depth map or cloud, by stamp.
    given: dict[int, int] = field(default_factory=dict)
    #: What windows came to, with their stamps.
    accounts: list[tuple[int, WindowAccount]] = field(default_factory=list)
    #: Points of the surface.
    points: int = 0
    #: The Braille: its cells, in order, and its text.
    cells: list[Cell] = field(default_factory=list)
    text: str = ""
    #: When the last events and the last result were logged, ns; 0: none were.
    last_events_ns: int = 0
    last_found_ns: int = 0


def gather(
    bag: Path, output: Path, truth_folder: Path | None, report: Report, cell: str = ""
) -> None:
    """Write surface, text and report from a recorded graph.

    Parameters
    ----------
    bag : path
        rosbag2 with the /roller topics.
    output : path
        Folder for `surface.ply`, the Braille's files and `report.json`.
    truth_folder : path, optional
        Where the scan's truth lies.
    report : Report
        Completed with windows, truth and totals (`lag_s` too), and written; its method says
        whether the windows are depth maps or, with `surface`, clouds.
    cell : str
        Namespace of the cell, with a slash before it; empty: none.

    Raises
    ------
    RecordedResultsError
        If the bag holds no depth map, or with `surface` no points.
    """
    surface = report.method == "surface"
    kind = SurfaceTally if surface else TruthTally
    tally: Any = kind.beside(truth_folder) if truth_folder else None
    with PlyWriter(output / "surface.ply", SURFACE_PROPERTIES, "frame base, metres") as ply:
        found = _read(BagReader(bag), surface, tally, ply, cell)
    if not found.given:
        missing = "no points of the surface" if surface else "no depth map"
        raise RecordedResultsError(f"bag {bag}: the graph published {missing}")
    for stamp, account in found.accounts:
        report.add_window(stamp, account)
    for stamp in found.given.keys() - {stamp for stamp, _ in found.accounts}:
        # Recorded when nodes gave no account, or it was lost.
        report.add_bare_window(stamp, found.given[stamp])
    report.windows.sort(key=itemgetter("stamp_ns"))
    write_braille(output, found.cells, _lines(found.cells), "grade1")
    report.totals |= {
        "depth_windows": len(found.given),
        "surface_points": found.points,
        "braille_cells": len({(cell.line, cell.column) for cell in found.cells}),
        "braille_text": [line for line in found.text.split("\n") if line],
    }
    if found.last_events_ns:
        # From the last events to the last result, as they reached the recorder.
        lag_ns = max(found.last_found_ns - found.last_events_ns, 0)
        report.totals["lag_s"] = round(lag_ns * 1e-9, 3)
    if tally is not None:
        report.truth = tally.summary()
    report.write(output / "report.json")


def _read(reader: BagReader, surface: bool, tally: Any, ply: PlyWriter, cell: str) -> _Recorded:
    """Read a bag; the tally, if there is one, and the file take what they need as it comes."""
    out, store = _Recorded(), typestore()
    beside: dict[str, dict[int, npt.NDArray[np.float32]]] = {
        outputs.DEPTH_CONFIDENCE: {}, outputs.DEPTH_SIGMA: {},
    }  # fmt: skip
    for item in reader.messages(set(reader.topics)):
        if not isinstance(item, RawMessage):
            continue  # what a cut or damage took
        topic, logged_ns = item.topic.removeprefix(cell).removeprefix("/"), item.t_ns
        if topic == outputs.EVENTS:
            out.last_events_ns = logged_ns
        elif topic in _FOUND:
            out.last_found_ns = logged_ns
        if not topic.startswith("roller/"):
            continue
        message: Any = store.deserialize_cdr(item.data, item.type)
        if topic in beside:
            beside[topic][stamp_ns(message)] = _pixels(message)
        elif topic == outputs.DEPTH_IMAGE and not surface:
            stamp = stamp_ns(message)
            depth = _pixels(message)
            sure, sigma = (kept.pop(stamp, depth) for kept in beside.values())
            found = DepthMap(stamp, depth, sure, sigma, np.eye(4), stamp, stamp, 0)
            out.given[stamp] = found.points
            if tally is not None:
                tally.add(found)
        elif topic == _ACCOUNTS[surface]:
            out.accounts.append((stamp_ns(message), account_of(message)))
        elif topic == outputs.SURFACE_POINTS:
            patch = _patch(message)
            ply.write(patch.points, *patch.properties())
            out.points += len(patch)
            if surface:
                out.given[patch.stamp_ns] = len(patch)
                if tally is not None:
                    tally.add(patch)
        elif topic == outputs.BRAILLE_TEXT:
            out.text = message.data
        elif topic == outputs.BRAILLE_CELLS:
            out.cells.append(_cell(message))
    return out


def _pixels(message: Any) -> npt.NDArray[np.float32]:
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width)


def _patch(message: Any) -> SurfacePatch:
    """Points of one cloud; its stamp is all that it says of their time."""
    rows, stamp = np.frombuffer(message.data, np.float32).reshape(-1, 6), stamp_ns(message)
    height, sure, sigma = rows[:, 3:].T
    return SurfacePatch(rows[:, :3].astype(np.float64), height, sure, sigma, stamp, stamp)


def _cell(message: Any) -> Cell:
    def point(p: Any) -> list[float]:
        return [p.x, p.y, p.z]

    return Cell(
        stamp_ns(message),
        int(message.line),
        int(message.column),
        int(message.mask),
        message.character,
        bool(message.readable),
        np.array(point(message.position)),
        float(message.confidence),
        tuple(float(c) for c in message.dot_confidence),
        np.full((6, 3), np.nan),
    )


def _lines(cells: list[Cell]) -> list[TextLine]:
    """Cells by line and column, blank where none was given; lines as they lie on the page."""
    lines: dict[int, dict[int, Cell]] = {}
    for cell in cells:  # of one that came again the last counts
        lines.setdefault(cell.line, {})[cell.column] = cell
    spacing, right = BrailleSettings.create({}).spacing, np.array([1.0, 0.0, 0.0])
    order, numbers = PageOrder(spacing), list(lines)
    for k, line in enumerate(lines.values()):
        first, last = line[min(line)], line[max(line)]
        if first is not last:  # one cell alone doesn't say which way its line runs
            way = last.position - first.position
            right = way / np.linalg.norm(way)
        down = np.cross(right, [0.0, 0.0, 1.0])
        for cell in line.values():
            places = [(i // 3 - 0.5) * right + (i % 3 - 1.0) * down for i in range(6)]
            order.take(k, cell.position + spacing.dot_pitch_m * np.array(places))
    return [TextLine(_whole(lines[numbers[k]]), numbers[k]) for k in order.lines]


def _whole(line: dict[int, Cell]) -> list[LineCell]:
    out = [LineCell(0)] * (max(line) + 1)
    for column, cell in line.items():
        certain = ALL_DOTS if cell.readable else certain_dots(cell.dot_confidence)
        out[column] = LineCell(cell.mask, certain)
    return out
