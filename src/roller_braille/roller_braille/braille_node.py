"""Node `braille`: event packets and poses in, Braille cells and text out."""

from __future__ import annotations

import sys

from roller_ros.node_main import run_node
from roller_ros.stage_node import StageNode

from . import messages  # noqa: F401 (registers the messages of cells)
from .braille_stage import BrailleStage


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: StageNode(BrailleStage)))
