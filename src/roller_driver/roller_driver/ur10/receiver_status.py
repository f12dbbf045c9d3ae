"""How a robot's receiver is, and what the controller says of its safety."""

from __future__ import annotations

from dataclasses import dataclass

from .rtde import Controller

SEARCHING = "searching"
RECEIVING = "receiving"
STOPPED = "stopped"

_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle",
    6: "backdrive",
    7: "running",
    8: "updating firmware",
}
_SAFETY_MODES = {
    1: "normal",
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "robot emergency stop",
    8: "violation",
    9: "fault",
    10: "validate joint id",
    11: "undefined",
    12: "automatic mode safeguard stop",
    13: "three-position enabling stop",
}
_RUNNING_SAFELY = (1, 2)


@dataclass(slots=True)
class ReceiverStatus:
    """How the receiver is."""

    #: `searching`, `receiving` or `stopped`.
    state: str = STOPPED
    #: What keeps it from receiving, or ended it last time; empty: nothing.
    fault: str = ""
    #: Who answered.
    controller: Controller | None = None
    #: Connections made; samples received.
    connects: int = 0
    samples: int = 0
    #: Samples that never came, by the steps of the controller's clock.
    missed: int = 0
    #: Times that samples were missed in a row, or one was.
    gaps: int = 0
    #: Longest step of the controller's clock from sample to sample, s.
    longest_gap_s: float = 0.0
    #: Reads repeated because a new sample came in the middle.
    torn: int = 0
    #: Samples left out because their pose or velocity was no number.
    not_finite: int = 0
    #: Times that the controller's clock went back.
    steps_back: int = 0
    #: As the controller reports them; 0 and None before it does.
    safety_mode: int = 0
    robot_mode: int | None = None

    @property
    def mode(self) -> str:
        """The robot's mode in words."""
        return "" if self.robot_mode is None else _MODES.get(self.robot_mode, "not known")

    @property
    def safety(self) -> str:
        """The safety mode in words."""
        return _SAFETY_MODES.get(self.safety_mode, "not known")

    @property
    def stopped_for_safety(self) -> bool:
        """Whether the robot stands for safety's sake."""
        return self.safety_mode not in (0, *_RUNNING_SAFELY)
