"""Drivers of the roller cell: event camera, UR10 poses and the virtual cell."""
