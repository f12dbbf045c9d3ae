"""Files of models: STL, PLY, OBJ and STEP, whole, broken off and as others write them."""

from pathlib import Path

import numpy as np
import pytest

from roller_core.transforms import F64
from roller_inspect.references import CadReference, ReferenceError

from .analytic_surface import flat
from .boss_part import mesh_of
from .box_step import box_step


def test_a_model_file_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text("not a mesh")
    with pytest.raises(ReferenceError, match="no triangles"):
        CadReference.load(tmp_path / "part.stl")


def test_what_is_wrong_with_a_model_file_is_said(tmp_path: Path) -> None:
    vertices, triangles = mesh_of(flat, (0.0, 0.0, 0.0))
    corners = np.zeros((12, 4, 3), "<f4")
    corners[:, 1:] = vertices[triangles[:12]]
    rows = b"".join(own.tobytes() + b"\0\0" for own in corners)
    file, head = tmp_path / "part.stl", b"\0" * 80 + (12).to_bytes(4, "little")
    file.write_bytes(head + rows)
    assert len(CadReference.load(file).triangles) == 12
    file.write_bytes(head + rows[: 4 * 50 + 20])
    with pytest.raises(ReferenceError, match="breaks off after 4 of 12 triangles"):
        CadReference.load(file)
    corners[3, 2, 1] = np.nan
    file.write_bytes(head + b"".join(own.tobytes() + b"\0\0" for own in corners))
    with pytest.raises(ReferenceError, match="isn't a number"):
        CadReference.load(file)


def ascii_files(vertices: F64, triangles: np.ndarray) -> dict[str, str]:
    """A mesh as text, by what follows the name."""
    corners = [f"{x:.6e} {y:.6e} {z:.6e}" for x, y, z in vertices]
    faces = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {corners[k]}\n" for k in row)
        + "endloop\nendfacet\n"
        for row in triangles
    ]
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(triangles)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    return {
        ".stl": "solid part\n" + "".join(faces) + "endsolid part\n",
        ".ply": head + "\n".join([*corners, *("3 {} {} {}".format(*row) for row in triangles), ""]),
        ".obj": "".join(f"v {corner}\n" for corner in corners)
        + "".join("f {} {} {}\n".format(*(row + 1)) for row in triangles),
    }


@pytest.mark.parametrize("kind", [".stl", ".ply", ".obj"])
def test_a_model_file_that_breaks_off_is_no_model(kind: str, tmp_path: Path) -> None:
    """At any place behind its first triangles, also at the end of a line."""
    x, y = np.meshgrid(np.arange(6) * 1e-3, np.arange(5) * 1e-3)
    k = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    triangles = triangles[np.argsort(triangles.max(axis=1))]
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    file, text = tmp_path / f"part{kind}", ascii_files(vertices, triangles)[kind]
    file.write_text(text)
    assert len(CadReference.load(file).triangles) == len(triangles)
    lines = text.splitlines(keepends=True)
    for share in (0.75, 0.9, 0.97):
        whole = "".join(lines[: int(share * len(lines))])
        cuts = [whole] if kind != ".obj" or share < 0.8 else []
        # Of an OBJ's last lines nothing tells that they were more, once all corners have triangles.
        cuts += [text[: int(share * len(text))].rstrip("\n")] if kind != ".obj" else []
        cuts += [text[:-3]] if kind == ".obj" else []  # "f 1 2" is no triangle
        for cut in cuts:
            file.write_text(cut)
            with pytest.raises(ReferenceError, match=r"; export it anew|no triangles"):
                CadReference.load(file)


def test_whole_model_files_as_others_write_them(tmp_path: Path) -> None:
    vertices, triangles = mesh_of(flat, (0.0, 0.0, 0.0))
    triangles = triangles[:40]
    text = ascii_files(vertices[: triangles.max() + 1], triangles)
    corners = np.zeros((40, 4, 3), "<f4")
    corners[:, 1:] = vertices[triangles]
    rows = b"".join(own.tobytes() + b"\0\0" for own in corners)
    binary = b"solid facet by others".ljust(80) + (40).to_bytes(4, "little") + rows
    files = {
        "upper.stl": text[".stl"].replace("endsolid", "ENDSOLID").encode(),
        "trailing.stl": (text[".stl"] + " " * 300 + "\n").encode(),
        "long_name.stl": (text[".stl"].rstrip() + "x" * 250 + "\n").encode(),
        "binary.stl": binary,
        "no_newline.obj": text[".obj"].rstrip().encode(),
        "comment.obj": (text[".obj"] + "# End of File").encode(),
        "axes.obj": (text[".obj"] + "v 0 0 0\nv 1 0 0\n").encode(),
    }
    for name, content in files.items():
        file = tmp_path / name
        file.write_bytes(content)
        assert len(CadReference.load(file).triangles) == 40, name
    quads = "".join(f"v {k} {k % 2} 0\n" for k in range(4)) + "f 1 2 3 4\n"
    (tmp_path / "quads.obj").write_text(quads)
    with pytest.raises(ReferenceError, match="1 faces have more than three corners, of which none"):
        CadReference.load(tmp_path / "quads.obj")


@pytest.mark.parametrize(("unit", "millimetre"), [("mm", 1.0), ("m", 1e-3), ("inch", 1 / 25.4)])
def test_a_step_file_is_read_in_metres_whatever_its_unit(
    unit: str, millimetre: float, tmp_path: Path
) -> None:
    pytest.importorskip("cascadio", reason="cascadio is not there, which reads STEP")
    file = tmp_path / "box.STP"
    corners = np.array([[1.0, 2.0, -3.0], [21.0, 17.0, 0.5]])
    file.write_text(box_step(corners * millimetre, unit))
    read = CadReference.load(file)
    np.testing.assert_allclose(
        [f(read.vertices_m, axis=0) for f in (np.min, np.max)], corners / 1e3
    )
    file.write_text(file.read_text()[:900])
    with pytest.raises(ReferenceError, match=r"box\.STP: .* is it "):
        CadReference.load(file)


def test_step_without_its_library_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("roller_inspect.references.model_file.find_spec", lambda name: None)
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    with pytest.raises(ReferenceError, match="pip install cascadio"):
        CadReference.load(tmp_path / "part.step")
