"""Node `surface`: event packets and poses in, points of the surface out."""

from __future__ import annotations

import sys

from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode

from .surface_stage import SurfaceStage


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: StageNode(SurfaceStage)))
