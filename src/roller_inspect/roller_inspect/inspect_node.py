"""Node `inspect`: points of the surface in, findings and a verdict out."""

from __future__ import annotations

import sys

from roller_ros.node_main import run_node
from roller_ros.priority import give_way
from roller_ros.stage_node import StageNode

from . import messages  # noqa: F401 (registers the messages of findings)
from .inspect_stage import InspectStage

#: What is found before the part's end is provisional: on busy cores depth and text go first.
_NICE = 10


def main() -> None:
    """Run the node."""
    give_way(_NICE)
    sys.exit(run_node(lambda: StageNode(InspectStage)))
