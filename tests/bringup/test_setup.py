"""Setting up: steps that are done once, the command at the root, what a machine lacks."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_a_digest_follows_names_and_contents(modules, tmp_path):
    digest = modules["steps"].digest
    folder = tmp_path / "package"
    (folder / "sub").mkdir(parents=True)
    (folder / "a").write_text("1")
    seen = {digest([folder])}
    assert digest([folder]) in seen
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "a.pyc").write_text("x")
    assert digest([folder]) in seen
    for change in (
        lambda: (folder / "a").write_text("2"),
        lambda: (folder / "sub" / "b").write_text(""),
        lambda: (folder / "a").rename(folder / "c"),
    ):
        change()
        assert digest([folder]) not in seen
        seen.add(digest([folder]))
    assert digest([folder], "python3.12") not in seen
    assert digest([tmp_path / "none"]) != digest([])


def test_a_step_is_done_once_and_again_when_it_failed(modules, tmp_path, capsys):
    steps = modules["steps"].Steps(tmp_path / "setup")
    done = []
    assert steps.do("one", "doing one", "key", lambda: done.append(1))
    assert not steps.do("one", "doing one", "key", lambda: done.append(2))
    assert steps.do("one", "doing one", "other key", lambda: done.append(3))

    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        steps.do("two", "doing two", "key", fail)
    assert steps.do("two", "doing two", "key", lambda: done.append(4))
    steps.forget("two")
    assert steps.do("two", "doing two", "key", lambda: done.append(5))
    assert done == [1, 3, 4, 5]
    assert capsys.readouterr().out.splitlines()[2] == "setup: doing two ... failed"


def test_a_failed_program_shows_the_end_of_what_it_said(modules, tmp_path):
    steps = modules["steps"].Steps(tmp_path)
    with pytest.raises(modules["steps"].SetupError) as caught:
        steps.run(["bash", "-c", "seq 100; exit 7"])
    message = str(caught.value)
    assert message.startswith(f"bash failed (exit 7); all of it in {tmp_path}/setup.log:")
    assert message.splitlines()[-1].strip() == "100"
    assert len(message.splitlines()) < 20
    with pytest.raises(modules["steps"].SetupError, match="can't run /no/such: No such file"):
        steps.run(["/no/such"])


def test_missing_system_packages_are_named(modules, monkeypatch):
    system = modules["system"]
    monkeypatch.setattr(system, "loads", lambda library: library != "libGL.so.1")
    monkeypatch.setattr(system.shutil, "which", lambda name: None)
    assert {"libgl1", "build-essential"} <= set(system.missing_packages())
    assert "build-essential" not in system.missing_packages(build=False)


def test_without_the_right_to_install_the_command_is_printed(modules, monkeypatch, tmp_path):
    system = modules["system"]
    monkeypatch.setattr(system.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(
        system.shutil, "which", lambda name: None if name == "sudo" else f"/usr/bin/{name}"
    )
    with pytest.raises(modules["steps"].SetupError) as caught:
        system.provide(modules["steps"].Steps(tmp_path), ["libgl1", "libgomp1"])
    assert str(caught.value).endswith("Run:\n  sudo apt install libgl1 libgomp1")


def test_packages_a_distribution_lacks_are_named_as_apt_has_them(modules, tmp_path, monkeypatch):
    distribution = modules["distribution"]
    index = tmp_path / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for name in distribution.NEEDED:
        if name not in ("event_camera_msgs", "tf_transformations"):
            (index / name).touch()
    found = distribution.Distribution("jazzy", [tmp_path / "workspace", tmp_path])
    assert found.prefix == tmp_path
    with pytest.raises(modules["steps"].SetupError) as caught:
        distribution.build(ROOT, None, None, found)
    assert str(caught.value).endswith(
        "Run:\n  sudo apt install ros-jazzy-event-camera-msgs ros-jazzy-tf-transformations"
    )


def test_a_distribution_counts_when_its_rclpy_can_be_imported(modules, tmp_path, monkeypatch):
    find = modules["distribution"].find
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("ROLLER_ROS", raising=False)
    assert find() is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "rclpy.py").write_text("")
    assert find().name == "jazzy"
    (tmp_path / "rclpy.py").write_text("raise ImportError('built for another Python')")
    with pytest.raises(modules["steps"].SetupError, match="built for another Python"):
        find()
    monkeypatch.setenv("ROLLER_ROS", "wheels")
    assert find() is None


@pytest.fixture
def checkout(tmp_path):
    """A checkout whose Python only tells how it was called."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "roller", tmp_path)
    shutil.copy(ROOT / "scripts" / "env.sh", tmp_path / "scripts")
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/bash\npwd\necho "$@"\nenv | sort\nexit 3\n')
    python.chmod(0o755)
    return tmp_path


