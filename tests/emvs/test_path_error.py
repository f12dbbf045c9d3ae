"""Poses that err along the motion: events of a texture tell how the error bends."""

from collections.abc import Callable

import numpy as np
import pytest

from emvs.textured_scans import swept_points, true_track
from roller_emvs.lines.fit import TEXTURE_ROW_STEP
from roller_emvs.lines.near_lines import near_lines
from roller_emvs.lines.path_error import _BESIDE, _TUKEY_PX, PathError, _add_apart
from roller_emvs.methods.surface import SurfaceSettings, SurfaceSweep
from roller_evaluation.plate_surface import seen_area
from roller_sim.presets import COATINGS
from simulated_scans import Scans

PIXEL_M, MIDDLE_M, SLOPE = 4.2e-5, 0.045, 0.29
BLOCK_M, ROWS, APART_PX = 0.008, 20, 7.0
F64 = np.ndarray
Error = Callable[[F64], F64]


def no_error(places: F64) -> F64:
    return np.zeros_like(places)


def waves(length_m: float, height_m: float = 3e-6) -> Error:
    return lambda places: height_m * np.sin(2 * np.pi * places / length_m)


class Texture:
    """Blocks of a plate in the middle plane whose events come at places that err.

    Lines are those that a fit finds: they take what grows evenly along their events for depth.
    """

    def __init__(self, path: Error, in_image: Error = no_error, seed: int = 1) -> None:
        self._path, self._in_image = path, in_image
        self._rng = np.random.default_rng(seed)

    def depth_error_m(self, x_m: F64) -> F64:
        """What depths at places along the strip lack."""
        slopes = np.linspace(-SLOPE, SLOPE, 400)
        off = [self._path(x - slopes * MIDDLE_M) for x in x_m]
        return np.array([np.polyfit(slopes, o, 1)[0] for o in off])

    def block(self, number: int) -> tuple[np.ndarray, tuple[np.ndarray, F64, F64], float]:
        """Rays, lines, and where the first column lies."""
        left_m = number * BLOCK_M
        column = np.arange(4.0, BLOCK_M / PIXEL_M, APART_PX)
        each = 800 * ROWS // 2
        k = np.repeat(np.arange(len(column)), each)
        slopes = self._rng.uniform(-SLOPE, SLOPE, len(k))
        x = left_m + column[k] * PIXEL_M
        off = self._path(x - slopes * MIDDLE_M) + self._in_image(slopes)
        fits = np.array([np.polyfit(slopes[k == i], off[k == i], 1) for i in range(len(column))])
        rays = np.zeros((len(k), 4), np.float32)
        rays[:, 0] = column[k] + off / PIXEL_M + self._rng.normal(0, 0.5, len(k))
        rays[:, 1] = self._rng.uniform(-0.5, ROWS - 0.5, len(k))
        rays[:, 2] = slopes / PIXEL_M
        rows = np.arange(0, ROWS, TEXTURE_ROW_STEP)
        row, place = np.repeat(rows, len(column)), np.tile(column + fits[:, 1] / PIXEL_M, len(rows))
        return rays, (row, place, np.tile(-fits[:, 0], len(rows))), left_m


def errors_left_um(texture: Texture, blocks: int) -> tuple[F64, F64, PathError]:
    """Errors of depth block by block, at first and with what was found, from the third one on."""
    path = PathError((-SLOPE, SLOPE), MIDDLE_M)
    before, after = [], []
    for number in range(blocks):
        rays, lines, left_m = texture.block(number)
        path.begin(left_m, left_m + BLOCK_M)
        surface = np.zeros((ROWS, int(BLOCK_M / PIXEL_M) + 4), np.float32)
        path.look(rays, PIXEL_M, surface, lines, (left_m, PIXEL_M))
        path.learn()
        x = left_m + np.linspace(0.1, 0.9, 9) * BLOCK_M
        if number >= 2:
            error = texture.depth_error_m(x)
            before.append(error)
            after.append(error - path.lacks_m(x))
    return 1e6 * np.concatenate(before), 1e6 * np.concatenate(after), path


@pytest.mark.parametrize("length_m", [0.016, 0.026, 0.04])
def test_what_bends_within_an_aperture_or_two_is_found(length_m: float) -> None:
    before, after, _ = errors_left_um(Texture(waves(length_m)), 8)
    assert before.std() > 2
    assert after.std() < 0.6 * before.std()


def test_what_nothing_tells_is_left_alone() -> None:
    """A speed that is off by a part in ten thousand: all of the surface lies too high."""
    before, after, _ = errors_left_um(Texture(lambda places: 1e-4 * places), 6)
    assert before.max() < -4
    np.testing.assert_allclose(after, before, atol=1.5)


def test_right_poses_stay() -> None:
    _, after, _ = errors_left_um(Texture(no_error), 6)
    assert np.abs(after).max() < 1.5


def test_what_hangs_on_the_image_is_not_taken_for_the_path() -> None:
    lens = Texture(no_error, lambda slopes: 3e-6 * np.sin(slopes / SLOPE * 2 * np.pi))
    _, after, _ = errors_left_um(lens, 6)
    assert np.abs(after).max() < 2


def test_ends_off_the_surface_are_not_taken_for_the_path() -> None:
    ends = Texture(no_error, lambda slopes: 1e-5 * (slopes < -0.95 * SLOPE))
    _, after, _ = errors_left_um(ends, 6)
    assert np.abs(after).max() < 1.5


