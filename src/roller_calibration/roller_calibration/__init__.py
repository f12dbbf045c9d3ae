"""Calibration from recordings; numerical code, no ROS."""

from .bidirectional import Scan, TimeOffsetError, central_events
from .camera_rotation import CameraTurn, TurnError, find_turn
from .constant_speed import UnsteadyError, steady_part
from .contact import (
    Box,
    ContactView,
    ContactWindow,
    KnownWindow,
    OffPatchError,
    Rolled,
    TrueDepth,
    contact_view,
    contact_windows,
    pass_points,
)
from .error_table import CoverageError, ErrorTable, Figures
from .flat import FlatError, FlatPlate, find_plate
from .focus_search import FocusGrid, focus_errors
from .hand_eye import HandEye, HandEyeError, find_hand_eye
from .paper_grid import PaperGrid, check_weights, simplex
from .paper_search import window_errors
from .scale import PAPER_MM_PER_PX, PAPER_READINGS, Scale, ScaleError, check_scale, scale_of
from .sphere import (
    ManySpheresError,
    NoSphereError,
    Sphere,
    SphereError,
    TooFewPointsError,
    WrongRadiusError,
    find_sphere,
)
from .time_offset import TimeOffset, estimate_time_offset

__all__ = [
    "PAPER_MM_PER_PX",
    "PAPER_READINGS",
    "Box",
    "CameraTurn",
    "ContactView",
    "ContactWindow",
    "CoverageError",
    "ErrorTable",
    "Figures",
    "FlatError",
    "FlatPlate",
    "FocusGrid",
    "HandEye",
    "HandEyeError",
    "KnownWindow",
    "ManySpheresError",
    "NoSphereError",
    "OffPatchError",
    "PaperGrid",
    "Rolled",
    "Scale",
    "ScaleError",
    "Scan",
    "Sphere",
    "SphereError",
    "TimeOffset",
    "TimeOffsetError",
    "TooFewPointsError",
    "TrueDepth",
    "TurnError",
    "UnsteadyError",
    "WrongRadiusError",
    "central_events",
    "check_scale",
    "check_weights",
    "contact_view",
    "contact_windows",
    "estimate_time_offset",
    "find_hand_eye",
    "find_plate",
    "find_sphere",
    "find_turn",
    "focus_errors",
    "pass_points",
    "scale_of",
    "simplex",
    "steady_part",
    "window_errors",
]
