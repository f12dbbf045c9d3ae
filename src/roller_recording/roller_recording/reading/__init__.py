"""Recordings that can be replayed, behind one interface."""

from __future__ import annotations

from .base import Recording, RecordingError, Step
from .open import open_recording

__all__ = ["Recording", "RecordingError", "Step", "open_recording"]
