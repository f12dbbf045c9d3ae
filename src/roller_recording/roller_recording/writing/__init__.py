"""Writing what a graph publishes, with an account of what was lost."""

from __future__ import annotations

from .bag_writer import BagWriter
from .losses import Losses, Progress
from .raw_message import Taken
from .recorder import Recorder

__all__ = ["BagWriter", "Losses", "Progress", "Recorder", "Taken"]
