"""The launch files of the workspace: what they start, with which parameters."""

import re
from itertools import takewhile
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from bringup.test_config import FILES as MODELS
from roller_bringup import launching
from roller_bringup.launching import LaunchError, locate
from roller_core.errors import SettingsError
from roller_core.parameter_files import read_parameters
from roller_ros.node import LEAVES_WITHIN_S
from roller_ros.worker import ENDS_WITHIN_S

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "launch").glob("*.launch.xml"))
PROCESSING = ["emvs", "stitcher", "braille"]
NODES = {
    "cell": [*PROCESSING, "event_camera", "ur10"],
    "processing": PROCESSING,
    "replay": [*PROCESSING, "player"],
    "virtual": [*PROCESSING, "virtual_cell"],
}
NEEDED = {"replay": {"bag": "/recordings/one"}}
#: How users may name a node in a parameter file of their own.
KEYS = ("/**/{}", "{}", "/{}", "/**")


def name_of(path):
    return path.name.removesuffix(".launch.xml")


def load(name, **arguments):
    given = {**NEEDED.get(name, {}), **arguments}
    return launching.load(ROOT / "launch" / f"{name}.launch.xml", given)


def node(plan, name):
    return next(process for process in plan.processes if process.name == name)


def merge(into, values):
    """Parameters over others; groups are merged."""
    for name, value in values.items():
        into[name] = merge(into.get(name, {}), value) if isinstance(value, dict) else value
    return into


def parameters(process):
    """All parameters of a process, as rcl takes them from its files.

    A section that was there before keeps its place among the others, and so what holds against it.
    """
    sections = {}
    for i, word in enumerate(process.command):
        if word == "--params-file":
            content = yaml.safe_load(Path(process.command[i + 1]).read_text())
            for key, section in content.items():
                key = key if key.startswith("/") else f"/{key}"
                if key in ("/**", f"/**/{process.name}", f"/{process.label}"):
                    merge(sections.setdefault(key, {}), section["ros__parameters"])
    found = {}
    for section in sections.values():
        merge(found, section)
    return found


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_starts_the_nodes_it_should(path, monkeypatch):
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    with load(name_of(path)) as plan:
        assert [process.label for process in plan.processes] == NODES[name_of(path)]
        # Without text there is still a surface.
        assert [p.name for p in plan.processes if not p.required] == ["braille"]
        for process in plan.processes:
            assert f"__node:={process.name}" in process.command
            profile = Path(process.env["FASTDDS_DEFAULT_PROFILES_FILE"])
            assert profile.samefile(ROOT / "config" / "fastdds.xml")


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_every_node_of_ours_reads_its_file_first(path):
    with load(name_of(path), record="true", inspect="true") as plan:
        for process in plan.processes:
            first = process.command[process.command.index("--params-file") + 1]
            assert Path(first).samefile(ROOT / "config" / f"{process.name}.yaml")


@pytest.mark.parametrize("player", ["replay", "virtual"])
@pytest.mark.parametrize("method", ["focus", "surface"])
def test_a_scan_waits_for_all_that_are_started(player, method):
    """Who subscribes late misses its begin: depth without poses, or no text."""
    others = ("braille", "inspect", "record")
    for chosen in ("false", "true"):
        with load(player, method=method, **dict.fromkeys(others, chosen)) as plan:
            *processing, last = plan.processes
            waited_for = parameters(last)["listeners"].split(",")
            assert waited_for == [process.name for process in processing]
            assert last.name in ("player", "virtual_cell")


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_every_argument_says_what_it_is(path):
    for argument in launching.list_arguments(path):
        assert argument.description, argument.name


@pytest.mark.parametrize("method", ["focus", "surface"])
@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_defaults_of_arguments_are_those_of_the_models(path, method):
    with load(name_of(path), method=method, record="true", inspect="true") as plan:
        for process in plan.processes:
            model = MODELS[process.name]
            needed = {}
            if process.name in ("player", "virtual_cell"):
                others = ",".join(p.name for p in plan.processes if p is not process)
                needed = NEEDED.get(name_of(path), {}) | {"listeners": others}
            chosen = {"method": method} if process.name == "emvs" else {}
            if process.name in ("emvs", "surface"):
                chosen["average_flats"] = False  # where a part is inspected
            shipped = {}
            if name_of(path) == "virtual":
                shipped = read_parameters(ROOT / "config" / "virtual_cell_ring.yaml", process.name)
                assert bool(shipped) == (process.name in ("emvs", "surface", "inspect"))
            given = model.create(parameters(process), process.name)
            assert given == model.create({**needed, **chosen, **shipped}), process.name


