"""The sphere in a pass, the truth it gives, and the search over the paper's parameters."""

import numpy as np
import pytest

from calibration.scans import (
    CENTRE_M,
    CONTACT_M,
    RADIUS_M,
    ROLLING,
    TOWARDS,
    dome_points,
    plate_points,
    sphere_pass,
)
from roller_calibration.contact import ContactWindow, contact_view, contact_windows, pass_points
from roller_calibration.error_table import CoverageError, ErrorTable
from roller_calibration.grid_search import focus_errors
from roller_calibration.grids import check_weights, focus_grid, paper_grid, simplex
from roller_calibration.paper_search import medians, window_errors
from roller_calibration.sphere import Sphere, SphereError, find_sphere
from roller_core.errors import SettingsError
from roller_core.transforms import pose_matrix, rotation_vector_to_quaternion
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.paper.median import masked_median
from roller_emvs.methods.paper.threshold import adaptive_threshold, margins
from roller_emvs.pipeline import DepthPipeline

NOISE_M = 3e-5
SETTINGS = DepthSettings.create({"method": "bma", "paper.full_scale_votes": 0.0})


def scene(*spheres: tuple[np.ndarray, float], noise_m: float = NOISE_M) -> np.ndarray:
    parts = [dome_points(c, r, 2500, k, noise_m) for k, (c, r) in enumerate(spheres)]
    plate = plate_points(*(spheres[0] if spheres else (CENTRE_M + 1.0, 0.001)), 1500, 9, noise_m)
    # As much of a plate as tells the sphere from it; a long one is searched for long.
    return np.concatenate([*parts, plate[np.abs(plate[:, 0]) < 8e-3]])


@pytest.fixture(scope="module")
def sphere() -> Sphere:
    return find_sphere(*pass_points(sphere_pass(), SETTINGS), RADIUS_M)


@pytest.fixture(scope="module")
def windows(sphere: Sphere) -> list[ContactWindow]:
    return contact_windows(sphere_pass(), SETTINGS, sphere)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.4, -0.7, 2.0)])
def test_sphere_is_found_wherever_base_is(turn: tuple[float, float, float]) -> None:
    base = pose_matrix([2.0, -1.0, 0.5], rotation_vector_to_quaternion(list(turn)))
    points = scene((CENTRE_M, RADIUS_M)) @ base[:3, :3].T + base[:3, 3]
    found = find_sphere(points, base[:3, :3] @ TOWARDS, RADIUS_M)
    centre = base[:3, :3] @ CENTRE_M + base[:3, 3]
    assert np.linalg.norm(found.centre_m - centre) < 1e-5
    assert found.fitted_radius_m == pytest.approx(RADIUS_M, rel=0.02)
    # The circle is where the points leave the sphere, a ring of a twentieth radius drawn in.
    assert CONTACT_M - 0.1 * RADIUS_M < found.contact_radius_m <= CONTACT_M


def test_skin_that_leaves_the_sphere_makes_it_no_larger() -> None:
    """From the edge of contact on it goes on as steep as there."""
    beyond = plate_points(CENTRE_M, RADIUS_M, 40_000)
    rho = np.hypot(*(beyond - CENTRE_M)[:, :2].T) - CONTACT_M
    beyond, rho = beyond[(rho > 0) & (rho < 4e-4)], rho[(rho > 0) & (rho < 4e-4)]
    height = np.sqrt(RADIUS_M**2 - CONTACT_M**2)
    beyond[:, 2] = CENTRE_M[2] - height + CONTACT_M / height * rho
    found = find_sphere(
        np.concatenate([dome_points(CENTRE_M, RADIUS_M, 2500), beyond]), TOWARDS, RADIUS_M
    )
    assert found.fitted_radius_m == pytest.approx(RADIUS_M, rel=0.01)
    assert not found.odd


def test_stray_depths_do_not_move_the_sphere() -> None:
    stray = np.random.default_rng(5).uniform([-4e-3, -3e-3, 0.043], [4e-3, 3e-3, 0.047], (500, 3))
    found = find_sphere(np.concatenate([scene((CENTRE_M, RADIUS_M)), stray]), TOWARDS, RADIUS_M)
    assert np.linalg.norm(found.centre_m - CENTRE_M) < 3e-5


def ridge() -> np.ndarray:
    """A half cylinder: round one way only."""
    points = scene((CENTRE_M, RADIUS_M))
    x = points[:, 0]
    points[:, 2] = CENTRE_M[2] - np.sqrt(np.maximum(RADIUS_M**2 - x**2, (0.6 * RADIUS_M) ** 2))
    return points


