"""What the demonstration says of its part."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from roller_bringup.demo_inspection import MOST_DEPTH_M, defect_table, write_recipe
from roller_inspect.findings import Finding, Uncertainty
from roller_inspect.recipe import load_recipe
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.scenes import PART_DEFECTS, build_scene


def found(number: int, at: tuple[float, float], depth_m: float) -> Any:
    """A finding of 2 mm, judged."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 1e-3
    middle = np.array([*at, 0.0])
    finding = Finding(
        id=number, kind="dent", center_m=middle, length_m=2e-3, width_m=2e-3, depth_m=depth_m,
        area_m2=4e-6, volume_m3=1e-10, confidence=1.0, outline_m=corners + middle, points=9,
        uncertainty=Uncertainty(1e-4, 1e-4, 1e-4, 2e-5, 1e-7, 1e-11), measured=1.0,
        cues=("height",), final=True,
    )  # fmt: skip
    return SimpleNamespace(finding=finding, verdict="nonconform")


def test_the_face_is_inspected_and_findings_stand_beside_the_defects(tmp_path: Path) -> None:
    scene = build_scene(VirtualCellSettings.create({"scene": {"name": "part"}}, "test").scene)
    (face,) = (region for region in scene.regions if region.name == "face")
    assert len(scene.defects) == len(PART_DEFECTS)
    for mark in scene.defects:
        assert face.contains(*np.array(mark.outline).T).all()
    write_recipe(face, tmp_path / "recipe.yaml")
    recipe = load_recipe(tmp_path / "recipe.yaml")
    assert recipe.inspect == ("face",)
    assert recipe.depth_tolerance_m == MOST_DEPTH_M
    first = scene.defects[0]
    judged = (found(7, (first.x + 0.1, first.y), -1.9e-4), found(8, (0.15, 0.0), 1e-4))
    truth: Any = SimpleNamespace(origin_m=np.array([0.1, 0.0, 0.0]), defects=scene.defects)
    inspected: Any = SimpleNamespace(judgement=SimpleNamespace(findings=judged))
    rows = defect_table(inspected, truth)[2:]
    assert rows[0].split() == ["dent_1", "-200", "-190", "±", "20", "dent", "nonconform"]
    assert all(row.endswith("not found") for row in rows[1:-1])
    assert rows[-1] == "found where there is none: 1"
