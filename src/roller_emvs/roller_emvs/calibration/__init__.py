"""Calibration from recordings; numerical code, no ROS."""

from .time_offset import TimeOffset, estimate_time_offset
from .to_and_fro import Scan, TimeOffsetError, central_events

__all__ = ["Scan", "TimeOffset", "TimeOffsetError", "central_events", "estimate_time_offset"]
