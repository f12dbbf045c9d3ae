"""Poses of a UR controller over RTDE; knows nothing of ROS."""
