"""Entry points of the nodes, which take a second to load."""

from __future__ import annotations

from roller_core.signals import load_and_run


def emvs() -> None:
    """Run node `emvs`."""
    load_and_run("roller_emvs.emvs_node")


def stitcher() -> None:
    """Run node `stitcher`."""
    load_and_run("roller_emvs.stitcher_node")


def surface() -> None:
    """Run node `surface`."""
    load_and_run("roller_emvs.surface_node")
