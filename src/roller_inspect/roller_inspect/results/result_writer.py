"""The output folder of a run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from roller_braille.brf import to_brf
from roller_braille.cells import Cell
from roller_braille.cells_json import cells_to_json
from roller_braille.reader_settings import Spacing
from roller_braille.translation import LineCell
from roller_core.camera import Camera
from roller_core.output_folder import make_folder
from roller_emvs.methods.surface import SurfacePatch
from roller_emvs.patch import Patch
from roller_emvs.ply import PlyWriter
from roller_inspect.pipeline import DepthResult

from .result_bag import ResultBag


class ResultWriter:
    """Writes `result/`, `surface.ply` and the Braille's files as results come.

    Parameters
    ----------
    folder : path
        Output folder; made if needed, an earlier run's files are replaced.
    camera : Camera
        Of the depth maps.
    sensor_frame, base_frame : str
        Frames of depth images and of the surface.
    spacing : Spacing
        Sizes of Braille, for the markers.

    Raises
    ------
    UnwritableOutputError
        If something can't be written.
    """

    def __init__(
        self, folder: Path, camera: Camera, sensor_frame: str, base_frame: str, spacing: Spacing
    ) -> None:
        self.folder = folder
        make_folder(folder)
        self.ply_path = folder / "surface.ply"
        self._ply = PlyWriter(
            self.ply_path, ("height", "confidence"), f"frame {base_frame}, metres"
        )
        self._bag = ResultBag(folder / "result", camera, sensor_frame, base_frame, spacing)
        self._cells: list[Cell] = []
        self._last_ns = 0

    @property
    def surface_points(self) -> int:
        """Points written so far."""
        return self._ply.count

    def write_mapped(self, found: DepthResult) -> None:
        """A depth map and the surface points that it completed."""
        self._last_ns = found.depth_map.stamp_ns
        self._bag.write_depth(found.depth_map)
        self.write_patch(found.patch)

    def write_rows(self, rows: SurfacePatch) -> None:
        """Rows of the surface that came without a depth map."""
        self._last_ns = rows.stamp_ns
        self.write_patch(rows)

    def write_patch(self, patch: Patch) -> None:
        """Surface points."""
        self._bag.write_patch(patch, self._last_ns)
        self._ply.write(patch.points, patch.height, patch.confidence)

    def write_cell(self, cell: Cell, lines: list[str]) -> None:
        """A Braille cell and the text so far."""
        self._cells.append(cell)
        self._bag.write_cell(cell, lines)

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
