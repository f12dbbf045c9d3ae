"""Recordings: reading and writing them, with the nodes that record and play."""
