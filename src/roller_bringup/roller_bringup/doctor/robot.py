"""The robot: does its controller speak RTDE and have what the node asks for."""

from __future__ import annotations

from pathlib import Path

from roller_core.errors import SettingsError
from roller_core.settings import read_parameters
from roller_driver.ur10.errors import RobotFault
from roller_driver.ur10.receiver import VARIABLES
from roller_driver.ur10.robot_settings import Ur10Parameters
from roller_driver.ur10.rtde import PORT, Controller, ask_controller

from .result import Level, Result, ok, warning

_TIMEOUT_S = 1.5


def configured_address(parameters: Path) -> str:
    """Address in the robot's parameter file; empty where it has none but the default."""
    try:
        found = read_parameters(parameters, "ur10").get("robot_ip", "")
    except SettingsError:
        return ""
    return "" if found == Ur10Parameters.model_fields["robot_ip"].default else str(found)


def find_robot(
    host: str, port: int = PORT, timeout_s: float = _TIMEOUT_S
) -> Controller | RobotFault:
    """Shake hands with the controller; or what keeps one from that."""
    try:
        return ask_controller(host, VARIABLES, timeout_s, port)
    except RobotFault as fault:
        return fault


def judge_robot(
    found: Controller | RobotFault | None, host: str = "", asked: bool = False
) -> Result:
    """Whether poses will come; `found` is None where no robot was looked for."""
    name = "robot"
    if found is None:
        return warning(
            name, "not looked for", advice="give --robot-ip, or set robot_ip in config/ur10.yaml"
        )
    if isinstance(found, Controller):
        return ok(name, f"{host}: controller {found}")
    # The node's faults say what to do.
    text, _, advice = str(found).partition("; ")
    level: Level = "fault" if asked else "warning"
    return Result(name=name, level=level, found=text, advice=advice)