def test_a_long_pass_keeps_no_more_than_is_in_view() -> None:
    _, after, path = errors_left_um(Texture(waves(0.026)), 40)
    assert len(path._right) < 80
    assert after[-90:].std() < 4


def test_far_along_a_bare_strip_nothing_between_is_kept() -> None:
    path, texture = PathError((-SLOPE, SLOPE), MIDDLE_M), Texture(waves(0.026))
    for number in (0, 12_500):  # 100 m
        rays, lines, left_m = texture.block(number)
        path.begin(left_m, left_m + BLOCK_M)
        surface = np.zeros((ROWS, int(BLOCK_M / PIXEL_M) + 4), np.float32)
        path.look(rays, PIXEL_M, surface, lines, (left_m, PIXEL_M))
        path.learn()
        assert len(path._right) < 80


def test_evenly_strewn_events_tell_nothing() -> None:
    path, rng = PathError((-SLOPE, SLOPE), MIDDLE_M), np.random.default_rng(1)
    rays, lines, left_m = Texture(waves(0.02, 2e-5)).block(0)
    rays[:, 0] = rng.uniform(0, BLOCK_M / PIXEL_M, len(rays))
    path.begin(left_m, left_m + BLOCK_M)
    surface = np.zeros((ROWS, int(BLOCK_M / PIXEL_M) + 4), np.float32)
    path.look(rays, PIXEL_M, surface, lines, (left_m, PIXEL_M))
    path.learn()
    assert not path.lacks_m(np.linspace(0, BLOCK_M, 5)).any()


def test_no_lines_and_no_events_tell_nothing() -> None:
    path = PathError((-SLOPE, SLOPE), MIDDLE_M)
    path.begin(0.0, BLOCK_M)
    none = np.empty(0)
    surface = np.zeros((4, 8), np.float32)
    path.look(
        np.empty((0, 4), np.float32), PIXEL_M, surface, (none.astype(int), none, none), (0, PIXEL_M)
    )
    path.learn()
    assert not path.lacks_m(np.linspace(0, BLOCK_M, 5)).any()


def test_distances_by_row_and_part_are_those_of_a_plain_sum() -> None:
    rng, shape, n = np.random.default_rng(2), (12, 60), 4000
    row = np.repeat(np.arange(0, 12, TEXTURE_ROW_STEP), 7)
    column, offset = np.tile(np.arange(6.0, 55.0, 7.3), 3), rng.uniform(-1e-4, 1e-4, 21)
    near = near_lines(row, column, shape, _BESIDE, TEXTURE_ROW_STEP)
    pixel = rng.integers(0, shape[0] * shape[1] + 1, n).astype(np.int32)
    slope = rng.uniform(-0.32, 0.32, n)
    x = pixel % shape[1] + rng.uniform(-1.5, 1.5, n)
    rays = np.column_stack([x, np.zeros(n), slope / PIXEL_M, np.zeros(n)]).astype(np.float32)
    rows, parts = (-0.4, 0.11), (4.0, PIXEL_M * 8 / 0.6)
    counts, apart, totals = np.zeros((5, 8)), np.zeros((5, 8)), np.zeros(2)
    _add_apart(
        rays, pixel, near, column, offset, _TUKEY_PX, rows, parts, PIXEL_M, counts, apart, totals
    )
    expected, number, sums = np.zeros((5, 8)), np.zeros((5, 8)), np.zeros(2)
    for ray, at in zip(rays.astype(np.float64), pixel, strict=True):
        if at == shape[0] * shape[1] or near[at] < 0:
            continue
        k = near[at]
        assert at // shape[1] - row[k] in (-1, 0, 1, 2)
        assert abs(at % shape[1] - np.rint(column[k])) <= _BESIDE
        u = (ray[0] + ray[2] * offset[k] - column[k]) / _TUKEY_PX
        where = (
            int(np.floor(rows[0] + column[k] * rows[1])),
            int(np.floor(parts[0] + ray[2] * parts[1])),
        )
        if abs(u) < 1 and 0 <= where[0] < 5 and 0 <= where[1] < 8:
            weighted = _TUKEY_PX * u * (1 - u**2) ** 2 * PIXEL_M
            number[where] += 1
            expected[where] += weighted
            sums += (1 - u**2) * (1 - 5 * u**2), weighted**2
    assert number.sum() > 500
    np.testing.assert_array_equal(counts, number)
    np.testing.assert_allclose(apart, expected, atol=1e-12)
    np.testing.assert_allclose(totals, sums, rtol=1e-9)


def test_a_textured_plate_errs_less_for_it(scans: Scans, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that sways by 8 µm every 24 mm of its way."""
    scene = {"margin_mm": 2.0, "step_mm": 0.03, "defects": 12, "defect_kinds": ["dent"]}
    scan = scans.scan("defects", scene=scene, camera={"height": 96}, **COATINGS["textured"])
    track, area, waves_um = true_track(scan, waves(0.024, 8e-6)), seen_area(scan), []
    for looks in (True, False):
        if not looks:
            monkeypatch.setattr(PathError, "lacks_m", lambda self, x: np.zeros_like(x))
        sweep = SurfaceSweep(SurfaceSettings.create({}), scan.camera, track)
        found = swept_points(sweep, scan)
        x, y, z = found[area.contains(*found[:, :2].T)].T
        error = 1e6 * (z - scan.truth.height_at(x, y))
        millimetre = np.floor(1e3 * x)
        columns = [np.median(error[millimetre == k]) for k in np.unique(millimetre)]
        waves_um.append(float(np.std(columns)))
    assert waves_um[1] > 10
    assert waves_um[0] < 0.6 * waves_um[1]
