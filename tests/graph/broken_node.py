"""A node whose worker dies of what `BROKEN_NODE` names."""

import builtins
import os
import sys
from typing import Any, NoReturn

from roller_emvs.depth_stage import DepthStage
from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode


class Broken(DepthStage):
    """Takes no packet."""

    def warm_up(self) -> None:
        """Need no kernels."""

    def take_packet(self, packet: Any) -> NoReturn:
        """Fail."""
        raise getattr(builtins, os.environ["BROKEN_NODE"])("not\nforeseen")


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: StageNode(Broken)))
