"""Calibration from recordings; numerical code, no ROS."""

from .time_offset import Scan, TimeOffset, TimeOffsetError, central_events, estimate_time_offset

__all__ = ["Scan", "TimeOffset", "TimeOffsetError", "central_events", "estimate_time_offset"]
