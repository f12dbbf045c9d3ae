"""What can be wrong with the robot's controller, each with what to do about it."""

from __future__ import annotations

from roller_core.errors import RollerError


class RobotFault(RollerError):
    """Base of the robot's faults."""


class RobotUnreachableError(RobotFault):
    """Nothing answers at the robot's address."""


class ProtocolRefusedError(RobotFault):
    """What answers does not speak RTDE protocol version 2."""


class RobotLostError(RobotFault):
    """The controller closed the connection or fell silent."""


class OtherToolError(RobotFault):
    """The controller's tool centre point isn't the one that the camera's place was found with."""


class MissingLibraryError(RobotFault):
    """The robot's library is not installed."""
