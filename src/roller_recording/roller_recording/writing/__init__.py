"""Writing what a graph publishes, with an account of what was lost."""

from __future__ import annotations

from roller_core.bag_writer import BagWriter
from roller_recording.raw_message import RawMessage

from .losses import Losses, Progress
from .recorder import Recorder

__all__ = ["BagWriter", "Losses", "Progress", "RawMessage", "Recorder"]
