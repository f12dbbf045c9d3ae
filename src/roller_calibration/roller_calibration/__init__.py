"""Calibration of the cell from recordings: algorithms without ROS, and their commands."""
