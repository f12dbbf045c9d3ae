"""The doctor's checks of software and machine, each with faults put in."""

import json
from pathlib import Path

import pytest

from roller_bringup.cli import main
from roller_bringup.doctor import clock, examination, libraries, machine, ros
from roller_bringup.doctor.result import Result

ROOT = Path(__file__).parents[2]


# Libraries.


def test_libraries_of_this_environment_are_fine():
    result = libraries.judge_libraries(libraries.find_libraries())
    assert result.level in ("OK", "warning")  # ur-rtde has no wheels for every Python
    assert "numpy can't" not in result.found


@pytest.mark.parametrize(
    ("missing", "level", "says"),
    [
        ("numpy", "fault", "numpy can't be loaded (No module named 'numpy')"),
        ("ur-rtde", "warning", "poses of the robot need it"),
    ],
)
def test_a_missing_library(missing, level, says):
    def find(library):
        if library.package == missing:
            raise ImportError(f"No module named '{library.module}'")
        return "1.0"

    result = libraries.judge_libraries(libraries.find_libraries(find), "3.11.2")
    assert result.level == level
    assert says in result.found
    assert missing in result.advice


def test_a_library_without_wheels_for_this_python():
    rtde = next(lib for lib in libraries.LIBRARIES if lib.package == "ur-rtde")
    result = libraries.judge_libraries(
        {rtde: ImportError("No module named 'rtde_receive'")}, "3.13.5"
    )
    assert result.level == "warning"
    assert "has wheels for Python <3.13 alone; poses of the robot need it" in result.found
    assert not result.advice


@pytest.mark.parametrize(
    ("version", "level"), [("2.4.9", "OK"), ("2.5.0", "warning"), ("3.0rc1", "warning")]
)
def test_a_library_that_is_too_new(version, level):
    numpy = next(lib for lib in libraries.LIBRARIES if lib.package == "numpy")
    result = libraries.judge_libraries({numpy: version}, "3.11.2")
    assert result.level == level
    assert ("numpy<2.5" in result.advice) == (level == "warning")


@pytest.mark.parametrize("python", ["3.9.18", "3.14.0"])
def test_a_python_that_is_too_old_or_new(python):
    assert libraries.judge_libraries({}, python).level == "fault"


def test_bounds_are_those_of_the_requirements():
    lines = (ROOT / "requirements.in").read_text().splitlines()
    wanted = {line.split("#")[0].split(";")[0].strip() for line in lines}
    for library in libraries.LIBRARIES:
        if "<" in library.versions:
            assert library.package + library.versions in wanted
        else:
            assert library.package in wanted


# ROS.


def test_ros_by_its_facts():
    good = ros.RosFacts("jazzy", "", "rmw_fastrtps_cpp")
    assert ros.judge_ros(good) == Result("ROS 2", "OK", "jazzy, rmw_fastrtps_cpp")
    wheels = ros.judge_ros(ros.RosFacts("", "9.1.2", "rmw_fastrtps_cpp"))
    assert (wheels.level, "not for a cell" in wheels.found) == ("OK", True)
    for facts, level, says in (
        (ros.RosFacts(fault="ImportError: no rclpy"), "fault", "no rclpy"),
        (ros.RosFacts("jazzy", "", "rmw_cyclonedds_cpp"), "warning", "rmw_cyclonedds_cpp"),
        (ros.RosFacts("humble", "", "rmw_fastrtps_cpp"), "warning", "humble"),
        (ros.RosFacts("jazzy", "", "rmw_fastrtps_cpp", missing=("tf2_msgs",)), "fault", "tf2_msgs"),
    ):
        result = ros.judge_ros(facts)
        assert result.level == level, facts
        assert says in result.found
        assert result.advice


def test_ros_of_this_environment():
    pytest.importorskip("rclpy")
    assert ros.judge_ros(ros.find_ros()).level != "fault"


def test_rviz():
    assert ros.judge_rviz("/opt/ros/jazzy/bin/rviz2").level == "OK"
    assert ros.judge_rviz("").level == "warning"


# USB and camera.


def test_the_disk_is_written_and_left_as_it_was(tmp_path):
    there, free, rate, error = machine.measure_disk(tmp_path / "not" / "yet", probe_bytes=2 << 20)
    assert (there, error) == (str(tmp_path), "")
    assert free > 0
    assert rate > 0
    assert not list(tmp_path.iterdir())
    assert machine.check_disk(*machine.measure_disk(Path("/proc/nowhere"))).level == "fault"


