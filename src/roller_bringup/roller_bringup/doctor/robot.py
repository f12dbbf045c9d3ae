"""The robot: does its controller speak RTDE and have what the node asks for."""

from __future__ import annotations

from pathlib import Path

from roller_core.errors import SettingsError
from roller_core.parameter_files import read_parameters
from roller_driver.ur10.errors import RobotFault
from roller_driver.ur10.receiver import VARIABLES
from roller_driver.ur10.robot_settings import Ur10Parameters
from roller_driver.ur10.rtde import PORT, ask_controller

from .result import Result, ok, warning

_TIMEOUT_S = 1.5


def configured_address(parameters: Path) -> str:
    """Address in the robot's parameter file; empty where it has none but the default."""
    try:
        found = read_parameters(parameters, "ur10").get("robot_ip", "")
    except SettingsError:
        return ""
    return "" if found == Ur10Parameters.model_fields["robot_ip"].default else str(found)


def check_robot(
    host: str, asked: bool = False, port: int = PORT, timeout_s: float = _TIMEOUT_S
) -> Result:
    """Shake hands with the controller, if there is an address."""
    if not host:
        advice = "give --robot-ip, or set robot_ip in config/ur10.yaml"
        return warning("robot", "not looked for", advice)
    try:
        return ok("robot", f"{host}: controller {ask_controller(host, VARIABLES, timeout_s, port)}")
    except RobotFault as error:
        # The node's faults say what to do.
        text, _, advice = str(error).partition("; ")
        return Result("robot", "fault" if asked else "warning", text, advice)
