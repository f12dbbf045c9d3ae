"""Rows of the surface that are done."""

from __future__ import annotations

from dataclasses import dataclass, field

from roller_core.window_account import WindowAccount
from roller_emvs.patch import Patch


@dataclass(frozen=True)
class SurfacePatch(Patch):
    """Rows of the surface that are done, and the account of how they came about."""

    #: Times of the rows' first and last event, ROS time.
    start_ns: int = 0
    end_ns: int = 0
    #: Their number, each counted in one patch.
    events: int = 0
    #: Time by stage, ms.
    milliseconds: dict[str, float] = field(default_factory=dict)
    #: Processor time of all threads of the process meanwhile, ms; 0 where it isn't known.
    cpu_ms: float = 0.0
    #: The same by stage.
    stage_cpu_ms: dict[str, float] = field(default_factory=dict)
    #: Whether edges lie everywhere, as under a printed skin.
    textured: bool = False

    @property
    def stamp_ns(self) -> int:
        """Middle of the time in which the rows were in view."""
        return (self.start_ns + self.end_ns) // 2

    @property
    def account(self) -> WindowAccount:
        """Counts and times beside the points."""
        return WindowAccount(
            self.start_ns, self.end_ns, self.events, len(self), self.milliseconds, self.cpu_ms
        )