def call(checkout, *words, cwd, **environment):
    plain = {"PATH": os.environ["PATH"], "HOME": str(checkout)}
    return subprocess.run(
        [str(checkout / "roller"), *words],
        cwd=cwd,
        env={**plain, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_command_asks_for_the_set_up(checkout):
    done = call(checkout, "demo", cwd="/")
    assert done.returncode == 1
    assert done.stderr == f"roller: not set up yet: run `make setup` in {checkout}\n"


def test_a_workspace_newer_than_its_set_up_says_so(checkout):
    package = checkout / "src" / "roller_core" / "setup.py"
    package.parent.mkdir(parents=True)
    package.touch()
    mode = checkout / ".venv" / "setup" / "mode"
    mode.parent.mkdir(parents=True)
    mode.write_text("wheels\n")
    now = package.stat().st_mtime
    for age, changed in ((10, True), (-10, False)):
        os.utime(mode, (now - age, now - age))
        assert ("run `make setup`" in call(checkout, cwd=checkout).stderr) == changed


def test_the_command_runs_from_anywhere_with_its_environment(checkout, tmp_path):
    (checkout / ".venv" / "setup").mkdir()
    (checkout / ".venv" / "setup" / "mode").write_text("wheels\n")
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    (elsewhere / "link").symlink_to(checkout / "roller")
    done = call(checkout, "replay", "bag a", cwd=elsewhere, _ROS_WHEELS_BOOTSTRAP_COMPLETE="1")
    assert done.returncode == 3
    lines = done.stdout.splitlines()
    assert lines[0] == str(elsewhere)
    assert lines[1] == "-m roller_bringup.cli replay bag a"
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST" in lines
    assert f"FASTDDS_DEFAULT_PROFILES_FILE={checkout}/config/fastdds.xml" in lines
    assert f"NUMBA_CACHE_DIR={checkout}/.venv/cache/numba" in lines
    assert not any(line.startswith(("_ROS_WHEELS", "ROS_LOG_DIR")) for line in lines)
    linked = subprocess.run(
        [str(elsewhere / "link")], capture_output=True, text=True, cwd="/", check=False
    )
    assert linked.stdout.splitlines()[0] == "/"


def test_a_cell_opts_into_its_network(checkout):
    (checkout / ".venv" / "setup").mkdir()
    (checkout / ".venv" / "setup" / "mode").write_text("wheels\n")
    for environment, expected in (
        ({"ROLLER_ROS_NETWORK": "SUBNET"}, "SUBNET"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "SUBNET"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROLLER_ROS_NETWORK": "SUBNET"}, "OFF"),
    ):
        done = call(checkout, cwd="/", **environment)
        assert f"ROS_AUTOMATIC_DISCOVERY_RANGE={expected}" in done.stdout.splitlines()
    done = call(checkout, cwd="/", HOME="/nonexistent")
    assert f"ROS_LOG_DIR={checkout}/log/ros" in done.stdout.splitlines()


def test_a_sourced_distribution_stays_out_of_wheels(checkout):
    (checkout / ".venv" / "setup").mkdir()
    (checkout / ".venv" / "setup" / "mode").write_text("wheels\n")
    mine = call(checkout, cwd="/", PYTHONPATH="/mine").stdout.splitlines()
    assert "PYTHONPATH=/mine" in mine
    lines = call(checkout, cwd="/", PYTHONPATH="/ros", AMENT_PREFIX_PATH="/ros").stdout
    assert "/ros" not in lines.replace(f"{checkout}", "")


def test_the_scripts_are_sound():
    for script in [
        "roller",
        ".ci/run",
        ".ci/minimal_debian",
        *map(str, (ROOT / "scripts").glob("*.sh")),
    ]:
        path = ROOT / script
        assert subprocess.run(["bash", "-n", str(path)], check=False).returncode == 0
        assert path.name == "env.sh" or os.access(path, os.X_OK), script


def test_uv_asks_the_index_that_pip_is_set_to(modules, tmp_path):
    config = tmp_path / "pip.conf"
    config.write_text("[global]\nindex-url = https://mirror.example/simple\n")
    environment = modules["venv_builder"].Environment(tmp_path, "wheels")
    environment.python = Path(sys.executable)
    plain = {k: v for k, v in os.environ.items() if not k.startswith("PIP_")}
    assert environment._pip_index({**plain, "PIP_CONFIG_FILE": os.devnull}) == ""
    index = environment._pip_index({**plain, "PIP_CONFIG_FILE": str(config)})
    assert index == "https://mirror.example/simple"
    index = environment._pip_index({**plain, "PIP_INDEX_URL": "https://other.example/simple"})
    assert index == "https://other.example/simple"


def test_all_that_is_installed_is_pinned_with_hashes(modules):
    for name in (*modules["wheels"].REQUIREMENTS, modules["distribution"].COLCON):
        text = (ROOT / name).read_text().replace("\\\n", "")
        pins = [line for line in text.splitlines() if line and not line.startswith(("#", " "))]
        assert pins
        assert all("==" in line and "--hash=sha256:" in line for line in pins), name


def test_an_environment_of_others_is_never_deleted(modules, tmp_path, monkeypatch):
    def run(command, **how):
        """Without pip, which takes seconds to install."""
        if "venv" not in command:
            return program(command, **how)
        done = program([*command, "--without-pip"], **how)
        (packages,) = Path(command[-1]).glob("lib/python*/site-packages")
        (packages / "pip.py").touch()
        return done

    program = subprocess.run
    monkeypatch.setattr(subprocess, "run", run)
    environment = modules["venv_builder"].Environment(tmp_path / ".venv", "wheels")
    steps = modules["steps"].Steps(environment.path / "setup")
    environment.path.mkdir()
    (environment.path / "notes").write_text("mine")
    with pytest.raises(modules["steps"].SetupError, match="not of our making"):
        environment.ensure(steps)
    assert (environment.path / "notes").read_text() == "mine"
    steps.folder.mkdir()  # as an interrupted set-up leaves it
    assert environment.ensure(steps)
    assert not (environment.path / "notes").exists()
    assert environment._works()

    (steps.folder / "adopted").write_text("made by hand")
    environment.mode = "distribution"  # no longer what is wanted
    with pytest.raises(modules["steps"].SetupError, match="not of our making"):
        environment.ensure(steps)
    assert environment.python.exists()


def test_a_link_to_the_environment_of_another_place_stays_as_it_is(modules, tmp_path):
    """Nor do its steps change: the other place would be set up anew."""
    other = tmp_path / "other"
    (other / "setup").mkdir(parents=True)
    (other / "setup" / "venv").write_text("of the other place")
    (tmp_path / ".venv").symlink_to(other)
    environment = modules["venv_builder"].Environment(tmp_path / ".venv", "wheels")
    steps = modules["steps"].Steps(environment.path / "setup")
    with pytest.raises(modules["steps"].SetupError, match=r"\.venv is a link to .*: remove it"):
        environment.ensure(steps)
    assert (other / "setup" / "venv").read_text() == "of the other place"
    assert sorted(p.name for p in other.rglob("*")) == ["setup", "venv"]


def test_cleaning_removes_what_set_up_and_builds_made(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for folder in ("src", "tests/__pycache__", "scripts", "underlay", ".venv/setup", "install"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("build", "log/ros"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "COLCON_IGNORE").touch()
    (tmp_path / "install/notes").write_text("mine")

    def clean() -> set[str]:
        done = subprocess.run(["make", "clean"], cwd=tmp_path, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
        return {path.name for path in tmp_path.iterdir()}

    assert clean() == {"Makefile", "src", "tests", "scripts", "underlay", "install", "log"}
    assert (tmp_path / "install/notes").read_text() == "mine"
    assert not (tmp_path / "tests/__pycache__").exists()
    for mark in ("pyvenv.cfg", "setup/adopted"):  # made by hand; used by set-up
        (tmp_path / ".venv" / mark).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / ".venv" / mark).touch()
        assert ".venv" in clean()
    (tmp_path / ".venv/setup/adopted").unlink()
    (tmp_path / ".venv").rename(tmp_path / "shared")
    for link in (".venv", "build"):  # to what lies elsewhere
        (tmp_path / link).symlink_to("shared")
    (tmp_path / "shared/COLCON_IGNORE").touch()
    assert {".venv", "build"} < clean()
