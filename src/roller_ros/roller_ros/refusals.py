"""What ROS refuses of what it was given by people, in a line."""

from __future__ import annotations

import os

import rclpy
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.signals import SignalHandlerOptions

from roller_core.errors import RollerError

from .shared_memory import check_shared_memory

_MOST_TEXT = 250


class RosArgumentsError(RollerError):
    """Arguments behind `--ros-args` that ROS can't read."""


def init_ros(args: list[str] | None = None, context: Context | None = None) -> None:
    """Start rclpy, without its handling of signals.

    Parameters
    ----------
    args : list of str, optional
        Its arguments; those of the command line if not given.
    context : Context, optional
        What is started; the process's own if not given.

    Raises
    ------
    RosArgumentsError
        If it can't read them, or a parameter file that they name.
    SharedMemoryError
        If nodes would wait for shared memory that was left half made.
    """
    check_shared_memory()
    # Else ROS's layer over Fast DDS sets aside what the profile says of memory.
    os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")
    try:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except _rclpy.UnknownROSArgsError as error:
        raise RosArgumentsError(f"there are no such --ros-args: {error}") from error
    except _rclpy.RCLError as error:
        raise RosArgumentsError(_in_short(error)) from error


def refused_name(error: Exception) -> str:
    """Why ROS refuses the name of a node, a namespace, a topic; empty: it is another error."""
    too_long = isinstance(error, _rclpy.RCLError) and "should not exceed" in str(error)
    return _in_short(error) if too_long or isinstance(error, NameValidationException) else ""


def _in_short(error: Exception) -> str:
    """The text without the places in the source of ROS that follow."""
    text = " ".join(str(error).split()).split(", at /")[0].rstrip("^ ")
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}..."
