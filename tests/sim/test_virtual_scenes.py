import cv2
import numpy as np
import pytest

from roller_sim.braille import NUMBER_SIGN, to_cells
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import SceneSettings, SkinSettings, VirtualCellSettings
from roller_sim.errors import SceneError, UnknownSceneError
from roller_sim.objects import LENGTHS
from roller_sim.scenes import SCENES, build_scene
from roller_sim.skin import skin_over


def scene(name, **values):
    return build_scene(SceneSettings.create({"name": name, **values}))


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_stays_within_the_contact_depths(name):
    made = scene(name, step_mm=0.05)
    lowest, highest = float(made.relief.height.min()), float(made.relief.height.max())
    assert 47e-3 - made.press_mm * 1e-3 - highest >= 43e-3
    assert 47e-3 - made.press_mm * 1e-3 - lowest <= 47e-3
    x0, x1, y0, y1 = made.relief.bounds
    for region in made.regions:
        assert x0 <= region.x0 < region.x1 <= x1 + 1e-9
        assert y0 <= region.y0 < region.y1 <= y1 + 1e-9
    border = np.concatenate([made.relief.height[:, 0], made.relief.height[:, -1]])
    assert not border.any()


def test_an_unknown_scene_lists_the_known_ones():
    with pytest.raises(UnknownSceneError, match=r"no scene 'cube'; there are demo, part.*mesh:"):
        scene("cube")


def test_sphere_is_a_cap_of_4_mm_radius():
    made = scene("sphere")
    (region,) = made.regions
    middle = (region.x0 + region.x1) / 2
    for r in (0.0, 0.5e-3, 1.5e-3, 2.5e-3):
        expected = np.sqrt(4e-3**2 - r**2) - 2.5e-3
        assert made.relief.sample(middle + r, 0.0) == pytest.approx(expected, abs=1e-5)
        assert made.relief.sample(middle, -r) == pytest.approx(expected, abs=1e-5)
    assert region.x1 - region.x0 == pytest.approx(LENGTHS["sphere"] * 1e-3)


def test_stairs_go_up_and_down_in_equal_steps():
    made = scene("stairs")
    treads = made.regions[0].x0 + 1.1e-3 * (np.arange(9) + 0.5)
    expected = 0.2e-3 * np.array([1, 2, 3, 4, 5, 4, 3, 2, 1])
    np.testing.assert_allclose(made.relief.sample(treads, 3e-3), expected, atol=1e-9)


def test_rings_step_down_along_a_sphere():
    made = scene("sparse_sphere")
    middle = made.regions[0].x0 + 4.6e-3
    radii = (np.arange(5) + 0.5) * 0.92e-3
    heights = made.relief.sample(middle + radii, 0.0)
    ball = (4.6e-3**2 + 1.4e-3**2) / (2 * 1.4e-3)
    expected = np.sqrt(ball**2 - (np.arange(5) * 0.92e-3) ** 2) - (ball - 1.4e-3)
    np.testing.assert_allclose(heights, expected, atol=1e-6)


def test_hexagon_has_a_recess():
    made = scene("hexagon")
    middle = made.regions[0].x0 + 4.8e-3
    assert made.relief.sample(middle, 0.0) == pytest.approx(0.5e-3)
    assert made.relief.sample(middle, 3.5e-3) == pytest.approx(0.9e-3)
    assert made.relief.sample(middle + 4.7e-3, 1e-3) == 0.0


def test_bumps_are_half_cylinders():
    made = scene("bumps")
    x = made.regions[0].x0 + 0.4e-3
    assert made.relief.sample(x, 5e-3) == pytest.approx(0.4e-3, abs=1e-5)
    assert made.relief.sample(x + 0.3e-3, 0.0) == pytest.approx(np.sqrt(0.07) * 1e-3, abs=1e-5)


def test_pyramid_has_five_steps():
    made = scene("pyramid")
    middle = made.regions[0].x0 + 5e-3
    at = np.array([4.5, 3.5, 2.5, 1.5, 0.5]) * 1e-3
    expected = 0.25e-3 * np.arange(1, 6)
    np.testing.assert_allclose(made.relief.sample(middle + at, 0.0), expected, atol=1e-9)
    np.testing.assert_allclose(made.relief.sample(middle, at), expected, atol=1e-9)


def test_line_arrays():
    made = scene("line_array")
    for i, region in enumerate(made.regions):
        middle = (region.x0 + region.x1) / 2
        assert made.relief.sample(middle, 0.0) == pytest.approx(0.1e-3 * (i + 1))
    assert len(made.regions) == 12
    three = scene("three_lines")
    heights = [three.relief.sample((r.x0 + r.x1) / 2, 0.0) for r in three.regions]
    np.testing.assert_allclose(heights, 0.6e-3, atol=1e-9)


