"""Depth maps from events, their fusion and the stitched surface."""
