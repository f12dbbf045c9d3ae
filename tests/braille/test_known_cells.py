"""Cells are known again by their place, however many there are, and the oldest are forgotten."""

import numpy as np

from roller_braille.known_cells import KnownCells

REACH_M = 0.05


def test_those_near_are_those_near_among_all() -> None:
    random = np.random.default_rng(3)
    places = random.uniform(-0.3, 0.3, (500, 3))
    known = KnownCells(REACH_M, 1000)
    for number, place in enumerate(places):
        assert known.add(place, number, 2 * number) is None
    for at in random.uniform(-0.3, 0.3, (50, 3)):
        numbers, found = known.near(at)
        np.testing.assert_array_equal(found, places[numbers])
        away = np.linalg.norm(places - at, axis=1)
        assert set(np.flatnonzero(away < REACH_M)) <= set(numbers) == set(sorted(numbers))
        assert away[numbers].max(initial=0.0) < 4 * REACH_M
    assert known.where(7) == (7, 14)


def test_beyond_a_number_the_oldest_are_forgotten() -> None:
    known = KnownCells(REACH_M, 100)
    places = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 250)
    gone = [known.add(place, 0, n) for n, place in enumerate(places)]
    assert gone == 100 * [None] + [(0, n) for n in range(150)]
    assert known.near(places[149])[0][:1] == [150]
    assert known.near(places[0])[0] == []
    assert known.where(249) == (0, 249)
