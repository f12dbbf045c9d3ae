"""Node `braille`: event packets and poses in, Braille cells and text out."""

from __future__ import annotations

import sys

from roller_ros.dds_profile import less_shared
from roller_ros.node_main import run_node
from roller_ros.priority import give_way
from roller_ros.stage_node import StageNode

from . import messages  # noqa: F401 (registers the messages of cells)
from .braille_stage import BrailleStage

#: A cell is read in half the time that its depth map takes: on busy cores depth goes first, so that
#: both come sooner. Of cores shared with other programs text still gets its part.
_NICE = 3


def main() -> None:
    """Run the node."""
    give_way(_NICE)
    sys.exit(run_node(less_shared(lambda: StageNode(BrailleStage))))
