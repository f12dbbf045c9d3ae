"""Entry points of the nodes, which take a second to load."""

from __future__ import annotations

from roller_core.signals import load_and_run


def event_camera() -> None:
    """Run node `event_camera`."""
    load_and_run("roller_driver.event_camera_node")


def ur10() -> None:
    """Run node `ur10`."""
    load_and_run("roller_driver.ur10_node")
