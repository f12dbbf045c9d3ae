"""Cells that hang together: what two of them share, wherever their windows lie."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roller_inspect.findings.components import Component


@st.composite
def components(draw: st.DrawFn) -> Component:
    top, left = draw(st.integers(-3, 12)), draw(st.integers(-3, 12))
    height, width = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    cells = np.random.default_rng(draw(st.integers(0, 999))).random((height, width)) < 0.6
    cells[0, 0] = True
    return Component(slice(top, top + height), slice(left, left + width), cells, -1)


def on_map(component: Component) -> np.ndarray:
    out = np.zeros((30, 30), bool)
    rows, columns = (np.arange(s.start, s.stop) + 3 for s in (component.rows, component.columns))
    out[np.ix_(rows, columns)] = component.mask
    return out


@given(components(), components())
def test_what_two_share_are_the_cells_of_both(one: Component, other: Component) -> None:
    both = on_map(one) & on_map(other)
    assert one.shared(other) == other.shared(one) == both.sum()
    assert one.share_in(other) == both.sum() / one.mask.sum()


@given(components())
def test_a_component_holds_its_cells_and_all_of_itself(one: Component) -> None:
    row, column = np.argwhere(one.mask)[-1] + [one.rows.start, one.columns.start]
    assert one.holds(int(row), int(column))
    assert not one.holds(one.rows.stop, one.columns.stop)
    assert one.share_in(one.grown(2)) == 1