@pytest.mark.parametrize(
    ("points", "fault", "says"),
    [
        (scene(), SphereError, "no sphere"),
        (ridge(), SphereError, "no sphere"),
        (
            scene((CENTRE_M, RADIUS_M), (CENTRE_M + [0.008, 0, 0], RADIUS_M)),
            SphereError,
            "2 spheres in view, 8.0 mm apart",
        ),
        (scene((CENTRE_M, 0.005)), SphereError, "fits a radius of 5.0"),
        (scene((CENTRE_M, 0.0032)), SphereError, "fits a radius of 3.2"),
        (scene((CENTRE_M, RADIUS_M))[::100], SphereError, "too few events"),
    ],
    ids=["none", "ridge", "two", "larger", "smaller", "few"],
)
def test_what_is_no_calibration_sphere_is_refused(
    points: np.ndarray, fault: type[Exception], says: str
) -> None:
    with pytest.raises(fault, match=says):
        find_sphere(points, TOWARDS, RADIUS_M)


def test_contact_view_is_the_sphere_equation(sphere: Sphere) -> None:
    pose = pose_matrix([0.001, 0.0, 0.0], rotation_vector_to_quaternion([0.004, -0.03, 0.4]))
    view = contact_view(sphere, ROLLING, pose)
    assert view is not None
    v, u = np.nonzero(view.mask)
    z = view.depth_m[view.mask]
    pixels = np.column_stack([u + view.box.left, v + view.box.top])
    points = ROLLING.rays(pixels) * z[:, None] @ pose[:3, :3].T + pose[:3, 3]
    arm = points - sphere.centre_m
    np.testing.assert_allclose(np.linalg.norm(arm, axis=1), RADIUS_M, atol=1e-12)
    assert (arm @ sphere.towards > 0).all()
    across = np.linalg.norm(arm - np.outer(arm @ sphere.towards, sphere.towards), axis=1)
    assert across.max() <= sphere.contact_radius_m
    # The circle's area, in pixels of the scale at its depth.
    area = np.pi * (sphere.contact_radius_m * ROLLING.fx / view.plane_m) ** 2
    assert view.pixels == pytest.approx(area, rel=0.05)


def test_circle_that_the_image_cuts_has_no_view(sphere: Sphere) -> None:
    for x in (-0.008, 0.008):
        assert contact_view(sphere, ROLLING, pose_matrix([x, 0, 0], [0, 0, 0, 1])) is None


def test_sphere_beside_the_path_is_off_the_patch() -> None:
    beside = sphere_pass(across_m=0.0022)
    found = find_sphere(*pass_points(beside, SETTINGS), RADIUS_M)
    with pytest.raises(SphereError, match="middle of the image"):
        contact_windows(beside, SETTINGS, found)


def test_patch_length_counts(sphere: Sphere, windows: list[ContactWindow]) -> None:
    short = SETTINGS.model_copy(update={"patch_half_length_m": 0.006})
    kept = contact_windows(sphere_pass(), short, sphere)
    assert 0 < len(kept) < len(windows)


def test_sphere_is_where_it_is(sphere: Sphere) -> None:
    assert np.linalg.norm(sphere.centre_m - CENTRE_M) < 4e-5
    assert sphere.moved_to_top(0.0434).top_m[2] == pytest.approx(0.0434)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"paper.threshold_c": 7.0, "paper.median_px": 21, "paper.weights": (0.2, 0.5, 0.3)},
        {"paper.plane_rule": "fixed", "paper.planes": 90},
        {"paper.weights": (0.0, 1.0, 0.0)},
    ],
    ids=["default", "other", "many planes", "one view"],
)
def test_errors_are_those_of_the_pipeline(changes: dict, windows: list[ContactWindow]) -> None:
    """What the search makes bit by bit, `DepthPipeline` makes as a whole."""
    s = SETTINGS.changed(changes)
    rolled = sphere_pass()
    pipeline = DepthPipeline(s, rolled.camera, rolled.track)
    pipeline.add_events(rolled.events)
    maps = {m.stamp_ns: m for m in pipeline.results(flush=True) if isinstance(m, DepthMap)}
    weights = np.array([[0, 0.5, 0.5], s.paper.weights])
    grid = paper_grid(weights, (s.paper.threshold_c, 5.0), (s.paper.median_px, 11))
    choice = int(np.ravel_multi_index((0, 0, 1), grid.shape))
    for window in windows:
        view = window.view
        miss = (view.box.of(maps[window.prepared.middle_ns].depth) - view.depth_m)[view.mask]
        errors, points = window_errors(window, ROLLING, s, grid)
        assert points[choice] == np.isfinite(miss).sum() > 100
        assert errors[choice] == pytest.approx(np.nansum(np.abs(miss)), rel=1e-4)


def test_medians_of_all_sizes_are_masked_medians() -> None:
    rng = np.random.default_rng(4)
    for share, levels in ((0.02, 20), (0.4, 20), (0.4, 200)):
        index = rng.integers(0, levels, (37, 41)).astype(np.uint16)
        mask = rng.random(index.shape) < share
        rows, columns = np.nonzero(mask)
        found = medians(index, mask, rows, columns, (3, 11, 45), levels)
        for k, size in enumerate((3, 11, 45)):
            expected = masked_median(index, mask, size, levels)
            np.testing.assert_allclose(found[:, k], expected[mask], atol=1e-5)


