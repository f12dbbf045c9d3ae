"""A disk that gets full costs what doesn't fit: one line, and what was written opens."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader, Writer

from recording.bags import write_bag
from roller_bringup.cli import main
from roller_core.errors import UnwritableOutputError
from roller_core.output_folder import OutputFolder
from roller_emvs.ply import read_ply
from roller_inspect.results.overview import draw_overview
from roller_recording.reading import open_recording


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 12 MB, of which the commands hold 8 for their end."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", str(folder)]
    try:
        subprocess.run(words, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("only root can mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_replay(small_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write_bag(tmp_path / "scan")
    words = ["replay", str(source), "--no-picture", "--method", "emvs"]
    assert main([*words, "--output", str(tmp_path / "whole")]) == 0
    with Writer(tmp_path / "none", version=9):
        pass
    assert draw_overview(tmp_path / "whole", source, bag=tmp_path / "none").exists()
    capsys.readouterr()
    results = tmp_path / "whole" / "surface.ply"
    # Room for half of the surface's points and no more.
    room = 12 * 1024**2 - 8_000_000 - results.stat().st_size // 2
    (small_disk / "other").write_bytes(bytes(room - 64 * 1024))
    assert main([*words, "--output", str(small_disk / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "can't be written (No space left on device)" in line
    out = small_disk / "out"
    assert f"error: {out}/" in line  # not the folder aside, which is gone
    assert ".roller-partial" not in line
    assert json.loads((out / "report.json").read_text())["faults"] == [line.split("error: ")[1]]
    found = read_ply(out / "surface.ply")
    assert 0 <= len(found["x"]) < len(read_ply(results)["x"])
    with Reader(out / "result") as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count


def test_inspect_judges_what_was_found_before(
    small_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = write_bag(tmp_path / "scan"), small_disk / "out"
    (small_disk / "other").write_bytes(bytes(12 * 1024**2 - 8_000_000 - 64 * 1024))
    assert main(["inspect", str(source), "--no-picture", "--output", str(out)]) == 1
    assert "can't be written (No space left on device)" in capsys.readouterr().err
    found = json.loads((out / "inspection.json").read_text())
    assert found["verdict"] != "conform"
    assert found["coverage"]["measured"] > 0
    assert len(found["faults"]) == 1


def test_a_folder_can_be_used_once_there_is_room(small_disk: Path) -> None:
    other = small_disk / "other"
    with other.open("wb", buffering=0) as file:
        while file.write(bytes(1000)) == 1000:
            pass
    with pytest.raises(UnwritableOutputError), OutputFolder(small_disk / "out", "replay"):
        pass
    assert [path.name for path in small_disk.iterdir()] == ["other"]
    other.unlink()
    with OutputFolder(small_disk / "out", "replay") as output:
        (output.partial / "report.json").write_text("{}")
    assert (small_disk / "out" / "report.json").exists()


def test_simulate(small_disk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "flat", "--set", "scene.step_mm=0.1", "--set", "clock.image_rate_hz=200"]
    assert main([*words, "--output", str(small_disk / "bag")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("the bag can't be written (No space left on device)")
    steps = list(open_recording(small_disk / "bag").steps())
    assert sum(len(step.events) for step in steps) > 1000
    assert not [fault for step in steps for fault in step.faults]


def test_record_leaves_no_empty_folder(small_disk: Path) -> None:
    from roller_core.bag_writer import BagWriter
    from roller_core.errors import UnwritableOutputError

    with open(small_disk / "other", "wb", buffering=0) as file:
        assert file.write(bytes(20_000_000)) < 20_000_000
    with pytest.raises(UnwritableOutputError, match="No space left on device"):
        BagWriter(small_disk / "bag", {})
    assert [path.name for path in small_disk.iterdir()] == ["other"]
