"""Thin helpers between ROS 2 and the roller packages."""