@pytest.mark.parametrize("shape", [(60, 80), (41, 97), (7, 33), (5, 3)])
@pytest.mark.parametrize("kernel_px", [1, 3, 5])
def test_margins_give_every_threshold(shape: tuple[int, int], kernel_px: int) -> None:
    """Blocks without a high level, which the threshold passes over, among them."""
    rng = np.random.default_rng(0)
    votes = rng.gamma(2.0, 10.0, shape).astype(np.float32)
    votes[:20] = 0
    few = votes * (rng.random(shape) < 0.02)
    for given in (votes, few):
        for scale in (0.0, 48.0):
            margin = margins(given, kernel_px, scale)
            for c in (0, 5, 20):
                taken = adaptive_threshold(given, c, kernel_px, scale)
                np.testing.assert_array_equal(margin > c, taken)


@pytest.mark.parametrize(("views", "parts", "count"), [(1, 7, 1), (2, 10, 11), (3, 18, 190)])
def test_simplex_is_whole(views: int, parts: int, count: int) -> None:
    found = simplex(views, parts)
    assert found.shape == (count, views)
    assert len(np.unique(np.rint(found * parts), axis=0)) == count
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert found.min() >= 0


def test_grid_holds_the_papers_choice() -> None:
    grid = paper_grid(simplex(3, 18))
    assert grid.shape == (16, 41, 190)
    values = [grid.values(k) for k in range(grid.size - 1, -1, -9973)]
    assert all(5 <= v["paper.threshold_c"] <= 20 and v["paper.median_px"] % 2 == 1 for v in values)
    weights = np.array([4, 3, 2]) / 9
    assert np.isclose(grid.ranges["paper.weights"], weights).all(axis=1).any()
    assert grid.at_border(0) == ["paper.threshold_c", "paper.median_px"]


def test_weights_off_the_simplex_are_refused() -> None:
    check_weights(SETTINGS)
    with pytest.raises(SettingsError, match="weights"):
        check_weights(SETTINGS.changed({"paper.weights": (1.0, 1.0, 1.0)}))


def test_leaving_points_out_is_no_merit() -> None:
    table = ErrorTable.empty([100, 100], 3)
    table.points[:] = [[90, 50, 5], [90, 50, 5]]
    table.errors_m[:] = table.points * np.array([[3e-4, 2e-4, 1e-4], [3e-4, 2e-4, 1e-4]])
    assert [table.best(floor) for floor in (0.0, 0.05, 0.06, 0.5, 0.51, 0.9)] == [2, 2, 1, 1, 0, 0]
    assert str(table.summary(1)) == "200.0 µm at 50.0% of the contact circle"
    with pytest.raises(CoverageError, match="the most is 90"):
        table.best(0.95)


def test_held_out_windows_have_no_say() -> None:
    table = ErrorTable.empty([10, 10], 2)
    table.points[:] = 10
    # Each window likes another choice, so the other one's is the worse for it.
    table.errors_m[:] = [[1e-3, 2e-3], [2e-3, 1e-3]]
    held = table.held_out(["a", "b"], 0.0)
    assert held is not None
    assert held.error_m == pytest.approx(2e-4)
    assert table.held_out(["a", "a"], 0.0) is None


def test_search_finds_what_is_better(windows: list[ContactWindow]) -> None:
    grid = paper_grid(simplex(3, 4), (5.0, 12.0, 20.0), (11, 31, 91))
    table = ErrorTable.empty([w.view.pixels for w in windows], grid.size)
    for k, window in enumerate(windows):
        table.errors_m[k], table.points[k] = window_errors(window, ROLLING, SETTINGS, grid)
    every = [table.summary(k) for k in range(grid.size)]
    best = table.summary(table.best(0.1))
    assert best.coverage >= 0.1
    assert best.error_m == min(f.error_m for f in every if f.coverage >= 0.1)


def test_focus_is_judged_about_its_median_unless_the_top_is_known(sphere: Sphere) -> None:
    s = DepthSettings.create({"method": "focus", "window.overlap": 0.9})
    low = sphere.moved_to_top(float(sphere.top_m[2]) + 2e-4)
    windows = contact_windows(sphere_pass(), s, low)
    free, points = focus_errors(windows, ROLLING, s, absolute=False)
    known, same = focus_errors(windows, ROLLING, s, absolute=True)
    np.testing.assert_array_equal(points, same)
    assert free.sum() / points.sum() < 6e-5
    assert known.sum() / points.sum() == pytest.approx(2e-4, rel=0.35)
    grid = focus_grid()
    sigmas = {grid.values(k)["focus.sigma_px"] for k in range(grid.size)}
    assert sigmas == set(grid.ranges["focus.sigma_px"])
