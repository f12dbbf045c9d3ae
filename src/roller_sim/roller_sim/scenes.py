"""Scenes by name."""

from __future__ import annotations

from collections.abc import Callable

from .braille import put_braille, text_size_mm
from .cell_settings import SceneSettings
from .defects import ACROSS, PITCH_ACROSS, clean, defects, put_defect
from .errors import UnknownSceneError
from .mesh import mesh_scene
from .objects import LENGTHS, OBJECTS, put_sphere, put_stairs
from .plates import letter_plate, line_array, new_plate, rivet_bent, rivet_flush, three_lines
from .relief import Scene

#: Press depth of plates with one object: the plate's face is at R less this.
PRESS_MM = 2.0
DEMO_PRESS_MM = 1.8
#: Gauges of `roller calibrate edge-drift`, none of which is among the objects: a sphere's radius
#: and height, a step's height and length, and how many steps go up.
GAUGE_SPHERE_MM = 5.0, 1.5
GAUGE_STEPS_MM, GAUGE_STEPS = (0.25, 1.6), 4
DEMO_GAP_MM = 2.5
DEMO_TEXT_GAP_MM = 4.0
DEMO_TEXT = "roller"
#: The part that `roller demo` inspects: relief beside its text, and on its face defects (kind,
#: place along and across from the face's begin and middle, length, width, depth, angle).
PART_RELIEF = "stairs", "pyramid"
PART_FACE_MM = 16.0
PART_DEFECTS = (
    ("dent", 4.0, -6.0, 3.0, 3.0, 0.2, 0.0),
    ("missing", 4.0, 0.0, 2.5, 2.0, 0.28, 20.0),
    ("raised", 4.0, 6.0, 3.0, 2.5, 0.1, 0.0),
    ("crater", 12.0, -5.5, 3.5, 3.5, 0.3, 0.0),
    ("extra", 12.0, 0.5, 2.0, 2.0, 0.15, 0.0),
    ("dent", 12.0, 6.0, 2.5, 2.5, 0.07, 0.0),
)
BRAILLE_TEXT = "roller 42"
_MESH = "mesh:"


def _single(name: str) -> Callable[[SceneSettings], Scene]:
    def build(settings: SceneSettings) -> Scene:
        plate = new_plate(settings, LENGTHS[name])
        OBJECTS[name](plate, settings.margin_mm)
        return plate.scene(name, PRESS_MM)

    return build


def _gauge_sphere(settings: SceneSettings) -> Scene:
    radius, height = GAUGE_SPHERE_MM
    plate = new_plate(settings, 2 * radius)
    put_sphere(plate, settings.margin_mm, radius, height)
    return plate.scene("gauge_sphere", PRESS_MM)


def _gauge_steps(settings: SceneSettings) -> Scene:
    rise, tread = GAUGE_STEPS_MM
    plate = new_plate(settings, (2 * GAUGE_STEPS - 1) * tread)
    put_stairs(plate, settings.margin_mm, rise, tread, GAUGE_STEPS)
    return plate.scene("gauge_steps", PRESS_MM)


def _flat(settings: SceneSettings) -> Scene:
    return new_plate(settings, 20.0).scene("flat", PRESS_MM)


def _braille(settings: SceneSettings) -> Scene:
    text = settings.text or BRAILLE_TEXT
    plate = new_plate(settings, text_size_mm(text, settings)[0])
    text = put_braille(plate, text, settings.margin_mm, settings)
    return plate.scene("braille", DEMO_PRESS_MM, text)


def _demo(settings: SceneSettings) -> Scene:
    """A line of Braille, then the six objects one after the other."""
    text = settings.text or DEMO_TEXT
    line = text_size_mm(text, settings)[0]
    gaps = DEMO_TEXT_GAP_MM + DEMO_GAP_MM * (len(OBJECTS) - 1)
    plate = new_plate(settings, line + sum(LENGTHS.values()) + gaps)
    text = put_braille(plate, text, settings.margin_mm, settings)
    x = settings.margin_mm + line + DEMO_TEXT_GAP_MM
    for name, put in OBJECTS.items():
        put(plate, x)
        x += LENGTHS[name] + DEMO_GAP_MM
    return plate.scene("demo", DEMO_PRESS_MM, text)


def _part(settings: SceneSettings) -> Scene:
    """A line of Braille, relief, and a plain face with defects: the region `face`."""
    text = settings.text or DEMO_TEXT
    line = text_size_mm(text, settings)[0]
    relief = sum(LENGTHS[name] + DEMO_GAP_MM for name in PART_RELIEF)
    plate = new_plate(settings, line + DEMO_TEXT_GAP_MM + relief + PART_FACE_MM)
    text = put_braille(plate, text, settings.margin_mm, settings)
    x = settings.margin_mm + line + DEMO_TEXT_GAP_MM
    for name in PART_RELIEF:
        OBJECTS[name](plate, x)
        x += LENGTHS[name] + DEMO_GAP_MM
    half = min(PITCH_ACROSS * ACROSS, settings.width_mm) / 2
    plate.put("face", (x, x + PART_FACE_MM, -half, half), lambda x, y: 0.0)
    for i, (kind, along, across, length, width, depth, angle) in enumerate(PART_DEFECTS):
        name, at = f"{kind}_{i + 1}", (x + along, across)
        put_defect(plate, name, kind, at, (length, width), depth, angle)
    return plate.scene("part", DEMO_PRESS_MM, text)


SCENES: dict[str, Callable[[SceneSettings], Scene]] = {
    "demo": _demo,
    "part": _part,
    "braille": _braille,
    **{name: _single(name) for name in OBJECTS},
    "line_array": line_array,
    "three_lines": three_lines,
    "letter_plate": letter_plate,
    "rivet_flush": rivet_flush,
    "rivet_bent": rivet_bent,
    "defects": defects,
    "clean": clean,
    "flat": _flat,
    "gauge_sphere": _gauge_sphere,
    "gauge_steps": _gauge_steps,
}


def build_scene(settings: SceneSettings) -> Scene:
    """Build the scene that the settings name.

    Raises
    ------
    UnknownSceneError
        If there is no such scene; the message lists the names.
    SceneError
        If its options make no sense.
    """
    if settings.name.startswith(_MESH):
        return mesh_scene(settings.name[len(_MESH) :], settings)
    if settings.name not in SCENES:
        raise UnknownSceneError(
            f"no scene '{settings.name}'; there are {', '.join(SCENES)} and mesh:FILE.stl"
        )
    return SCENES[settings.name](settings)
