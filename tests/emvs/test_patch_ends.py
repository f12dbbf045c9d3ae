"""Where the skin leaves the surface: events of a texture that lie beside their lines there."""

import numpy as np
import pytest

from roller_emvs.lines.refine import LinePoints
from roller_emvs.methods.surface.patch_ends import _MOST_PX, PatchEnds, _add_beside, _near

PIXEL_M, FOCAL_PX, SLOPE = 4.2e-5, 1000.0, 0.3
SHAPE = (40, 80)
COLUMNS = np.arange(8.0, 76.0, 6.0)
LINES = [(row, x) for row in range(0, SHAPE[0], 2) for x in COLUMNS]


def lines_of(polarity: int) -> dict[str, np.ndarray]:
    row, x = np.array(LINES).T
    n = len(row)
    values = {name: np.zeros(n) for name in LinePoints.__dataclass_fields__}
    return values | {"row": row, "column": x, "polarity": np.full(n, polarity)}


def block(
    lifted_px: tuple[float, float],
    tilted_m: float = 0.0,
    seed: int = 1,
    seen: tuple[float, float] = (-SLOPE, SLOPE),
) -> tuple[tuple[np.ndarray, np.ndarray], LinePoints]:
    """OFF and ON events of a texture, whose skin is off the surface in so many end columns.

    They lie up to half a pixel outwards there, and all of them by a depth more than the lines say.
    """
    rng = np.random.default_rng(seed)
    rays = []
    for _ in range(2):
        n = 250_000
        slope = rng.uniform(*seen, n)
        low, high = ((SLOPE + s * slope) * FOCAL_PX for s in (1, -1))
        out = 0.5 * np.maximum(1 - high / max(lifted_px[1], 1e-9), 0)
        out -= 0.5 * np.maximum(1 - low / max(lifted_px[0], 1e-9), 0)
        x = rng.choice(COLUMNS, n) + out + slope / PIXEL_M * tilted_m + rng.normal(0, 0.4, n)
        y = rng.uniform(-0.5, SHAPE[0] - 0.5, n)
        rays.append(np.column_stack([x, y, slope / PIXEL_M, np.zeros(n)]).astype(np.float32))
    both = [lines_of(polarity) for polarity in range(2)]
    lines = LinePoints(**{k: np.concatenate([part[k] for part in both]) for k in both[0]})
    return (rays[0], rays[1]), lines


SURFACES = (np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.float32))


@pytest.mark.parametrize("lifted", [(16.0, 16.0), (30.0, 12.0), (0.0, 24.0)])
def test_columns_that_are_off_the_surface_are_found(lifted: tuple[float, float]) -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    # A depth that the lines lack by a little isn't taken for it.
    rays, lines = block(lifted, tilted_m=8e-6)
    assert ends.look(rays, SURFACES, lines, PIXEL_M)
    assert ends.known
    for off_px, end in zip(lifted, ends.ends, strict=True):
        if off_px:
            assert off_px - 4 <= (SLOPE - abs(end)) * FOCAL_PX <= off_px + 8
        else:
            assert np.isinf(end)


def test_where_the_skin_is_on_the_surface_all_columns_count() -> None:
    for seed in range(5):
        ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
        rays, lines = block((0.0, 0.0), tilted_m=8e-6, seed=seed)
        assert not ends.look(rays, SURFACES, lines, PIXEL_M)
        assert ends.known
        assert ends.ends == (-np.inf, np.inf)


def test_an_end_is_known_once_it_was_seen() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays, lines = block((16.0, 16.0), seen=(-SLOPE, 0.5 * SLOPE))
    assert ends.look(rays, SURFACES, lines, PIXEL_M)
    assert not ends.known
    assert np.isfinite(ends.ends[0])
    assert np.isinf(ends.ends[1])
    rays, lines = block((16.0, 16.0), seen=(-0.5 * SLOPE, SLOPE))
    low = ends.ends[0]
    assert ends.look(rays, SURFACES, lines, PIXEL_M)
    assert ends.known
    assert ends.ends[0] == low
    assert np.isfinite(ends.ends[1])


def test_too_much_of_the_image_is_no_end() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays, lines = block((150.0, 0.0))
    ends.look(rays, SURFACES, lines, PIXEL_M)
    assert np.isinf(ends.ends).all()


def test_few_events_say_nothing() -> None:
    ends = PatchEnds((-SLOPE, SLOPE), FOCAL_PX)
    rays, lines = block((16.0, 16.0))
    assert not ends.look((rays[0][::40], rays[1][::40]), SURFACES, lines, PIXEL_M)
    assert not ends.known


def test_distances_beside_lines_are_those_of_a_plain_sum() -> None:
    rng = np.random.default_rng(3)
    n, low, per_bin, bins = 5000, -0.3 / PIXEL_M, 20 * PIXEL_M / 0.6, 20
    row, column = np.array(LINES).T
    offset = rng.uniform(-1e-4, 1e-4, len(row))
    near = _near(row, column, SHAPE)
    pixel = rng.integers(0, SHAPE[0] * SHAPE[1] + 1, n).astype(np.int32)
    slope = rng.uniform(-0.32, 0.32, n) / PIXEL_M
    x = pixel % SHAPE[1] + rng.uniform(-1.5, 1.5, n)
    rays = np.column_stack([x, np.zeros(n), slope, np.zeros(n)]).astype(np.float32)
    sums, counts = np.zeros(bins), np.zeros(bins, np.int64)
    _add_beside(rays, pixel, near, column, offset, _MOST_PX, low, per_bin, sums, counts)
    expected, number = np.zeros(bins), np.zeros(bins, int)
    for ray, at in zip(rays.astype(np.float64), pixel, strict=True):
        if at == SHAPE[0] * SHAPE[1]:
            continue
        own = [k for k in range(len(row)) if at // SHAPE[1] - row[k] in (0, 1)]
        own = [k for k in own if abs(at % SHAPE[1] - column[k]) <= 1]
        if not own:
            continue
        apart = ray[0] + ray[2] * offset[own[0]] - column[own[0]]
        bin_ = int(np.floor((ray[2] - low) * per_bin))
        if abs(apart) <= _MOST_PX and 0 <= bin_ < bins:
            expected[bin_] += apart
            number[bin_] += 1
    np.testing.assert_allclose(counts, number, atol=1)
    np.testing.assert_allclose(sums, expected, atol=2)
    assert counts.sum() > 500
