"""Named errors of poses."""

from __future__ import annotations

from .errors import RollerError


class PoseError(RollerError):
    """A pose that can't be had or used."""


class NoPosesError(PoseError):
    """The track holds no pose at all."""


class PoseExtrapolationError(PoseError):
    """A time before the first or after the last pose."""


class PoseGapError(PoseError):
    """A time between two poses that lie too far apart."""


class PoseOrderError(PoseError):
    """A pose older than the newest one: time ran backwards by `behind_s` seconds."""

    behind_s: float = 0.0

    @classmethod
    def between(cls, t_ns: int, newest_ns: int) -> PoseOrderError:
        """The error for a pose at `t_ns` after one at `newest_ns`."""
        behind = (newest_ns - t_ns) * 1e-9
        error = cls(
            f"pose at {t_ns * 1e-9:.6f} s is {behind:.6f} s older than the one before it; "
            "time runs backwards, check the clock of the pose source"
        )
        error.behind_s = behind
        return error


class PoseJumpError(PoseError):
    """A pose further from the one before it than any arm moves in the time."""


class PoseValueError(PoseError):
    """A pose that is not finite, lies farther off than any robot or has no valid rotation."""
