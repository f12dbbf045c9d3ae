"""Entry points of the nodes, which take a second to load."""

from __future__ import annotations

from roller_core.signals import load_and_run


def virtual_cell() -> None:
    """Run node `virtual_cell`."""
    load_and_run("roller_sim.virtual_cell_node")
