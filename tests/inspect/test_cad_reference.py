"""A model as the reference: how it is laid on the scan, and what it shows."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from roller_core.transforms import F64
from roller_inspect.references import CadReference
from roller_inspect.references.cad import unfollowed

from .analytic_surface import dent, flat
from .boss_part import BOSS, inspect, mesh_of, part


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
