"""Panels of a picture: values lie where the axes say, and nothing leaves the frame."""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from roller_inspect.results.drawing import BLACK, BLUE, LIGHT, Panel, Picture, colours


def test_what_is_drawn_lies_at_its_values_within_the_frame(tmp_path: Path) -> None:
    picture = Picture(400, 300)
    panel = Panel(picture, (50, 40, 350, 240), (0, 30), (-10, 10), "title", "x, mm", "y, mm")
    panel.dots([15, 29.95, 100, -1], [0, 9.9, 0, 50])
    panel.dots([5], [5], LIGHT)
    panel.line([0, 30], [-5, -5])
    panel.line([10, 10], [-1e6, 1e6])
    panel.close()
    picture.save(tmp_path / "picture.png")
    seen = np.asarray(Image.open(tmp_path / "picture.png"))
    blue = np.argwhere((seen == BLUE).all(axis=-1))
    assert {(140, 200), (139, 199), (40, 349), (41, 349)} <= set(map(tuple, blue.tolist()))
    assert len(blue) <= 8
    light = np.argwhere((seen[40:240, 50:350] == LIGHT).all(axis=-1)).tolist()
    assert light == [[49, 49], [49, 50], [50, 49], [50, 50]]
    row, column = seen[40 + 149 : 40 + 151, 60:340], seen[50:230, 50 + 99 : 50 + 101]
    assert (row.min(axis=0) < 200).all()
    assert (column.min(axis=1) < 200).all()
    # Frame, ticks and letters, and nothing else, lie outside.
    assert (seen[39, 49:351] == BLACK).all()
    assert (seen[245:, 125] == 255).all()
    assert (seen[:39] < 128).any()


def test_equal_axes_have_one_scale() -> None:
    panel = Panel(Picture(400, 300), (50, 50, 350, 250), (0, 10), (20, 0), equal=True)
    assert (panel.width, panel.height) == (100, 200)
    (u0, v0), (u1, v1) = panel.places([0, 1], [0, 1])
    assert (u1 - u0, v1 - v0) == (10, 10)


def test_colours_go_either_way_and_leave_out_what_is_missing() -> None:
    chart = cv2.COLORMAP_VIRIDIS
    rgb = colours([0.0, 1.0, np.nan], 0.0, 1.0, chart)
    assert (rgb[2] == 255).all()
    assert (colours([1.0, 0.0], 1.0, 0.0, chart) == rgb[:2]).all()
    assert rgb[1, 0] > rgb[0, 0]


def test_labels_can_be_read_on_any_colour(tmp_path: Path) -> None:
    picture = Picture(200, 200)
    panel = Panel(picture, (0, 0, 200, 200), (0, 1), (0, 1))
    panel.rgb[:] = (0, 0, 80)
    panel.label(0.5, 0.5, "-272", "mm")
    panel.close()
    picture.save(tmp_path / "picture.png")
    seen = np.asarray(Image.open(tmp_path / "picture.png"))[80:120, 70:130]
    assert (seen == 255).all(axis=-1).any()
    assert (seen == 0).all(axis=-1).any()