def test_letter_plate_has_letters_scratches_and_a_fault():
    made = scene("letter_plate")
    names = [r.name for r in made.regions]
    assert {"scratch_I", "scratch_E", "scratch_T", "fault_T", "letter_1_N"} <= set(names)
    height = made.relief.height
    assert 0.55e-3 < float(height.max()) <= 0.6001e-3
    assert float(height.min()) == 0.0 or float(height.min()) >= -0.26e-3
    np.testing.assert_array_equal(height, scene("letter_plate").relief.height)
    with pytest.raises(SceneError, match="no letter shape for '!'"):
        scene("letter_plate", text="NO!")


def test_rivets_differ_by_their_tilt():
    flush, bent = scene("rivet_flush"), scene("rivet_bent")
    middle = (flush.regions[0].x0 + flush.regions[0].x1) / 2
    assert flush.relief.sample(middle + 3e-3, 0.0) == pytest.approx(0.05e-3)
    assert bent.relief.sample(middle + 3e-3, 0.0) > 0.5e-3
    assert flush.relief.sample(middle + 4.2e-3, 0.0) < -0.25e-3


def test_braille_dots_lie_where_the_standard_puts_them():
    made = scene("braille", text="ab")
    a, b = made.marks
    left = a.x - 1.17e-3
    assert made.relief.sample(left, 2.34e-3) == pytest.approx(0.48e-3, abs=1e-6)
    assert made.relief.sample(left, 2.34e-3 - 0.73e-3) < 1e-9
    assert made.relief.sample(left, 0.0) == 0.0
    assert b.x - a.x == pytest.approx(6.2e-3)
    assert made.relief.sample(left + 6.2e-3, 0.0) == pytest.approx(0.48e-3, abs=1e-6)
    assert (a.mask, b.mask) == (0b000001, 0b000011)


def test_braille_text_becomes_grade_1_cells():
    assert [m for m, _ in to_cells("w7 a")] == [0x3A, NUMBER_SIGN, 0x1B, 0, 0x01]
    assert [m for m, _ in to_cells("12")] == [NUMBER_SIGN, 0x01, 0x03]
    # After digits a letter a–j needs the letter sign, others don't.
    assert [m for m, _ in to_cells("1a1k")] == [
        NUMBER_SIGN, 0x01, 0x30, 0x01, NUMBER_SIGN, 0x01, 0x05,
    ]  # fmt: skip
    masks = {c: to_cells(c)[0][0] for c in "abcdefghijklmnopqrstuvwxyz"}
    assert len(set(masks.values())) == 26
    assert (masks["q"], masks["z"], masks["t"]) == (0b011111, 0b110101, 0b011110)
    with pytest.raises(SceneError, match=r"no Braille for '\?'"):
        to_cells("who?")


def test_braille_lines_lie_below_each_other_and_must_fit():
    made = scene("braille", text="A\nb", width_mm=23.0)
    assert made.text == "a\nb"
    assert made.marks[0].y - made.marks[1].y == pytest.approx(10e-3)
    with pytest.raises(SceneError, match="mm across but the plate is only"):
        scene("braille", text="a\nb\nc")


@pytest.mark.parametrize("turn_deg", [30.0, -8.0, 180.0])
def test_braille_can_be_turned_on_the_plate(turn_deg: float):
    straight = scene("braille", text="lab", width_mm=40.0)
    turned = scene("braille", text="lab", width_mm=40.0, turn_deg=turn_deg)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    places = [(m.x - straight.marks[0].x, m.y - straight.marks[0].y) for m in straight.marks]
    for mark, (x, y) in zip(turned.marks, places, strict=True):
        first = turned.marks[0]
        assert (mark.x - first.x, mark.y - first.y) == pytest.approx((c * x - s * y, s * x + c * y))
        # Dot 1 of each letter.
        x, y = -1.17e-3, 2.34e-3
        top = turned.relief.sample(mark.x + c * x - s * y, mark.y + s * x + c * y)
        assert top == pytest.approx(0.48e-3, abs=2e-6)
    (region,) = turned.regions
    assert all(region.contains(m.x, m.y) for m in turned.marks)
    with pytest.raises(SceneError, match="across but the plate is only"):
        scene("braille", text="far too long", turn_deg=30.0)


def test_demo_has_braille_and_all_six_objects():
    made = scene("demo", step_mm=0.05)
    assert [r.name for r in made.regions] == ["braille", *LENGTHS]
    assert 0.110 <= made.relief.bounds[1] <= 0.130
    assert made.text == "roller"
    for a, b in zip(made.regions, made.regions[1:], strict=False):
        assert b.x0 - a.x1 > 2e-3


