"""What a stage holds doesn't grow with the scan."""

import gc
import sys
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

from roller_braille.braille_stage import BrailleStage
from roller_core.camera import Camera
from roller_core.event_stage import EventStage
from roller_core.events import EventArray
from roller_core.frame_transforms import Transform
from roller_core.stage import Stage
from roller_emvs.depth_stage import DepthStage
from roller_emvs.stitcher_stage import StitcherStage
from roller_emvs.surface_stage import SurfaceStage

CAMERA = Camera(160, 80, 400.0, 400.0, 79.5, 39.5)
UNIT = (0.0, 0.0, 0.0, 1.0)
#: A metre takes a second; this many events.
METRE_NS, EACH = 10**9, 400


def held_bytes(thing: object) -> int:
    """Size of an object and all that it holds but numbers, bytes."""
    seen: set[int] = set()
    size, waiting = 0, [thing]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, (type, ModuleType, FunctionType, int, float)):
            continue
        seen.add(id(one))
        size += one.nbytes if isinstance(one, np.ndarray) else sys.getsizeof(one)
        waiting += gc.get_referents(one)
    return size


def pose(at_ns: int, x: float) -> Transform:
    return Transform("base", "tool0_controller", at_ns, (x, 0.0, 0.0), UNIT)


def mounted(kind: type[Stage[Any]]) -> Stage[Any]:
    """A stage that knows where the camera is."""
    stage = kind(kind.model.create({}))
    stage.take_transform(
        Transform("tool0_controller", stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True)
    )
    return stage


def roll(stage: EventStage[Any, Any], metre: int, to_and_fro: bool) -> None:
    """A metre over noise."""
    random = np.random.default_rng(metre)
    begin = METRE_NS * (1 + metre)
    for k in range(125):
        x = metre + k * 8e-3
        if to_and_fro:
            x = 1.0 - k * 8e-3 if metre % 2 else k * 8e-3
        stage.take_transform(pose(begin + k * 8_000_000, x))
    t = np.sort(random.integers(begin, begin + METRE_NS, EACH))
    pixels = random.integers(0, 160, EACH), random.integers(0, 80, EACH)
    events = EventArray.from_arrays(*pixels, t, random.integers(0, 2, EACH))
    for part in range(0, EACH, 100):
        stage.take_events(events[part : part + 100])
        for _ in stage.results():
            pass


@pytest.mark.parametrize("to_and_fro", [True, False])
@pytest.mark.parametrize("kind", [DepthStage, SurfaceStage, BrailleStage])
def test_what_is_held_is_the_same_after_3_m_and_5(
    kind: type[EventStage[Any, Any]], to_and_fro: bool
) -> None:
    stage = mounted(kind)
    stage.take_camera(CAMERA)
    sizes = []
    for metre in range(5):
        roll(stage, metre, to_and_fro)
        if metre in (2, 4):
            sizes.append(held_bytes(stage))
    # The poses alone would be 9 kB a metre. Times of the last results are kept.
    assert sizes[1] - sizes[0] < 4_000, sizes


@pytest.mark.parametrize("missing", ["camera", "mounting", "events"])
@pytest.mark.parametrize("kind", [DepthStage, SurfaceStage, BrailleStage, StitcherStage])
def test_poses_that_nothing_needs_are_not_kept(
    kind: type[Stage[Any]], missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("roller_core.stage._MOST_POSES", 500)
    stage = kind(kind.model.create({})) if missing == "mounting" else mounted(kind)
    if missing != "camera":
        stage.take_camera(CAMERA)
    sizes = []
    for k in range(5000):
        stage.take_transform(pose(METRE_NS + k * 8_000_000, 8e-4 * min(k % 500, 500 - k % 500)))
        if k % 100 == 99:
            for _ in stage.results():
                pass
        if k in (2999, 4999):
            sizes.append(held_bytes(stage))
    assert sizes[1] - sizes[0] < 4_000, sizes
