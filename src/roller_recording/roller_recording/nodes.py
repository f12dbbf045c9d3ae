"""Entry points of the nodes, which take a second to load."""

from __future__ import annotations

from roller_core.signals import load_and_run


def player() -> None:
    """Run node `player`."""
    load_and_run("roller_recording.player_node")


def recorder() -> None:
    """Run node `recorder`."""
    load_and_run("roller_recording.recorder_node")
