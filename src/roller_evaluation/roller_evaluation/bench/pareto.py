"""Configurations that no other beats in both time and error."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Points that no other is as good as in both coordinates and better in one.

    Parameters
    ----------
    points : sequence of (float, float)
        Less is better.

    Returns
    -------
    list of int
        Their places in the sequence, by the first coordinate. Points that are equal to each
        other are all on the front or all off it.
    """
    order = sorted(range(len(points)), key=lambda k: points[k])
    front: list[int] = []
    for k in order:
        if not front or points[k][1] < points[front[-1]][1] or points[k] == points[front[-1]]:
            front.append(k)
    return front
