"""The launch files of the workspace are the same for `ros2 launch`, where that is installed."""

import asyncio
import sys
from importlib import metadata
from pathlib import Path

import pytest
import yaml

from bringup.test_our_launch_files import FILES, NEEDED, load, name_of

pytest.importorskip("launch.frontend")
pytest.importorskip("launch_ros.actions")

CASES = ({}, {"method": "surface"}, {"namespace": "left", "tf_prefix": "left_", "method": "bma"})


@pytest.mark.parametrize("arguments", CASES, ids=["plain", "surface", "left"])
@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_ros2_launch_starts_the_same(path, arguments, tmp_path, monkeypatch):
    """Its commands and parameters are ours."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(_prefix(tmp_path)), prepend=":")
    with load(name_of(path), **arguments) as plan:
        ours = [_plain(process.command) for process in plan.processes]
    given = {**NEEDED.get(name_of(path), {}), **arguments}
    assert _commands_of_launch(path, given) == (ours, 0)


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_ros2_launch_starts_nothing_without_a_parameter_file(path, tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(_prefix(tmp_path)), prepend=":")
    given = {**NEEDED.get(name_of(path), {}), "params": str(tmp_path / "mistyped.yaml")}
    assert _commands_of_launch(path, given) == ([], 1)


def _prefix(folder):
    """A prefix as colcon makes it, with programs that do nothing in place of the nodes."""
    for point in metadata.entry_points(group="console_scripts"):
        if point.name.endswith("_node") and point.module.startswith("roller_"):
            program = folder / "lib" / point.module.split(".")[0] / point.name
            program.parent.mkdir(parents=True, exist_ok=True)
            program.write_text("#!/bin/sh\nexec sleep 60\n")
            program.chmod(0o755)
    (folder / "share").symlink_to(Path(sys.prefix) / "share")
    return folder


def _plain(command):
    """A command without what differs: the program's folder, and copies of parameter files."""
    words = [Path(command[0]).name, *command[1:]]
    return [yaml.safe_load(Path(w).read_text()) if w.endswith(".yaml") or "launch_params_" in w
            else w for w in words]  # fmt: skip


def _commands_of_launch(path, arguments):
    """Let launch start the file, and listen; its exit code too."""
    from launch.event_handlers import OnProcessStart
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    import launch

    started = []

    def take(event, _context):
        started.append(_plain(event.cmd))

    service = launch.LaunchService(noninteractive=True)
    description = launch.LaunchDescription(
        [
            launch.actions.RegisterEventHandler(OnProcessStart(on_start=take)),
            launch.actions.IncludeLaunchDescription(
                AnyLaunchDescriptionSource(str(path)), launch_arguments=list(arguments.items())
            ),
            launch.actions.TimerAction(period=1.0, actions=[launch.actions.Shutdown()]),
        ]
    )
    service.include_launch_description(description)
    asyncio.set_event_loop(asyncio.new_event_loop())
    return started, service.run()
