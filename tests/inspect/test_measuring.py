"""Measuring tools on analytic surfaces with errors that neighbours share."""

from dataclasses import replace

import numpy as np
import pytest

from roller_core.transforms import F64
from roller_inspect.findings import CellUncertainty
from roller_inspect.height_map import CONTINUED, MEASURED, UNMEASURED, HeightMap
from roller_inspect.height_map.height_map import centres
from roller_inspect.measures import Figure, measure_all
from roller_inspect.measuring.measured import Measured
from roller_inspect.measuring.profile import Profile, profile, width_and_depth
from roller_inspect.measuring.regions import extent, flushness_and_tilt, roughness, step_height
from roller_inspect.recipe import Recipe

from .analytic_surface import Surface, dent, errors

SIGMA_M = 2e-5


def map_of(surface: Surface, seed: int = 0, noise_m: float = SIGMA_M) -> HeightMap:
    """20 × 12 mm of a surface, a third of the cells not measured."""
    x, y = centres(0, 200, 1e-4), centres(-60, 120, 1e-4)
    random = np.random.default_rng(seed)
    height = surface(x[None, :], y[:, None]) + errors((120, 200), 1e-4, noise_m, random)
    state = np.where(random.random((120, 200)) < 2 / 3, MEASURED, 2).astype(np.uint8)
    sigma = np.full(height.shape, noise_m, np.float32)
    points = (state == MEASURED).astype(np.uint16)
    return HeightMap(x, y, height.astype(np.float32), sigma, state, points, np.eye(4))


def disc(m: HeightMap, radius_m: float) -> np.ndarray:
    return np.hypot(m.x_m[None, :] - 0.01, m.y_m[:, None]) < radius_m


def holds(found: Measured, true: float) -> bool:
    assert found.value is not None
    return abs(found.value - true) <= found.uncertainty


def head(x: F64, y: F64) -> F64:
    """A head of 8 mm, 50 µm proud and tilted by 300 µm over 8 mm, on a plate that leans."""
    inside = np.hypot(x - 0.01, y) < 4e-3
    return 0.01 * x + np.where(inside, 5e-5 + 0.0375 * (x - 0.01), 0.0)


@pytest.mark.parametrize("across", [0.0, 0.3])
def test_a_step_and_a_tilt_are_those_of_the_planes_however_the_plate_leans(across: float) -> None:
    """Plate at 0.36 and head at 0.5 along x: by angles, not by the difference of slopes."""
    slope, own = 0.36, 0.5

    def leaning(x: F64, y: F64) -> F64:
        inside = np.hypot(x - 0.01, y) < 4e-3
        return across * y + np.where(inside, own * (x - 0.01) + 2e-4, slope * (x - 0.01))

    m = map_of(leaning, noise_m=1e-7)
    flushness, tilt = flushness_and_tilt(m, disc(m, 3.5e-3), ~disc(m, 4.5e-3))
    base, top = (np.array([-s, -across, 1.0]) for s in (slope, own))
    cosine = base @ top / np.linalg.norm(base) / np.linalg.norm(top)
    assert tilt.value == pytest.approx(np.arccos(cosine), abs=1e-4)
    assert flushness.value == pytest.approx(2e-4 / np.linalg.norm(base), abs=1e-6)


def test_step_tilt_and_their_uncertainties_hold_in_nine_of_ten() -> None:
    good, sizes = [], []
    for seed in range(12):
        m = map_of(head, seed)
        top, around = disc(m, 3.5e-3), ~disc(m, 4.5e-3)
        flushness, tilt = flushness_and_tilt(m, top, around)
        step = step_height(m, around, top)
        good += [holds(step, 5e-5), holds(flushness, 5e-5), holds(tilt, np.arctan(0.0375))]
        sizes += [step.uncertainty, 8e-3 * tilt.uncertainty]
        assert tilt.unit == "rad"
    assert np.mean(good) >= 0.9
    assert max(sizes) < 5e-5


