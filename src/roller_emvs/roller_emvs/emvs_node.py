"""Node `emvs`: event packets and poses in, depth maps out."""

from __future__ import annotations

import sys

from roller_ros.dds_profile import less_shared
from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode

from .depth_stage import DepthStage

#: Four depth maps of 640×480 px, each of three images; one of 1280×720.
_SHARED_BYTES = 16 << 20


def main() -> None:
    """Run the node."""
    sys.exit(run_node(less_shared(lambda: StageNode(DepthStage), _SHARED_BYTES)))
