"""What a stage holds doesn't grow with the scan."""

from __future__ import annotations

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
from roller_core.sensor_pose import Transform
from roller_emvs.depth_stage import DepthStage
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


def roll(stage: EventStage[Any, Any], metre: int) -> None:
    """A pass of a metre over noise, every other one back."""
    random = np.random.default_rng(metre)
    begin = METRE_NS * (1 + metre)
    for k in range(125):
        at = begin + k * 8_000_000
        place = (1.0 - k * 8e-3 if metre % 2 else k * 8e-3, 0.0, 0.0)
        stage.take_transform(Transform("base", "tool0_controller", at, place, UNIT))
    t = np.sort(random.integers(begin, begin + METRE_NS, EACH))
    pixels = random.integers(0, 160, EACH), random.integers(0, 80, EACH)
    events = EventArray.from_arrays(*pixels, t, random.integers(0, 2, EACH))
    for part in range(0, EACH, 100):
        stage.take_events(events[part : part + 100])
        for _ in stage.results():
            pass


@pytest.mark.parametrize("kind", [DepthStage, SurfaceStage, BrailleStage])
def test_what_is_held_is_the_same_after_3_m_and_5(kind: type[EventStage[Any, Any]]) -> None:
    stage = kind(kind.model.create({}))
    hand_eye = Transform("tool0_controller", stage.settings.sensor_frame, 0, (0, 0, 0), UNIT, True)
    stage.take_transform(hand_eye)
    stage.take_camera(CAMERA)
    sizes = []
    for metre in range(5):
        roll(stage, metre)
        sizes.append(held_bytes(stage))
    # The poses alone would be 9 kB a metre. Times of the last results are kept.
    assert sizes[4] - sizes[2] < 8_000, sizes