def test_a_mesh_is_laid_on_the_plate(tmp_path):
    import open3d as o3d

    box = o3d.geometry.TriangleMesh.create_box(4.0, 3.0, 0.8).translate((7.0, -5.0, 2.0))
    box.compute_vertex_normals()
    file = tmp_path / "box.stl"
    o3d.io.write_triangle_mesh(str(file), box)
    made = scene(f"mesh:{file}", step_mm=0.05)
    (region,) = made.regions
    middle = (region.x0 + region.x1) / 2
    assert made.relief.sample(middle, 0.0) == pytest.approx(0.8e-3, abs=1e-6)
    assert made.relief.sample(middle, 1.7e-3) == 0.0
    assert region.x1 - region.x0 == pytest.approx(4e-3)
    with pytest.raises(SceneError, match="no such file"):
        scene("mesh:nothing.stl")
    with pytest.raises(SceneError, match="check mesh_unit"):
        scene(f"mesh:{file}", mesh_unit="m")
    o3d.io.write_triangle_mesh(str(file), box.scale(1e-3, (0, 0, 0)))
    with pytest.raises(SceneError, match=r"mm in unit 'mm', too small to be seen; check mesh_unit"):
        scene(f"mesh:{file}")


def test_what_is_no_mesh_is_said_in_one_line(tmp_path, capfd):
    (file := tmp_path / "part.txt").touch()
    with pytest.raises(SceneError, match=r"no triangles in it; is it an STL file\?"):
        scene(f"mesh:{file}")
    assert capfd.readouterr() == ("", "")  # nothing of the library's own


def test_defects_lie_where_their_marks_say():
    made = scene("defects", defects=30, defect_depths_mm=[0.1, 0.4], step_mm=0.04)
    skin = skin_over(made.relief, SkinSettings.create({}))
    height = made.relief.height
    left = np.abs(height) > 1e-7
    kinds = set()
    for mark in made.defects:
        followed = mark.followed(skin)
        kinds.add(mark.kind)
        # The contour's area is the footprint; all that is not level lies in one.
        outline = np.array([mark.outline], np.float32)
        place = (outline - (made.relief.x0, made.relief.y0)) / made.relief.step
        mask = np.zeros(height.shape, np.uint8)
        cv2.fillPoly(mask, np.rint(place).astype(np.int32), 1)
        part = height[mask == 1]
        extreme = part.max() if mark.depth > 0 else part.min()
        assert extreme == pytest.approx(mark.depth, rel=0.06)
        assert 0 < followed.skin_depth / mark.depth < 1.01
        assert mark.length >= mark.width
        left &= cv2.dilate(mask, np.ones((17, 17), np.uint8)) == 0
    assert kinds == {"dent", "crater", "scratch", "raised", "missing", "extra"}
    narrow = [m for m in made.defects if m.kind == "scratch" and m.width < 0.4e-3]
    assert narrow
    assert all(abs(m.followed(skin).skin_depth) < 0.7 * abs(m.depth) for m in narrow)
    flush = [r for r in made.regions if r.name.startswith("rivet_flush")]
    y, x = np.nonzero(left)
    inside = [r.contains(made.relief.x[x], made.relief.y[y]) for r in flush]
    assert flush
    assert np.logical_or.reduce(inside).all()


def test_a_seed_places_defects_and_a_clean_plate_has_none():
    marks = [scene("defects", step_mm=0.06, seed=seed).defects for seed in (1, 1, 2)]
    assert marks[0] == marks[1] != marks[2]
    plain = scene("clean", step_mm=0.06)
    assert plain.regions == scene("defects", step_mm=0.06).regions[:1]
    assert plain.relief.bounds == scene("defects", step_mm=0.06).relief.bounds
    assert not plain.relief.height.any()
    assert not plain.defects


def test_defects_beside_a_narrow_plate_are_followed_by_no_skin():
    made = scene("defects", defects=6, width_mm=9.0, step_mm=0.06)
    beside = [m.followed(made.relief).skin_depth for m in made.defects if abs(m.y) > 6e-3]
    assert beside
    assert not any(beside)


@pytest.mark.parametrize(("name", "ends_mm"), [("clean", 92.0), ("stairs", None)])
def test_a_longer_plate_is_rolled_over_to_its_end(name, ends_mm):
    cell = VirtualCell(
        VirtualCellSettings.create(
            {"scene": {"name": name, "length_mm": 100.0, "step_mm": 0.1}}, ""
        )
    )
    assert cell.settings.motion.end_mm >= 100.0
    if ends_mm is not None:  # what is inspected goes on to the margin
        assert cell.scene.regions[0].x1 == pytest.approx(ends_mm * 1e-3)
    short = VirtualCellSettings.create({"scene": {"name": name, "step_mm": 0.1}}, "")
    assert VirtualCell(short).settings.motion.end_mm < 60.0
