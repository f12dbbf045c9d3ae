"""The command: one line and an exit code, whatever it is given."""

import argparse
import errno
import os
import shlex
import signal
import subprocess
import sys
import types
from pathlib import Path

import pytest
from rclpy.exceptions import InvalidNamespaceException

from roller_bringup import cli
from roller_core.errors import TRACEBACK, RollerError
from roller_sim.commands import simulate

ROOT = Path(__file__).parents[2]


def run_with(monkeypatch, fault):
    """Run a subcommand that raises."""
    module = types.ModuleType("roller_command_of_a_test")

    def run(_args):
        raise fault

    module.add_parser = lambda subparsers: subparsers.add_parser("try").set_defaults(run=run)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(cli, "find_commands", lambda: {"try": module.__name__})
    return cli.main(["try"])


@pytest.mark.parametrize(
    ("fault", "code", "says"),
    [
        (RollerError("no bag"), 1, "error: no bag\n"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x" * 999), 1, ": File name too long"),
        (ImportError("No module named 'aedat'"), 1, "No module named 'aedat'; see what"),
        (MemoryError(), 1, "error: there is not enough memory\n"),
        (RuntimeError("Symlink loop from 'x'"), 1, "error: Symlink loop from 'x'\n"),
        (KeyError("x\ny"), 1, r"error: KeyError: 'x\ny' (a fault of roller: please report it;"),
        (
            UnicodeEncodeError("utf-8", "a\udcff", 1, 2, "surrogates not allowed"),
            1,
            r"error: 'a\udcff': a name that isn't UTF-8 can't be given there",
        ),
        (
            InvalidNamespaceException("/a b", "no spaces", 2),
            1,
            "error: Invalid namespace: no spaces",
        ),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
)
def test_every_fault_is_one_line(monkeypatch, capsys, fault, code, says):
    monkeypatch.delenv(TRACEBACK, raising=False)
    assert run_with(monkeypatch, fault) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n"), says in err) == ("", 1, True), err
    assert len(err) < 300


def test_a_fault_of_ours_can_be_seen_where_it_happened(monkeypatch):
    monkeypatch.setenv(TRACEBACK, "1")
    with pytest.raises(KeyError):
        run_with(monkeypatch, KeyError("x"))


def test_ctrl_c_while_a_command_is_loaded(monkeypatch, capsys):
    def interrupted(_name):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.importlib, "import_module", interrupted)
    assert cli.main(["info", "x"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


INTERRUPT = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"


def test_ctrl_c_while_python_starts(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPT)
    done = subprocess.run(
        [ROOT / "roller", "info", "x"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        # As at a terminal, even where the tests run in the background.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


IMPATIENT = """
import atexit, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # as at a terminal
from roller_bringup import cli
from roller_core import signals
signals._SAME_S = float("inf")  # on a machine as slow as may be
again = lambda: os.kill(os.getpid(), signal.SIGINT)
class Heard:
    def write(self, text):
        again()
        return sys.__stderr__.write(text)
    def flush(self):
        sys.__stderr__.flush()
class HalfMade:
    def __del__(self):
        raise AttributeError("not there yet")
def run(words):
    sys.stderr, half_made = Heard(), HalfMade()
    try:
        again()
    finally:
        again()
        print("cleaned up", flush=True)
cli._run = run
atexit.register(lambda: (again(), print("gone", flush=True)))
sys.exit(cli.main())
"""


def test_ctrl_c_again_and_again_is_one_line():
    """While a command cleans up, while it says so, and while Python ends."""
    done = subprocess.run(
        [sys.executable, "-c", IMPATIENT], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
    assert done.stdout == "cleaned up\ngone\n"


@pytest.mark.parametrize(
    "words",
    [
        [b"\xff"],
        ["info", b"\xff"],
        ["up", b"\xff"],
        ["up", b"a" * 5000],
        ["demo", "--scene", b"\xff"],
    ],
)
def test_names_that_are_none(words, tmp_path):
    command = [sys.executable, "-m", "roller_bringup.cli", *words]
    done = subprocess.run(command, capture_output=True, check=False, cwd=tmp_path)
    assert done.returncode in (1, 2)
    assert b"Traceback" not in done.stderr
    assert b"error: " in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_whoever_reads_may_go():
    code = f"import sys; {BROKEN}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (141, b"")


BROKEN = (
    "import os; r, w = os.pipe(); os.close(r); os.dup2(w, 1); "
    "from roller_bringup import cli; cli._run = lambda words: print('x', flush=True); "
    "sys.exit(cli.main())"
)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--scene", "nope"], "no scene 'nope'; there are demo, part, braille"),
        (["--scene", "mesh:none.stl"], "mesh none.stl: no such file"),
        (["--speed", "-1"], "'motion.speed' = -1.0"),
        (["--speed", "nan"], "'motion.speed' = nan"),
    ],
)
def test_the_demo_looks_at_what_it_is_given_first(tmp_path, capsys, words, says):
    earlier = tmp_path / "bag"
    earlier.mkdir()
    assert cli.main(["demo", "--output", str(tmp_path), *words]) == 1
    assert says in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["bag"]


def test_every_command_says_what_it_does():
    for name, module in cli.find_commands().items():
        parser = argparse.ArgumentParser()
        cli.importlib.import_module(module).add_parser(parser.add_subparsers())
        assert cli._summary(module), name


def _parsers(parser: argparse.ArgumentParser):
    """A parser and those of its subcommands."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for part in action.choices.values():
                yield from _parsers(part)


def test_every_command_has_examples_that_parse_and_a_short_o():
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers()
    modules = [cli.importlib.import_module(name) for name in cli.find_commands().values()]
    for module in modules:
        module.add_parser(commands)
    for part in _parsers(parser):
        known = part._option_string_actions
        assert known.get("-o") is known.get("--output"), part.prog
    for name, command in commands.choices.items():
        lines = [
            line.split("roller ", 1)[1]
            for part in _parsers(command)
            for line in (part.epilog or "").replace("\\\n", " ").splitlines()
            if line.strip().startswith(("roller ", "./roller "))
        ]
        assert lines, f"roller {name} --help shows no example"
        for line in lines:
            words = shlex.split(line, comments=True)
            for module in modules:
                words = getattr(module, "rewritten", list)(words)
            arguments = parser.parse_args(words)
            if name == "simulate":
                simulate.settings_from(arguments)


@pytest.mark.parametrize("words", [["--help"], ["calibrate", "--help"]])
def test_what_has_commands_of_its_own_shows_an_example_too(words, capsys):
    with pytest.raises(SystemExit):
        cli.main(words)
    assert "examples:\n  roller " in capsys.readouterr().out


def test_a_shell_completes_commands_and_options(tmp_path):
    pytest.importorskip("argcomplete")
    for line, expected in (
        ("roller rep", b"replay "),
        ("roller view --po", b"--port "),
        ("roller simulate hex", b"hexagon "),
    ):
        answer = tmp_path / "answer"
        environment = os.environ | {
            "_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(answer), "COMP_LINE": line,
            "COMP_POINT": str(len(line)), "COMP_TYPE": "9", "_ARGCOMPLETE_COMP_WORDBREAKS": " ",
        }  # fmt: skip
        subprocess.run([sys.executable, "-m", "roller_bringup.cli"], env=environment, check=False)
        assert answer.read_bytes() == expected


HEAVY = {"open3d", "matplotlib.pyplot", "rclpy"}


def test_what_commands_do_not_need_is_not_loaded():
    code = (
        "import sys, roller_bringup.cli as cli\n"
        "for name in ('replay', 'simulate', 'info', 'demo', 'doctor', 'up', 'view'):\n"
        "    try: cli.main([name, '--help'])\n"
        "    except SystemExit: pass\n"
        f"sys.exit(bool({HEAVY!r} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
