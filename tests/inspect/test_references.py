"""References: nominal forms, golden scans and CAD."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from roller_core.transforms import F64
from roller_inspect.height_map import HeightMap
from roller_inspect.pieces import Found
from roller_inspect.references import (
    CadReference,
    Form,
    GoldenReference,
    NominalReference,
    Reference,
    ReferenceError,
    SelfReference,
    teach,
)
from roller_inspect.references.cad import unfollowed
from roller_inspect.surface_inspector import InspectionSettings, SurfaceInspector

from .analytic_surface import Surface, dent, errors, flat, scan
from .box_step import box_step

BOSS = (0.012, 0.0)


def part(x: F64, y: F64) -> F64:
    """A plate with a boss whose walls the skin rounds."""
    r = np.hypot(x - BOSS[0], y - BOSS[1])
    return 3e-4 / (1 + np.exp((r - 2.5e-3) / 1.5e-4))


def inspect(surface: Surface, reference: Reference, seed: int = 0, **options: object) -> Found:
    inspector = SurfaceInspector(InspectionSettings.create({}), reference)
    for patch in scan(surface, length_m=0.024, width_m=0.01, seed=seed, **options):  # type: ignore[arg-type]
        inspector.add(patch)
    return inspector.finish()


def map_of(surface: Surface, seed: int = 0) -> HeightMap:
    found = inspect(surface, SelfReference(), seed).height_map
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("form", "surface"),
    [
        ("plane", lambda x, y: 0.01 * x - 0.02 * y + 1e-4),
        ("cylinder", lambda x, y: np.sqrt(0.25**2 - (0.8 * x + 0.6 * y - 0.01) ** 2) - 0.25),
        ("polynomial3", lambda x, y: 2 * x * y + 300 * x**2 * y - 0.5 * y**2),
    ],
)
def test_a_nominal_form_is_found_beside_a_defect(form: Form, surface: Surface) -> None:
    bump = dent((0.016, 0.001), 1.5e-3, -2e-4)
    height_map = map_of(lambda x, y: surface(x, y) + bump(x, y))
    comparison = NominalReference(form).compare(height_map)
    true = bump(height_map.x_m[None, :], height_map.y_m[:, None])
    error = (comparison.deviation_m - true)[:, 5:-5]
    error = error[np.isfinite(error).all(axis=1)]
    assert len(error) > 90
    assert np.abs(np.median(error)) < 2e-6
    assert np.abs(error.mean(axis=1)).max() < 1.5e-5
    assert comparison.alignment.residual_m < 2e-5


def test_a_golden_part_shows_what_is_missing_and_nothing_else(tmp_path: Path) -> None:
    golden = teach([map_of(part, seed) for seed in (1, 2, 3)])
    assert golden.scans == 3
    assert np.nanmedian(golden.spread_m) < 2e-5
    golden.save(tmp_path)
    reference = GoldenReference.load(tmp_path)
    assert inspect(part, reference, seed=4).findings == ()
    hole = dent((BOSS[0] + 1e-3, 0.0), 1e-3, 2e-4)
    found = inspect(lambda x, y: part(x, y) + hole(x, y), reference, seed=5)
    (finding,) = found.findings
    assert finding.kind == "missing"
    assert abs(finding.depth_m + 2e-4) < finding.uncertainty.depth_m
    with pytest.raises(ReferenceError, match=r"no golden\.npz"):
        GoldenReference.load(tmp_path / "none")
    for content in (b"no archive", b"PK\x03\x04 cut short", b""):
        (tmp_path / "golden.npz").write_bytes(content)
        with pytest.raises(ReferenceError, match=r"golden\.npz: isn't what teach writes$"):
            GoldenReference.load(tmp_path)


def test_what_scatters_in_few_good_scans_is_no_finding_in_another() -> None:
    dots = [(0.004 + 0.0025 * k, y) for k in range(7) for y in (-2.5e-3, 0.0, 2.5e-3)]

    def dotted(seed: int) -> Surface:
        """A plate with dots, whose steep flanks are read 40 µm higher or lower by each scan."""
        random = np.random.default_rng(seed)
        step = 1e-4
        wrong = errors((102, 242), step, 4e-5, random)

        def height(x: F64, y: F64) -> F64:
            r = np.min([np.hypot(x - u, y - v) for u, v in dots], axis=0)
            at = np.broadcast_arrays((y + 5e-3) / step, x / step)
            flank = np.exp(-(((r - 4e-4) / 2e-4) ** 2))
            return 4e-4 * np.exp(-((r / 4e-4) ** 2)) + flank * map_coordinates(wrong, at, order=1)

        return height

    golden = teach([map_of(dotted(seed), seed) for seed in (1, 2, 3)])
    # With a spread of few scans as it is found each had several; one in a hundred dots is far off.
    found = [f for seed in range(4, 9) for f in inspect(dotted(seed), golden, seed).findings]
    assert len(found) <= 1
    missing = dent(dots[10], 8e-4, 3e-4)
    other = dotted(8)
    (finding,) = inspect(lambda x, y: other(x, y) + missing(x, y), golden, 8).findings
    assert finding.kind == "missing"
    small = dent((0.01525, 1.25e-3), 1e-3, -1.2e-4)
    (finding,) = inspect(lambda x, y: other(x, y) + small(x, y), golden, 8).findings
    assert finding.kind == "extra"


def test_a_bad_part_among_those_that_teach_is_named() -> None:
    hole = dent((BOSS[0] + 4e-3, 0.0), 1.5e-3, 3e-4)
    good, bad = map_of(part, 1), map_of(lambda x, y: part(x, y) + hole(x, y), 2)
    with pytest.raises(ReferenceError, match=r"scan 1 of 2 differs .* around x 16\.0, y .* three"):
        teach([good, bad])
    said: list[str] = []
    golden = teach([good, bad, map_of(part, 3)], said.append)
    (line,) = said
    assert line.startswith("scan 2 of 3 differs from the rest by 2")
    place = np.hypot(golden.x_m[None, :] - 0.016, golden.y_m[:, None]) < 8e-4
    assert abs(np.nanmean(golden.height_m[place])) < 2e-5
    teach([good, map_of(part, 4)], said.append)
    assert said[1:] == ["what good parts differ by shows in 3 scans or more, not in 2"]


def test_a_scan_teaches_once() -> None:
    good, other = map_of(part, 1), map_of(part, 2)
    again = replace(good, height_m=good.height_m + np.float32(1e-9))
    with pytest.raises(ReferenceError, match="scans 1 and 3 are the same"):
        teach([good, other, again])


def mesh_of(surface: Surface, shift: tuple[float, float, float]) -> tuple[F64, np.ndarray]:
    step = 1e-4
    x, y = np.meshgrid(np.arange(-0.002, 0.027, step), np.arange(-0.007, 0.007, step))
    ny, nx = x.shape
    k = np.arange(ny * nx).reshape(ny, nx)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    vertices = np.column_stack([x.ravel(), y.ravel(), surface(x, y).ravel()]) + shift
    return vertices, np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])


def test_a_model_is_laid_on_the_scan_in_what_its_shape_determines() -> None:
    shift = (1e-4, -8e-5, 5e-5)
    found = inspect(part, CadReference(*mesh_of(part, shift)))
    assert found.findings == ()
    assert found.alignment is not None
    assert {"x", "y", "z"} <= set(found.alignment.refined)
    assert "rz" not in found.alignment.refined
    moved = found.alignment.correction @ [*BOSS, 0.0, 1.0]
    np.testing.assert_allclose(moved[:3] - [*BOSS, 0.0], -np.array(shift), atol=4e-5)
    plane = inspect(flat, CadReference(*mesh_of(flat, shift))).alignment
    assert plane is not None
    assert set(plane.refined) == {"z", "rx", "ry"}


@pytest.mark.parametrize("axis", range(6))
def test_a_model_that_lies_a_millimetre_or_two_degrees_off_is_laid_on_the_scan(axis: int) -> None:
    """A part whose shape says all: two bosses of different size."""

    def two(x: F64, y: F64) -> F64:
        r = np.hypot(x - 0.019, y - 2e-3)
        return part(x, y + 1.5e-3) + 3e-4 / (1 + np.exp((r - 1.5e-3) / 1.5e-4))

    turn = np.zeros(3)
    shift = np.zeros(3)
    (shift if axis < 3 else turn)[axis % 3] = 1e-3 if axis < 3 else np.radians(2.0)
    vertices, triangles = mesh_of(two, (0.0, 0.0, 0.0))
    middle = np.array([0.012, 0.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    pose[:3, 3] = middle - pose[:3, :3] @ middle + shift
    found = inspect(two, CadReference(vertices, triangles, pose))
    assert found.findings == ()
    assert found.alignment is not None
    back = (found.alignment.correction @ pose @ [*BOSS, 0.0, 1.0])[:3] - [*BOSS, 0.0]
    assert np.abs(back).max() < 5e-5
    # What the geometry doesn't determine stays where the pose has it.
    flat_found = inspect(flat, CadReference(*mesh_of(flat, (0.0, 0.0, 0.0)), pose)).alignment
    assert flat_found is not None
    moved = flat_found.correction @ pose @ [*BOSS, 0.0, 1.0]
    np.testing.assert_allclose(moved[:2], (BOSS + shift[:2]), atol=1e-5)
    assert abs(moved[2]) < 2e-5


def test_a_burr_along_an_edge_does_not_tilt_the_model_that_it_is_held_against() -> None:
    def burr(x: F64, y: F64) -> F64:
        return 2e-4 / (1 + np.exp(-(y - 0.0033) / 1e-4)) + 0.0 * x

    found = inspect(burr, CadReference(*mesh_of(flat, (0.0, 0.0, 0.0))))
    assert max(f.depth_m for f in found.findings) == pytest.approx(2e-4, abs=2e-5)


def test_what_is_left_of_the_form_hides_no_bump_from_a_model() -> None:
    bump = dent((0.015, 0.0), 1e-3, -1.5e-4)

    def wavy(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 7e-5 * np.sin(x / 4e-3) * np.cos(y / 4e-3) + bump(x, y)

    found = inspect(wavy, CadReference(*mesh_of(flat, (0.0, 0.0, 0.0))))
    assert ("extra", True) in {(f.kind, bool(f.depth_m > 1e-4)) for f in found.findings}


def test_a_model_in_millimetres_or_elsewhere_is_refused_in_one_line() -> None:
    vertices, triangles = mesh_of(part, (0.0, 0.0, 0.0))
    for wrong, words in (
        (vertices * 1e3, "millimetres"),
        (vertices + [1, 0, 0], "from the scan; models are in the recipe's frame"),
    ):
        found = inspect(part, CadReference(wrong, triangles))
        assert found.alignment is None
        assert any(words in fault for fault in found.faults)
        assert found.findings == ()
        assert found.height_map is not None


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


def test_a_model_that_is_turned_is_refused() -> None:
    """Ten degrees would be found, and what lies two millimetres off be called missing."""
    vertices, triangles = mesh_of(part, (0.0, 0.0, 0.0))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.0, np.radians(5.0), 0.0]).as_matrix()
    middle = np.array([0.012, 0.0, 0.0])
    pose[:3, 3] = middle - pose[:3, :3] @ middle
    found = inspect(part, CadReference(vertices, triangles, pose))
    assert found.findings == ()
    (said,) = found.faults
    assert re.search(r"where the pose puts it, turned by [45]\.\d°, and", said), said


def test_what_a_skin_bridges_at_a_models_walls_is_no_finding() -> None:
    """It hangs from a block's edge to the plate, 0.25 mm from there; a dent beside it is one."""

    def block(x: F64, y: F64) -> F64:
        inside = (np.abs(x - 0.012) < 4e-3) & (np.abs(y) < 3e-3)
        return np.where(inside, 2e-4, 0.0)

    def skin(x: F64, y: F64) -> F64:
        beside = np.maximum(np.abs(x - 0.012) - 4e-3, np.abs(y) - 3e-3)
        return 2e-4 * np.clip(1.0 - beside / 2.5e-4, 0.0, 1.0)

    model = CadReference(*mesh_of(block, (0.0, 0.0, 0.0)))
    assert inspect(skin, model).findings == ()
    hole = dent((0.019, 0.0), 1.2e-3, 2e-4)
    found = inspect(lambda x, y: skin(x, y) + hole(x, y), model).findings
    (finding,) = found
    assert finding.kind == "missing"


def test_a_slope_is_followed_and_a_wall_is_not() -> None:
    x = np.arange(0.0, 12e-3, 1e-4)
    for slope in (0.0, 0.3, 0.8):
        ramp = np.tile((slope * x).astype(np.float32), (15, 1))
        assert unfollowed(ramp, 1e-4)[:, 20:-20].max() < 1e-6
    wall = np.tile(np.where(x > 6e-3, 2e-4, 0.0).astype(np.float32), (15, 1))
    off = unfollowed(wall, 1e-4)[7]
    assert off[58:63].min() > 5e-5
    assert off[:50].max() < 1e-6
    assert off[72:].max() < 1e-6
    wall[:, 80:] = np.nan
    assert np.isfinite(unfollowed(wall, 1e-4)).all()


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