def test_what_a_head_shares_may_lean() -> None:
    """Errors that change slowly over a head, as by drift, are in a tilt's uncertainty."""
    m = map_of(lambda x, y: 0.0 * x + 0.0 * y, noise_m=1e-8)
    _, sure = flushness_and_tilt(m, disc(m, 3.5e-3), ~disc(m, 4.5e-3))
    m = replace(m, sigma_m=np.full_like(m.sigma_m, SIGMA_M))
    _, found = flushness_and_tilt(m, disc(m, 3.5e-3), ~disc(m, 4.5e-3))
    assert 8e-3 * sure.uncertainty < 1e-6
    assert 8e-3 * found.uncertainty > 2 * SIGMA_M / 3


def test_extent_and_profile_of_a_hollow() -> None:
    m = map_of(dent((0.01, 0.0), 2e-3, 3e-4), noise_m=1e-5)
    found = extent(m, disc(m, 2.5e-3), disc(m, 5e-3) & ~disc(m, 3e-3))
    half = 2 * 2e-3 * np.sqrt(1 - np.sqrt(0.5))
    assert holds(found["depth"], -3e-4)
    assert holds(found["diameter"], half)
    assert holds(found["area"], np.pi / 4 * half**2)
    assert holds(found["volume"], -np.pi / 3 * 2e-3**2 * 3e-4)
    line = profile(m, (0.005, 0.0), (0.015, 0.0))
    assert line.distance_m[-1] == pytest.approx(0.01)
    width, depth = width_and_depth(line)
    assert holds(width, half)
    assert holds(depth, -3e-4)


def test_a_flat_bottom_is_no_deeper_for_its_noise_and_where_nothing_is_nothing_is_measured() -> (
    None
):
    """Slow errors too; a pocket of 5 mm, the same without it."""
    around = {0.0: "nothing stands out", -1e-4: ""}
    good, pockets = [], []
    for seed in range(10):
        slow = errors((120, 200), 1e-3, 5e-6, np.random.default_rng(100 + seed))
        for depth, reason in around.items():
            m = map_of(lambda x, y, d=depth: np.where(np.hypot(x - 0.01, y) < 2.5e-3, d, 0.0), seed)
            m = replace(m, height_m=m.height_m + slow.astype(np.float32))
            found = extent(m, disc(m, 3.1e-3), disc(m, 5.5e-3))
            assert reason in found["area"].reason
            assert (
                (found["area"].value is None) == (found["diameter"].value is None) == bool(reason)
            )
            good += [holds(found["depth"], depth)]
            good += [holds(found["volume"], np.pi * 2.5e-3**2 * depth)]
            if depth:
                assert found["depth"].value is not None
                pockets.append(found["depth"].value)
        _, tilt = flushness_and_tilt(m, disc(m, 2.2e-3), ~disc(m, 3.5e-3))
        good.append(holds(tilt, 0.0))
    assert np.mean(good) >= 0.9
    assert abs(np.mean(pockets) + 1e-4) < SIGMA_M


def test_what_does_not_rise_above_the_noise_is_not_measurable() -> None:
    def rough(x: F64, y: F64) -> F64:
        return 1e-4 * np.sin(2 * np.pi * x / 2e-3) + 0 * y

    everywhere = np.ones((120, 200), bool)
    smooth = map_of(lambda x, y: 0 * x * y)
    sa, sq = roughness(smooth, everywhere)
    assert sq.value is None
    assert "not measurable" in sa.reason
    assert holds(roughness(map_of(rough), everywhere)[1], 1e-4 / np.sqrt(2))
    width, depth = width_and_depth(profile(smooth, (0.005, 0.0), (0.015, 0.0)))
    assert width.value is None
    assert depth.value is None or abs(depth.value) < 2 * depth.uncertainty
    nowhere = np.zeros((120, 200), bool)
    assert step_height(smooth, nowhere, everywhere).value is None
    assert extent(smooth, nowhere, everywhere)["volume"].value is None