@pytest.mark.parametrize(
    ("facts", "level"),
    [
        ((500e9, 400e6), "OK"),
        ((500e9, 20e6), "warning"),
        ((10e9, 400e6), "warning"),
        ((0.5e9, 400e6), "fault"),
        ((0.0, 0.0, "Permission denied"), "fault"),
    ],
)
def test_disk_by_its_facts(facts, level):
    result = machine.check_disk("/d", *facts)
    assert result.level == level
    assert bool(result.advice) == (level != "OK")


@pytest.mark.parametrize(
    ("cores", "memory", "level"),
    [(8, 16e9, "OK"), (2, 16e9, "warning"), (8, 3e9, "warning"), (8, 1e9, "fault"), (8, 0, "OK")],
)
def test_machine_by_its_facts(cores, memory, level):
    assert machine.check_machine(cores, memory).level == level


def test_machine_of_this_test(tmp_path):
    assert machine.cores() >= 1
    assert machine.free_memory() > 1e8
    (tmp_path / "meminfo").write_text("MemTotal: x\n")
    assert machine.free_memory(str(tmp_path / "meminfo")) == 0


@pytest.mark.parametrize(
    ("facts", "level", "says"),
    [
        (clock.ClockFacts(True, 0.002, 3.0, 0.0), "OK", "error below 2.0 ms"),
        (clock.ClockFacts(False, 16.0, 3.0, 0.0), "warning", "not set by NTP or PTP"),
        (clock.ClockFacts(None, 0.0, 3.0, 0.0), "OK", "+3.0 ppm"),
        (clock.ClockFacts(True, 0.002, -480.0, 0.0), "warning", "it is being pulled: -480"),
        (clock.ClockFacts(True, 0.002, 3.0, -0.5), "fault", "jumped by -0.500 s"),
        (clock.ClockFacts(False, 16.0, 3.0, 0.0, 1970), "fault", "it shows the year 1970"),
    ],
)
def test_clock_by_its_facts(facts, level, says):
    result = clock.judge_clock(facts)
    assert result.level == level
    assert says in result.found


def test_clock_from_two_readings():
    before = clock.Reading(1_700_000_000_000_000_000, 5_000_000_000, 4_000_000_000)
    # Two seconds later: NTP pulls by 100 ppm, and somebody set the clock back by an hour.
    after = clock.Reading(1_700_000_002_000_200_000 - 3600 * 10**9, 7_000_200_000, 6_000_000_000)
    facts = clock.find_clock(before, after)
    assert facts.rate_ppm == pytest.approx(100.0)
    assert facts.step_s == pytest.approx(-3600.0)


# All of it.


def test_what_cannot_be_imported_spoils_its_own_check_alone(monkeypatch, tmp_path):
    def broken(request, share):
        raise ImportError("No module named 'usb'")
        yield

    kept = {"machine": examination._CHECKS["machine and disk"]}
    monkeypatch.setattr(examination, "_CHECKS", {"camera": broken, **kept})
    results = list(examination.examine(examination.Request(output=tmp_path)))
    assert [r.name for r in results] == ["camera", "machine", "disk"]
    assert (results[0].level, "No module named 'usb'" in results[0].found) == ("fault", True)


def test_json_and_the_exit_code(monkeypatch, capsys, tmp_path):
    def say(*results):
        checks = {r.name: (lambda request, share, r=r: iter([r])) for r in results}
        monkeypatch.setattr(examination, "_CHECKS", checks)

    say(Result("disk", "OK", "5 µm"), Result("camera", "warning", "none", "plug it in"))
    assert main(["doctor", "--json"]) == 0
    out = capsys.readouterr().out
    assert "µm" in out
    found = json.loads(out)
    assert (found["faults"], found["warnings"]) == (0, 1)
    assert found["checks"][1] == {
        "name": "camera", "level": "warning", "found": "none", "advice": "plug it in",
    }  # fmt: skip
    say(Result("disk", "fault", "[full]", "make room"))
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    for word in ("disk", "fault", "[full]", "make room"):
        assert word in out


def test_what_is_asked_for_reaches_the_checks(monkeypatch):
    seen = []

    def take(request, share):
        seen.append(request)
        return iter(())

    monkeypatch.setattr(examination, "_CHECKS", {"x": take})
    assert main(["doctor"]) == 0
    assert main(["doctor", "--camera", "--robot-ip", "10.0.0.9", "--output", "/data"]) == 0
    assert main(["doctor", "--camera", "A7"]) == 0
    assert [r.camera for r in seen] == [None, "", "A7"]
    assert [r.robot_ip for r in seen] == ["", "10.0.0.9", ""]
    assert seen[1].output == Path("/data")
