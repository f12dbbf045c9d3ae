"""What the paper on the neuromorphic roller, and others beside it, report; figures in µm and m/s.

They are of real sensors on printed objects. Ours stand beside them, from the virtual cell.
"""

from __future__ import annotations

#: Mean absolute error by depth method at 0.3 m/s.
FUSION_UM = {
    "emvs": {"stairs": 67.2, "sphere": 125.6, "sparse_sphere": 27.4},
    "left_right": {"stairs": 61.3, "sphere": 108.5, "sparse_sphere": 14.4},
    "bma": {"stairs": 58.1, "sphere": 94.6, "sparse_sphere": 12.0},
}
#: Mean and deviation over five passes at 0.3 m/s, bma.
OBJECTS_UM = {
    "sparse_sphere": (12.0, 1.0),
    "stairs": (58.1, 2.6),
    "bumps": (58.9, 2.4),
    "pyramid": (67.7, 5.8),
    "hexagon": (80.8, 4.2),
    "sphere": (94.6, 8.1),
}
OVERALL_UM = (62.0, 4.7)
#: By how much bma lowers the error of emvs on the sphere, by speed.
REDUCTION = {0.05: 0.0527, 0.3: 0.252, 0.5: 0.264}
#: Three and five reference views on the sphere.
VIEWS_UM = {"bma": (94.6, 8.1), "bma_5": (111.5, 6.5)}
#: Deviation of depth over three equal lines, 0.6 mm high.
LINES_UM = {"emvs": 67.0, "bma": 28.0}
LARGE_UM = {"line_array": (63.8, 5.5), "letter_plate": (59.6, 3.5)}
#: Sensors that roll: fastest speed and error; None where it isn't reported.
SENSORS: tuple[tuple[str, float | None, float | None], ...] = (
    ("GelBelt (2025)", 0.045, 13.5),
    ("GelRoller (2024)", None, 175.0),
    ("TouchRoller (2023)", 0.011, None),
    ("neuromorphic roller (the paper)", 0.5, 62.0),
)
#: Events to depth map of a 20 ms window, laptop with an i7-1365U, ms: mean and deviation.
WINDOW_MS = (377.41, 7.96)
#: Weights of start, middle and end found on each object, and their error over all three.
WEIGHTS = {
    "sphere": ((0.445, 0.333, 0.222), 54.9),
    "stairs": ((0.5, 0.333, 0.167), 65.2),
    "sparse_sphere": ((0.4, 0.4, 0.2), 64.9),
}