def test_files_that_launch_files_fill_in_name_parameters_that_there_are():
    for file in (ROOT / "launch").glob("*.params.yaml"):
        for key in yaml.safe_load(file.read_text()):
            node = key.removeprefix("/**/")
            model = MODELS[node]
            names = {name.split(".")[0] for name in read_parameters(file, node)}
            assert names <= model.model_fields.keys()


def test_a_profile_of_ones_own_stays(monkeypatch):
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "/mine.xml")
    with load("virtual") as plan:
        assert plan.processes[0].env["FASTDDS_DEFAULT_PROFILES_FILE"] == "/mine.xml"


def test_arguments_reach_their_nodes():
    with load("virtual", method="bma", scene="mesh:a.stl", speed="0.5") as plan:
        cell = node(plan, "virtual_cell")
        assert parameters(node(plan, "emvs"))["method"] == "bma"
        assert parameters(cell)["scene"]["name"] == "mesh:a.stl"
        assert parameters(cell)["motion"]["speed"] == 0.5


@pytest.mark.parametrize(
    "name", ["it's", 'a "b"', "#1: {x} [y]", "back\\n", " ", "123", "true", "~"]
)
def test_names_reach_their_nodes_whatever_is_in_them(name):
    """A path with an apostrophe is a path; a folder called 123 is no number."""
    more = dict.fromkeys(("inspect", "record"), "true")
    with load("virtual", scene=f"mesh:{name}.stl", output=name, recipe=name, **more) as plan:
        assert parameters(node(plan, "virtual_cell"))["scene"]["name"] == f"mesh:{name}.stl"
        assert parameters(node(plan, "recorder"))["output"] == name
        assert parameters(node(plan, "inspect"))["recipe"] == name
    with load("replay", bag=name) as plan:
        assert parameters(node(plan, "player"))["bag"] == name
    with load("cell", camera_info=name) as plan:
        assert parameters(node(plan, "event_camera"))["camerainfo_url"] == name


def test_a_name_that_is_not_given_is_that_of_the_nodes_own_file():
    """ROS takes no empty block for a text, so there must be none."""
    more = dict.fromkeys(("inspect", "record"), "true")
    with load("virtual", scene="", output="", **more) as plan:
        assert parameters(node(plan, "inspect"))["recipe"] == ""
        assert parameters(node(plan, "recorder"))["output"] == "recording"
        assert parameters(node(plan, "virtual_cell"))["scene"]["name"] == "demo"


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_the_method_surface_has_a_node_of_its_own(path):
    with load(name_of(path), method="surface") as plan:
        names = [process.name for process in plan.processes]
        assert set(names) == {*NODES[name_of(path)], "surface"} - {"emvs", "stitcher"}
        assert node(plan, "surface").required


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_inspection_is_started_on_request(path, tmp_path):
    with load(name_of(path), inspect="true", recipe="bracket.yaml") as plan:
        names = [process.name for process in plan.processes]
        assert set(names) == {*NODES[name_of(path)], "inspect"}
        assert parameters(node(plan, "inspect"))["recipe"] == "bracket.yaml"
        # With a recipe that can't be read nobody should take the parts for inspected.
        assert node(plan, "inspect").required


@pytest.mark.parametrize("path", FILES, ids=name_of)
@pytest.mark.parametrize("method", ["focus", "surface"])
def test_points_are_averaged_where_nobody_inspects(path, method):
    for inspect in (False, True):
        with load(name_of(path), method=method, inspect=str(inspect).lower()) as plan:
            depth = parameters(node(plan, "surface" if method == "surface" else "emvs"))
            assert depth["average_flats"] is not inspect


def test_a_node_that_gives_way_has_time_to_end():
    """It finishes what it is at, and leaves the graph: each takes longer on busy cores."""
    with load("virtual", inspect="true") as plan:
        assert (node(plan, "inspect").grace_s or 0.0) >= 2 * (ENDS_WITHIN_S + LEAVES_WITHIN_S)


@pytest.mark.parametrize("name", ["cell", "virtual", "replay"])
@pytest.mark.parametrize("method", ["focus", "surface"])
def test_two_cells_share_no_names(name, method):
    with load(name, tf_prefix="left_", namespace="left", method=method, inspect="true") as plan:
        for process in plan.processes:
            assert process.label == f"left/{process.name}"
            assert "__ns:=/left" in process.command
            given = parameters(process)
            if process.name == "ur10":
                assert given["tf_prefix"] == "left_"
            elif process.name == "event_camera":
                assert given["camera_frame_id"] == "left_event_camera_optical_frame"
                continue
            elif process.name == "player":
                continue
            else:
                assert given["base_frame"] == "left_base"
                assert given["moving_frame"] == "left_tool0_controller"
            assert given["sensor_frame"] == "left_event_camera_optical_frame"


