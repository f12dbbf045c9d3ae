"""Entry points of the nodes, which take a second to load."""

from __future__ import annotations

from roller_core.signals import load_and_run


def inspect() -> None:
    """Run node `inspect`."""
    load_and_run("roller_inspect.inspect_node")
