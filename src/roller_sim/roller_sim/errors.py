"""Faults of the virtual cell."""

from __future__ import annotations

from roller_core.errors import RollerError


class VirtualCellError(RollerError):
    """The virtual cell can't be set up or run as asked."""


class UnknownSceneError(VirtualCellError):
    """A scene of this name doesn't exist."""


class SceneError(VirtualCellError):
    """A scene can't be built from the options given."""


class TruthError(VirtualCellError):
    """The known truth beside a recording is missing or can't be read."""
