"""The launch files of the workspace: whole, and the same for `ros2 launch`."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from roller_bringup import launching
from roller_bringup.launching import LaunchError, locate

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "launch").glob("*.launch.xml"))
PROCESSING = ["emvs", "stitcher", "braille"]
NODES = {
    "cell": ["event_camera", "ur10", *PROCESSING],
    "processing": PROCESSING,
    "replay": ["player", *PROCESSING],
    "virtual": ["virtual_cell", *PROCESSING],
}
NEEDED = {"replay": {"bag": "/recordings/one"}}


def name_of(path):
    return path.name.removesuffix(".launch.xml")


def load(path, **arguments):
    if name_of(path) == "cell" and not (ROOT / "config" / "ur10.yaml").exists():
        pytest.skip("the drivers' parameter files are yet to come")
    return launching.load(path, {**NEEDED.get(name_of(path), {}), **arguments})


def parameters(process):
    """All parameters of a process, later files over earlier ones."""
    found = {}
    for i, word in enumerate(process.command):
        if word == "--params-file":
            for key, content in yaml.safe_load(Path(process.command[i + 1]).read_text()).items():
                if key in ("/**", f"/**/{process.name}", process.name, f"/{process.name}"):
                    found.update(content["ros__parameters"])
    return found


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_starts_the_nodes_it_should(path, monkeypatch):
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    with load(path) as plan:
        assert [process.name for process in plan.processes] == NODES[name_of(path)]
        assert plan.processes[0].required
        for process in plan.processes:
            assert f"__node:={process.name}" in process.command
            if name_of(path) != "processing":
                profile = Path(process.env["FASTDDS_DEFAULT_PROFILES_FILE"])
                assert profile.samefile(ROOT / "config" / "fastdds.xml")


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_every_argument_says_what_it_is(path):
    for argument in launching.list_arguments(path):
        assert argument.description, argument.name


def test_a_profile_of_ones_own_stays(monkeypatch):
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "/mine.xml")
    with load(ROOT / "launch" / "virtual.launch.xml") as plan:
        assert plan.processes[0].env["FASTDDS_DEFAULT_PROFILES_FILE"] == "/mine.xml"


def test_arguments_reach_their_nodes():
    path = ROOT / "launch" / "virtual.launch.xml"
    with load(path, method="bma", scene="braille", speed="0.5") as plan:
        cell, emvs, *_ = plan.processes
        assert parameters(emvs)["method"] == "bma"
        given = parameters(cell)
        assert given["scene.name"] == "braille"
        assert given["motion.speed"] == 0.5


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_the_method_surface_has_a_node_of_its_own(path):
    with load(path, method="surface") as plan:
        names = [process.name for process in plan.processes]
        source = [name for name in NODES[name_of(path)] if name not in PROCESSING]
        assert names == [*source, "surface", "braille"]
        node = next(process for process in plan.processes if process.name == "surface")
        assert node.required
        assert parameters(node)["block_m"] == 0.004


def test_a_section_surface_reaches_its_node(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("surface:\n  ros__parameters: {threads: 1}\n")
    path = ROOT / "launch" / "virtual.launch.xml"
    with load(path, params=str(mine), method="surface") as plan:
        assert parameters(plan.processes[1])["threads"] == 1


#: What launch files give whether or not an argument is given: nothing that a file in config/ says.
ALWAYS = (("not_given", ""), ("base_frame", "base"), ("moving_frame", "tool0_controller"))


def test_an_argument_not_given_leaves_the_parameter_alone():
    with load(ROOT / "launch" / "virtual.launch.xml") as plan:
        for process in plan.processes:
            for i, word in enumerate(process.command):
                if word == "--params-file" and "roller_launch_" in process.command[i + 1]:
                    content = yaml.safe_load(Path(process.command[i + 1]).read_text())
                    (given,) = content[f"/{process.name}"]["ros__parameters"].items()
                    assert given in ALWAYS


@pytest.mark.parametrize("method", ["", "surface"])
def test_the_prefix_of_frames_reaches_all_nodes(method):
    with load(ROOT / "launch" / "cell.launch.xml", tf_prefix="left_", method=method) as plan:
        for process in plan.processes:
            if process.name in (*PROCESSING, "surface"):
                assert parameters(process)["base_frame"] == "left_base"
                assert parameters(process)["moving_frame"] == "left_tool0_controller"
            elif process.name == "ur10":
                assert parameters(process)["tf_prefix"] == "left_"


def test_a_parameter_file_of_ones_own_has_the_last_word(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("emvs:\n  ros__parameters: {method: emvs}\n")
    with load(ROOT / "launch" / "virtual.launch.xml", params=str(mine), method="bma") as plan:
        assert parameters(plan.processes[1])["method"] == "emvs"


def test_options_add_and_leave_out_nodes():
    cell = ROOT / "launch" / "cell.launch.xml"
    with load(cell, start_driver="false", braille="false", record="true") as plan:
        names = [process.name for process in plan.processes]
    assert names == ["ur10", "emvs", "stitcher", "recorder"]


def test_a_missing_rviz_is_told():
    try:
        locate.package_prefix("rviz2")
    except locate.NotFoundError:
        with pytest.raises(LaunchError, match="package 'rviz2' is not installed"):
            load(ROOT / "launch" / "virtual.launch.xml", rviz="true")
    else:
        with load(ROOT / "launch" / "virtual.launch.xml", rviz="true") as plan:
            assert plan.processes[-1].name == "rviz"


def test_replay_needs_its_bag():
    with pytest.raises(LaunchError, match="the argument 'bag' must be given: bag:=VALUE"):
        launching.load(ROOT / "launch" / "replay.launch.xml", {})


@pytest.mark.parametrize("method", ["", "surface"])
@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_ros2_launch_starts_the_same(path, method, monkeypatch):
    """Where launch is installed: its commands are ours, but for temporary files' names."""
    pytest.importorskip("launch.frontend")
    pytest.importorskip("launch_ros.actions")
    commands = _commands_of_launch(path, method)
    with load(path, method=method) as plan:
        ours = [[_plain(word) for word in process.command] for process in plan.processes]
    assert commands == ours


def _plain(word):
    return "PARAMETERS" if "/launch_params_" in word or "/roller_launch_" in word else word


def _commands_of_launch(path, method):
    """Let launch start the file with programs that end at once, and listen."""
    from launch.event_handlers import OnProcessStart
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    import launch

    started = []
    service = launch.LaunchService(noninteractive=True)
    description = launch.LaunchDescription(
        [
            launch.actions.RegisterEventHandler(
                OnProcessStart(
                    on_start=lambda event, _context: started.append([*map(_plain, event.cmd)])
                )
            ),
            launch.actions.IncludeLaunchDescription(
                AnyLaunchDescriptionSource(str(path)),
                launch_arguments=[*NEEDED.get(name_of(path), {}).items(), ("method", method)],
            ),
            launch.actions.TimerAction(period=1.0, actions=[launch.actions.Shutdown()]),
        ]
    )
    service.include_launch_description(description)
    asyncio.set_event_loop(asyncio.new_event_loop())
    service.run()
    return started


def test_the_module_stays_off_ros():
    """Launching needs no ROS libraries: only the nodes it starts do."""
    code = "import sys, roller_bringup.launching; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
