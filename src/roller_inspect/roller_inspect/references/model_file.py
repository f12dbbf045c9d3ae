"""Reading a model of a part: a mesh, or STEP."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from roller_core.transforms import F64

from .reference import ReferenceError

#: STEP to GLB: metres whatever the file's unit, chords 2 µm off its curves at most. In a process of
#: its own, for the library writes to the terminal, and a damaged file can end it.
_STEP_TO_GLB = "import sys, cascadio as c; c.step_to_glb(*sys.argv[1:], tol_linear=0.002)"
#: Bytes before a binary STL's triangles, the last four of which say how many there are, and of
#: each; more are not believed.
_STL_HEAD, _STL_TRIANGLE, _MOST_TRIANGLES = 84, 50, 100_000_000
#: Bytes of a PLY's head at most, and of the end of a text that are looked at.
_PLY_HEAD, _END = 4096, 4096
#: No part is longer, m; one of some centimetres in millimetres is.
_LONGEST_M = 10.0
#: More of an OBJ's corners than this share, and number, without a triangle are of triangles that
#: are missing.
_UNUSED, _SPARE = 0.01, 8


def read_model(path: Path) -> tuple[F64, np.ndarray]:
    """Vertices, metres, shape (n, 3), and triangles, shape (m, 3), of a file.

    Raises
    ------
    ReferenceError
        If it can't be read, breaks off, is longer than any part, or is STEP and cascadio isn't
        installed.
    """
    if not path.is_file():
        raise ReferenceError(f"reference cad: {path}: no such file")
    if path.suffix.lower() in (".step", ".stp"):
        vertices, triangles = _read_step(path)
    else:
        vertices, triangles = _read_mesh(path)
        if why := _broken_off(path, len(vertices), len(triangles)):
            raise ReferenceError(f"reference cad: {path}: {why}; export it anew")
    if not len(triangles):
        raise ReferenceError(
            f"reference cad: {path}: no triangles in it; is it an STL or STEP file?"
        )
    if not np.isfinite(vertices).all():
        raise ReferenceError(
            f"reference cad: {path}: a corner of a triangle isn't a number; export it anew"
        )
    size_m = float(np.ptp(vertices, axis=0).max())
    if size_m > _LONGEST_M:
        raise ReferenceError(
            f"reference cad: {path}: the model is {size_m:.3g} m long; is it in millimetres? "
            "Models are in metres: scale it by 0.001"
        )
    return vertices, triangles


def _read_mesh(path: Path) -> tuple[F64, np.ndarray]:
    """Vertices and triangles of a file; none if it isn't one."""
    import open3d  # late: it takes a second to load and only CAD needs it

    o3d: Any = open3d  # its stubs leave out NumPy arrays
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(str(path))
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def _broken_off(path: Path, vertices: int, triangles: int) -> str:
    """Why a file isn't whole, as far as that shows; empty: it is.

    Parameters
    ----------
    path : path
        The file.
    vertices, triangles : int
        How many were read.
    """
    kind, size = path.suffix.lower(), path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_PLY_HEAD)
        file.seek(max(size - _END, 0))
        end = file.read()
    if kind == ".ply":
        announced = re.findall(rb"element (vertex|face) (\d+)", head.partition(b"end_header")[0])
        read = {b"vertex": vertices, b"face": triangles}
        for name, count in announced:
            if read[name] < int(count):
                return f"{read[name]} of {int(count)} {name.decode()} entries can be read"
    elif kind == ".obj":
        return _what_of_obj(path, triangles)
    elif kind == ".stl":
        count = int.from_bytes(head[_STL_HEAD - 4 : _STL_HEAD], "little")
        there, rest = divmod(size - _STL_HEAD, _STL_TRIANGLE)
        if not head.lstrip().lower().startswith(b"solid") or (there == count and not rest):
            if len(head) >= _STL_HEAD and there < count < _MOST_TRIANGLES:
                return f"it breaks off after {there} of {count} triangles"
        elif triangles and b"endsolid" not in end.lower():
            return "it has no endsolid"
    return ""


def _what_of_obj(path: Path, triangles: int) -> str:
    """The same of an OBJ, by its lines: corners come before the faces that they are of."""
    corners = last = wide = 0
    words: list[bytes] = []
    with path.open("rb") as file:
        for line in file:
            words = line.partition(b"#")[0].split() or words
            if words[:1] == [b"v"]:
                corners += 1
            elif words[:1] == [b"f"]:
                wide += len(words) > 4
                numbers = [word.split(b"/")[0] for word in words[1:]]
                counted = all(number.isdigit() for number in numbers)
                last = max([last, *map(int, numbers)]) if counted else corners
    if wide:
        return f"{wide} faces have more than three corners, of which none would be seen"
    if triangles and words[0] in (b"v", b"f") and len(words) < 4:
        return "its last line breaks off"
    if triangles and last < corners - max(_UNUSED * corners, _SPARE):
        return f"{corners - last} of {corners} corners belong to no triangle"
    return ""


def _read_step(path: Path) -> tuple[F64, np.ndarray]:
    """The same of a STEP file, metres."""
    if find_spec("cascadio") is None:
        raise ReferenceError(
            f"reference cad: {path}: STEP needs cascadio ({sys.executable} -m pip install "
            "cascadio); or export an STL in metres"
        )
    with TemporaryDirectory(prefix="roller_step_") as folder:
        mesh = Path(folder) / "part.glb"
        command = [sys.executable, "-c", _STEP_TO_GLB, str(path.resolve()), str(mesh)]
        subprocess.run(command, capture_output=True)
        if not mesh.is_file():
            raise ReferenceError(f"reference cad: {path}: can't be read; is it a STEP file?")
        return _read_mesh(mesh)
