"""The output folder of a run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from roller_braille.brf import to_brf
from roller_braille.cells import Cell
from roller_braille.cells_json import cells_to_json
from roller_braille.translation import LineCell
from roller_core.outputs import Result
from roller_emvs.patch import SURFACE_PROPERTIES, Patch
from roller_emvs.ply import PlyWriter

from .result_bag import ResultBag


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
        """Braille cells written so far."""
        return len(self._cells)

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
    text = json.dumps(data, indent=1, ensure_ascii=False)
    (folder / "braille.json").write_text(text + "\n")
    brf = to_brf([[cell.mask for cell in line] for line in lines])
    (folder / "braille.brf").write_bytes(brf.encode("ascii"))
