"""The row of depth maps in the picture of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import Reader

from roller_core.bags import typestore
from roller_core.outputs import DEPTH_IMAGE, bag_topic, stamp_ns
from roller_sim.truth import Truth

from .drawing import Panel, Picture, colours, scale_bar
from .layout import SCALE, columns, limits

F64 = npt.NDArray[np.float64]

_CHART = cv2.COLORMAP_TURBO


def chosen_stamps(report: dict[str, Any]) -> list[int]:
    """The depth maps with most points of up to three stretches of the run."""
    if report["method"] == "surface":
        return []
    windows = [w for w in report["windows"] if w["points"]]
    most = max((w["points"] for w in windows), default=0)
    windows = [w for w in windows if w["points"] > 0.1 * most]
    chosen = []
    for part in np.array_split(np.arange(len(windows)), 3):
        if len(part):
            best = max((windows[k] for k in part), key=lambda w: w["points"])
            chosen.append(int(best["stamp_ns"]))
    return chosen


def draw_depths(
    picture: Picture,
    top: int,
    height: int,
    bag: Path,
    stamps: list[int],
    truth: Truth | None,
    delay_ns: int,
) -> None:
    """Draw the depth maps of some stamps beside each other, with what they err by.

    Parameters
    ----------
    picture : Picture
        The picture.
    top, height : int
        Of the row, px.
    bag : path
        Where the depth images are.
    stamps : list of int
        Theirs, ns.
    truth : Truth or None
        Of a simulated scan.
    delay_ns : int
        By which event stamps are late still.
    """
    images = _depth_images(bag, set(stamps))
    stamps = [stamp for stamp in stamps if stamp in images]  # a full disk has the first alone
    measured = [i[np.isfinite(i)].astype(np.float64) for i in images.values()]
    low, high = (1e3 * end for end in limits(np.concatenate(measured) if measured else np.empty(0)))
    for n, (stamp, (left, right)) in enumerate(zip(stamps, columns([1, 1, 1]), strict=False)):
        rows, width = images[stamp].shape
        title = f"depth at {(stamp - stamps[0]) * 1e-9:+.3f} s"
        if truth is not None:
            error = _error_um(images[stamp], stamp, truth, delay_ns)
            if len(error):
                title += f", error {np.abs(error).mean():.0f} µm"
        panel = Panel(
            picture, (left, top, right, top + height), (0, width), (rows, 0), title, "u, px",
            "" if n else "v, px", equal=True,
        )  # fmt: skip
        # Near is red, as it is high.
        rgb = colours(_thick(images[stamp] * 1e3), high, low, _CHART)
        panel.rgb[:] = cv2.resize(rgb, (panel.width, panel.height), interpolation=cv2.INTER_AREA)
        panel.close()
    if images:
        box = (SCALE[0], top, SCALE[1], top + height)
        scale_bar(picture, box, low, high, _CHART, "depth, mm", falls=True)


def _thick(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Points two pixels wide, so that a semi-dense map can be seen when scaled down."""
    out = image.copy()
    for shift in ((0, 1), (1, 0), (1, 1)):
        moved = np.full_like(image, np.nan)
        moved[shift[0] :, shift[1] :] = image[
            : image.shape[0] - shift[0], : image.shape[1] - shift[1]
        ]
        out = np.where(np.isnan(out), moved, out)
    return out


def _depth_images(bag: Path, stamps: set[int]) -> dict[int, npt.NDArray[np.float32]]:
    store, found, topic = typestore(), {}, bag_topic(DEPTH_IMAGE)
    with Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.topic == topic]
        for connection, _, data in reader.messages(wanted):
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            stamp = stamp_ns(message)
            if stamp in stamps:
                pixels = np.frombuffer(message.data, np.float32)
                found[stamp] = pixels.reshape(message.height, message.width)
    return found


def _error_um(depth: npt.NDArray[np.float32], stamp: int, truth: Truth, delay_ns: int) -> F64:
    v, u = np.nonzero(np.isfinite(depth))
    pixels = np.stack([u, v], axis=-1)
    # Stamps are later than what caused the events by a known delay, as in `truth.py`.
    seen_ns = stamp - delay_ns
    seen, contact = truth.seen_at(seen_ns, pixels)
    return np.asarray((depth[v, u] - seen)[contact] * 1e6)
