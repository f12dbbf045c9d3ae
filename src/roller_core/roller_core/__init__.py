"""Shared building blocks of the roller inspection packages; no ROS imports."""
