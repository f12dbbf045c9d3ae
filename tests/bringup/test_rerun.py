"""Handing over to rerun: how its program is called; it isn't installed here."""

import socket
import sys
from pathlib import Path

import pytest

from roller_bringup.view import rerun

#: Notes its words; listens where it is told to, as the viewer does, until it was connected to.
PROGRAM = f"""#!{sys.executable}
import socket, sys
from pathlib import Path
words = sys.argv[1:]
Path(__file__).with_name("calls").open("a").write(" ".join(words) + chr(10))
if "--port" in words:
    server = socket.create_server((words[1], int(words[3])))
    server.accept()
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "rerun"
    path.write_text(PROGRAM)
    path.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        monkeypatch.setattr(rerun, "_PORT", free.getsockname()[1])
    return path


def test_a_result_is_converted_and_shown_to_this_machine_alone(
    program: Path, tmp_path: Path
) -> None:
    bag = tmp_path / "scan" / "result" / "result_0.mcap"
    bag.parent.mkdir(parents=True)
    bag.touch()
    assert rerun.hand_over(tmp_path / "scan") == 0
    convert, show = program.with_name("calls").read_text().splitlines()
    assert convert.startswith(f"mcap convert {bag} --output ")
    assert show.startswith("--bind 127.0.0.1 ")
    with pytest.raises(rerun.RerunError, match="no MCAP file in it"):
        rerun.hand_over(tmp_path)


def test_the_viewer_is_waited_for(program: Path) -> None:
    rerun._start_viewer(str(program))
    assert program.with_name("calls").read_text().startswith("--bind 127.0.0.1 --port ")


def test_a_viewer_that_does_not_start_is_told(program: Path) -> None:
    program.write_text("#!/bin/false\n")
    with pytest.raises(rerun.RerunError, match="doesn't start"):
        rerun._start_viewer(str(program))


def test_without_rerun_it_is_said_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.setattr(sys, "executable", "/nonexistent/python")
    with pytest.raises(rerun.RerunError, match=r"rerun isn't installed .*rerun-sdk"):
        rerun.hand_over(None)