@pytest.mark.parametrize("key", KEYS)
def test_a_parameter_file_of_ones_own_has_the_last_word(tmp_path, key):
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"{key.format('emvs')}:\n  ros__parameters: {{method: emvs}}\n")
    with load("virtual", params=str(mine), method="bma") as plan:
        assert parameters(node(plan, "emvs"))["method"] == "emvs"


def in_order(path):
    """Elements of a launch file and of those that it includes, in the order of doing."""
    for element in ElementTree.parse(path).getroot().iter():
        if element.tag == "include":
            yield from in_order(path.parent / Path(element.get("file")).name)
        else:
            yield element


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_what_can_fail_fails_before_a_node_is_started(path):
    """ros2 launch ends with the first error, and leaves nodes running that it has begun to start.

    Without a parameter file that isn't there it starts them all the same.
    """

    def conditions(elements):
        found = {e.get("if") or e.get("unless") or "" for e in elements}
        return {text for text in found if text.startswith("$(var ")}

    every = list(in_order(path))
    before = list(takewhile(lambda e: e.tag != "node", every))
    first_node = every[len(before)]
    assert conditions(every) <= conditions([*before, first_node])
    values = [e.get("value") for e in before if e.tag == "let"]
    assert "$(find-pkg-share rviz2)" in values
    read = re.findall(r"file-content \$\(var (\w+)\)", " ".join(values))
    own = ElementTree.parse(path).getroot().iter("arg")
    arguments = {f"$(var {e.get('name')})": e.get("name") for e in own}
    files = {e.get("from") for e in every if e.tag == "param"} & arguments.keys()
    assert {arguments[file] for file in files} <= set(read)


def test_an_argument_goes_before_the_devices_own_file(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**/ur10: {ros__parameters: {robot_ip: 10.0.0.9, tf_prefix: x_}}\n")
    with load("cell", robot_params=str(mine)) as plan:
        # No address is given: that of the file holds; the prefix is the argument's, for all nodes.
        assert parameters(node(plan, "ur10"))["robot_ip"] == "10.0.0.9"
        assert parameters(node(plan, "ur10"))["tf_prefix"] == ""
    with load("cell", robot_params=str(mine), robot_ip="10.0.0.1", camera_info="file:///c") as plan:
        camera, robot = node(plan, "event_camera"), node(plan, "ur10")
        assert parameters(robot)["robot_ip"] == "10.0.0.1"
        assert parameters(camera)["camerainfo_url"] == "file:///c"


def test_the_cameras_place_is_published_without_the_robot_too(tmp_path):
    place = tmp_path / "hand_eye.yaml"
    place.write_text("/**/ur10: {ros__parameters: {hand_eye_m: [0.1, 0.0, 0.2]}}\n")
    with load("cell", start_robot="false", hand_eye=str(place), tf_prefix="left_") as plan:
        robot = MODELS["ur10"].create(parameters(node(plan, "ur10")))
        assert not robot.connect
        assert robot.publish_hand_eye
        assert robot.hand_eye_m == (0.1, 0.0, 0.2)
        assert robot.tool == "left_tool0_controller"


def test_a_file_for_the_cameras_place_must_tell_it(tmp_path):
    other = tmp_path / "cell.yaml"
    other.write_text("/**/emvs: {ros__parameters: {event_delay_s: 0.0004}}\n")
    with load("cell", hand_eye=str(other)) as plan:
        robot = MODELS["ur10"].create(parameters(node(plan, "ur10")))
    with pytest.raises(SettingsError, match=rf"{other}: there is no .* \(section ur10, hand_eye_m"):
        robot.check_hand_eye_file()
    other.write_text("/**/ur10: {ros__parameters: {hand_eye_identity: true}}\n")
    robot.check_hand_eye_file()
    # Without the argument the robot's file holds, which may leave it to another node.
    with load("cell", robot_params=str(other)) as plan:
        assert "hand_eye_file" not in parameters(node(plan, "ur10"))


def test_options_add_and_leave_out_nodes():
    with load("cell", start_driver="false", braille="false", record="true") as plan:
        names = [process.name for process in plan.processes]
    assert names == ["emvs", "stitcher", "recorder", "ur10"]


def test_a_missing_rviz_is_reported():
    try:
        locate.package_prefix("rviz2")
    except locate.NotFoundError:
        with pytest.raises(LaunchError, match="package 'rviz2' is not installed"):
            load("virtual", rviz="true")
    else:
        with load("virtual", rviz="true") as plan:
            assert node(plan, "rviz")


def test_replay_needs_its_bag():
    with pytest.raises(LaunchError, match="the argument 'bag' must be given: bag:=VALUE"):
        launching.load(ROOT / "launch" / "replay.launch.xml", {})
