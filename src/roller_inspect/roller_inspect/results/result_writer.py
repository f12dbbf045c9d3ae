"""The output folder of a run, with the /roller topics as a rosbag2 (MCAP)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rclpy.serialization import serialize_message

import roller_braille.messages  # noqa: F401 (registers the messages of cells)
from roller_braille.cells import Cell
from roller_braille.text_files import cells_to_json, to_brf
from roller_braille.translation import LineCell
from roller_core.bag_writer import BagWriter
from roller_core.outputs import DIAGNOSTICS, FINDING_MARKERS, FINDINGS, Output, Result
from roller_core.plain_json import to_text
from roller_emvs.patch import SURFACE_PROPERTIES, Patch
from roller_emvs.ply import PlyWriter
from roller_ros import topics
from roller_ros.messages import to_message


class ResultBag:
    """Writes what stages give as the nodes would publish it.

    Parameters
    ----------
    path : path
        Bag folder to make.

    Raises
    ------
    UnwritableOutputError
        If it can't be written.
    """

    def __init__(self, path: Path) -> None:
        # Depth images are mostly NaN: a tenth of their size when compressed.
        self._writer = BagWriter(
            path,
            {
                topic.path: (topic.type_name, topics.offered(topic))
                for topic in topics.OUTPUTS
                if topic.name != DIAGNOSTICS
            },
            compress=True,
        )
        self._writer.declare_all()

    def write(self, output: Output) -> None:
        """Write one output at its time."""
        if output.topic in (FINDINGS, FINDING_MARKERS):
            # Registers theirs; what inspects loads scipy, so not before there is some.
            import roller_inspect.messages  # noqa: F401
        data = serialize_message(to_message(output))
        self._writer.write(topics.BY_NAME[output.topic].path, int(output.t_ns), data)

    def close(self) -> None:
        """Finish the bag.

        Raises
        ------
        BagFullError
            If the disk doesn't take its end; what was written before is readable.
        """
        self._writer.flush()
        self._writer.close()


class ResultWriter:
    """Writes `result/`, `surface.ply` and the Braille's files as results come.

    Parameters
    ----------
    folder : path
        Output folder; made if needed, an earlier run's files are replaced.
    base_frame : str
        Frame of the surface.

    Raises
    ------
    UnwritableOutputError
        If something can't be written.
    """

    def __init__(self, folder: Path, base_frame: str) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.ply_path = folder / "surface.ply"
        self._ply = PlyWriter(self.ply_path, SURFACE_PROPERTIES, f"frame {base_frame}, metres")
        self._bag = ResultBag(folder / "result")
        self._cells: list[Cell] = []

    @property
    def surface_points(self) -> int:
        """Points written so far."""
        return self._ply.count

    @property
    def cells(self) -> int:
        """Braille cells written so far; one that came again counts once."""
        return len({(cell.line, cell.column) for cell in self._cells})

    def write(self, result: Result) -> None:
        """Write what goes out of a result, points to the cloud and cells to the text."""
        for output in result.outputs:
            self._bag.write(output)
        found = result.found
        if isinstance(found, Patch):
            self._ply.write(found.points, *found.properties())
        elif isinstance(found, Cell):
            self._cells.append(found)

    def close(self, lines: Sequence[Sequence[LineCell]], code: str) -> None:
        """Finish all files; `lines` are the cells read, by line."""
        self._bag.close()
        self._ply.close()
        write_braille(self.folder, self._cells, lines, code)


def write_braille(
    folder: Path, cells: Iterable[Cell], lines: Sequence[Sequence[LineCell]], code: str
) -> None:
    """Write `braille.txt`, `braille.json` and `braille.brf`.

    Parameters
    ----------
    folder : path
        Where they go.
    cells, lines, code
        See `cells_to_json`.
    """
    data = cells_to_json(cells, lines, code)
    (folder / "braille.txt").write_text("".join(f"{line}\n" for line in data["text"]))
    (folder / "braille.json").write_text(to_text(data))
    brf = to_brf([[cell.mask for cell in line] for line in lines])
    (folder / "braille.brf").write_bytes(brf.encode("ascii"))
