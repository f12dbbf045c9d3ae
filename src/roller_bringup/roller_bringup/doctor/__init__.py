"""`roller doctor`: is this machine ready for the cell, and what to do where it isn't.

Each check has two halves: `find_…` looks, `judge_…` makes a `Result` of what was found and is a
pure function.
"""
