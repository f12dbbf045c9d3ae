"""Node `emvs`: event packets and poses in, depth maps out."""

from __future__ import annotations

import sys

from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode

from .depth_stage import DepthStage


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: StageNode(DepthStage)))