def test_of_a_region_that_was_hardly_measured_nothing_is_known() -> None:
    """Whether it lies beyond the map or on it; of 85 % of one its volume is that of the whole."""
    seen = map_of(lambda x, y: np.where(y > 0, 1e-4, 0.0) + 0 * x, noise_m=5e-6)
    y = np.broadcast_to(seen.y_m[:, None], seen.shape)
    bare = replace(seen, state=np.where(y > 0.002, UNMEASURED, seen.state).astype(np.uint8))
    regions = {
        "near": {"box_m": [0.0, 0.0, 0.02, 0.006]},
        "most": {"box_m": [0.0, 0.0, 0.02, 0.006 / 0.85]},
        "far": {"box_m": [0.0, 0.0, 0.02, 0.05]},
        "end": {"circle_m": [0.024, 0.003, 0.005]},
        "datum": {"box_m": [0.0, -0.006, 0.02, -0.0002]},
    }
    tools = ("step_height", "flushness", "tilt", "depth", "area", "volume", "roughness_sa")

    def figures(of: str, grid: HeightMap) -> list[Figure]:
        measures = [
            {"name": tool, "tool": tool, "of": of, "datum": "" if "rough" in tool else "datum"}
            for tool in tools
        ]
        limits = {"low": -1e-6, "high": 1e-6}
        recipe = Recipe.create({"regions": regions, "measures": [m | limits for m in measures]})
        return list(measure_all(recipe, grid, CellUncertainty.create({})))

    for of, grid in (("far", seen), ("end", seen), ("near", bare)):
        for figure in figures(of, grid):
            assert figure.value is None, (of, figure)
            assert figure.verdict == "unmeasured"
            # Of a third that was measured on the map its roughness is asked for less.
            assert "too little of the" in figure.reason or "noise" in figure.reason
    volumes = []
    for of in ("near", "most"):
        found = {figure.tool: figure for figure in figures(of, seen)}
        assert found["step_height"].value == pytest.approx(1e-4, abs=1e-5)
        assert found["depth"].value == pytest.approx(1e-4, abs=2e-5)
        assert found["volume"].value is not None
        volumes.append(found["volume"].value)
    assert volumes[0] == pytest.approx(0.02 * 0.006 * 1e-4, rel=0.05)
    assert volumes[1] == pytest.approx(volumes[0] / 0.85, rel=0.01)


@pytest.mark.parametrize("share", [0.1, 0.15, 0.3])
def test_a_width_is_as_uncertain_as_its_edges_are_far_from_what_was_measured(share: float) -> None:
    """A ridge of which few cells were measured; between them heights go straight."""
    good = []
    for seed in range(60):
        random = np.random.default_rng(seed)
        at = np.arange(100) * 1e-4
        true = 2e-4 * np.clip(1 - ((at - 5.1e-3) / 1.5e-3) ** 2, 0, None)
        state = np.where(random.random(100) < share, MEASURED, CONTINUED).astype(np.uint8)
        known = state == MEASURED
        height = np.interp(at, at[known], true[known] + random.normal(0, 1e-5, known.sum()))
        width, _ = width_and_depth(Profile(at, height, np.full(100, 1e-5), state))
        if width.value is not None:
            good.append(holds(width, 3e-3 / np.sqrt(2)))
    assert len(good) > 30
    assert np.mean(good) > 0.9


@pytest.mark.parametrize("mirrored", [False, True])
def test_one_edge_that_was_not_seen_is_enough_to_doubt_a_width(mirrored: bool) -> None:
    at = np.arange(100) * 1e-4
    height = np.where((at > 3.95e-3) & (at < 5.95e-3), 2e-4, 0.0)
    sigma, seen = np.full(100, 1e-6), np.full(100, MEASURED, np.uint8)
    gap = np.where((at > 3.55e-3) & (at < 4.35e-3), CONTINUED, MEASURED).astype(np.uint8)
    if mirrored:
        height, gap = height[::-1], gap[::-1]
    sharp, doubtful = (width_and_depth(Profile(at, height, sigma, s))[0] for s in (seen, gap))
    assert sharp.uncertainty == pytest.approx(2 * np.sqrt(2) * 1e-4 / np.sqrt(12), rel=0.1)
    assert doubtful.uncertainty == pytest.approx(2 * np.hypot(9, 1) * 1e-4 / np.sqrt(12), rel=0.1)
