"""Starting, watching and stopping processes."""

import io
import os
import signal
import subprocess
import sys
import time

import pytest

from roller_bringup import launching
from roller_bringup.commands import up
from roller_bringup.launching import LaunchError, Runner
from roller_bringup.launching.plan import NodeProcess
from roller_bringup.launching.process import RunningProcess, Screen
from waiting import wait_until

#: For scripts: wait until the node `forever` is ready to be ended.
AFTER = 'until [ -e "$(dirname "$0")/ready" ]; do sleep 0.02; done; '
LOOP = "echo process $$; echo ready; while :; do sleep 0.02; done"
FOREVER = "trap 'echo bye; exit 0' INT TERM; touch ${0%/*}/ready; " + LOOP
STUBBORN = "trap '' INT; " + LOOP
DEAF = "trap '' INT TERM; " + LOOP


def node(name, required=False):
    on_exit = 'on_exit="shutdown"' if required else ""
    return f'<node pkg="demo" exec="{name}" name="{name}" {on_exit}/>'


def run(world, body, grace_s=5.0, **arguments):
    text = io.StringIO()
    code = launching.run(
        launching.load(world.launch(body), arguments), Screen(text), grace_s=grace_s
    )
    return code, text.getvalue()


def test_ends_well_when_all_do(world):
    code, text = run(world, node("talker"))
    assert code == 0
    assert "[talker] hello\n" in text
    assert "[launch] talker finished\n" in text


@pytest.mark.parametrize(
    ("end", "code", "says"),
    [
        ("echo done", 0, "[last] done\n"),
        ("echo oh >&2; exit 3", 1, "[last] oh\n[launch] last failed with exit code 3\n"),
        ("kill -SEGV $$", 1, "last was ended by SIGSEGV"),
    ],
)
def test_a_required_nodes_end_stops_all_and_its_failure_is_ours(world, end, code, says):
    world.script("forever", FOREVER)
    world.script("last", AFTER + end)
    found, text = run(world, node("forever") + node("last", required=True))
    assert found == code
    assert says in text
    assert "[forever] bye\n" in text


def test_another_nodes_failure_is_reported_and_the_rest_goes_on(world):
    world.script("bad", "touch ${0%/*}/ready; exit 3")
    world.script("short", AFTER + "sleep 0.4")
    code, text = run(world, node("bad") + node("short", required=True))
    assert code == 0
    assert text.index("bad failed with exit code 3") < text.index("short finished")


def test_harder_signals_follow_and_nothing_stays(world):
    world.script("stubborn", STUBBORN)
    world.script("deaf", f"sleep 1000 & echo child $!; {DEAF}")
    text = io.StringIO()
    world.script("slow", "trap 'sleep 0.9; echo finished; exit 0' INT; " + LOOP)
    slow = node("slow").replace("/>", 'sigterm_timeout="60"/>')
    plan = launching.load(world.launch(node("stubborn") + node("deaf") + slow))
    runner = Runner(plan, Screen(text), grace_s=0.3)
    runner.start()
    wait_until(lambda: text.getvalue().count("ready") == 3)
    assert runner.poll() is None
    assert runner.stop() == 1
    assert runner.exit_codes == {
        "stubborn": -signal.SIGTERM, "deaf": -signal.SIGKILL, "slow": 0,
    }  # fmt: skip
    assert "[slow] finished" in text.getvalue()
    assert "stubborn still runs; sending SIGTERM" in text.getvalue()
    assert "deaf still runs; sending SIGKILL" in text.getvalue()
    child = int(text.getvalue().split("child ")[1].split()[0])
    wait_until(lambda: not alive(child))


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_ctrl_c_while_a_nodes_python_starts(tmp_path):
    """It ends as asked, and without a traceback."""
    (tmp_path / "sitecustomize.py").write_text("import os; os.kill(os.getpid(), 2)")
    code = "from roller_core.signals import load_and_run; load_and_run('json')"
    env = os.environ | {"PYTHONPATH": str(tmp_path)}
    text = io.StringIO()
    process = RunningProcess(
        NodeProcess("emvs", (sys.executable, "-c", code), env, ours=True), Screen(text)
    )
    wait_until(lambda: process.poll() is not None)
    assert process.poll() == -signal.SIGINT
    assert text.getvalue().splitlines()[1:] == []


def test_what_a_finished_node_left_running_is_ended(world):
    world.script("parent", "sleep 1000 & echo child $!")
    code, text = run(world, node("parent"))
    assert code == 0
    child = int(text.split("child ")[1].split()[0])
    wait_until(lambda: not alive(child))


def test_starting_fails_whole(world):
    world.script("forever", FOREVER)
    world.script("nothing", "").write_text("#!/no/such/program\n")
    text = io.StringIO()
    runner = Runner(launching.load(world.launch(node("forever") + node("nothing"))), Screen(text))
    with pytest.raises(LaunchError, match="can't start"):
        runner.start()
    assert runner.exit_codes.keys() == {"forever"}


def test_colours_only_on_a_terminal(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    Screen(terminal).line("a", "text")
    assert terminal.getvalue() == "\x1b[36m[a]\x1b[0m text\n"


def test_a_screen_that_nobody_reads_any_more_stops_nothing(world):
    closed = io.StringIO()
    closed.close()
    with pytest.raises(ValueError, match="closed"):
        closed.write("x")
    gone = io.StringIO()
    screen = Screen(gone)
    gone.close()
    assert launching.run(launching.load(world.launch(node("talker"))), screen) == 0


WITHIN = """
import signal, sys, time
# As at a terminal, even where the tests run under nohup or in the background.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from roller_core.signals import terminate_in_order
from roller_bringup.launching import Runner, load
with terminate_in_order(), Runner(load(sys.argv[1]), grace_s=float(sys.argv[2])) as runner:
    while runner.poll() is None:
        time.sleep(0.05)
"""


def start(world, body, code=None, *words):
    """`roller up` in a process of its own, or a program with a file and some words; once ready.

    Gives the process, and that of the node, which says its number.
    """
    what = ["-m", "roller_bringup.cli", "up"] if code is None else ["-c", code]
    process = subprocess.Popen(
        [sys.executable, *what, str(world.launch(body)), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "AMENT_PREFIX_PATH": str(world.prefix)},
        start_new_session=True,
    )
    lines = [""]
    while "ready" not in lines[-1]:
        lines.append(process.stdout.readline())
    return process, next(int(line.split()[-1]) for line in lines if "] process " in line)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_ends_well_on_a_signal(world, number):
    world.script("forever", FOREVER)
    process, _ = start(world, node("forever", required=True))
    # As a terminal does it: to the whole foreground group.
    os.killpg(process.pid, number)
    rest, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (0, ""), rest
    assert "[forever] bye" in rest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_no_node_running(world, number):
    world.script("forever", FOREVER)
    process, child = start(world, node("forever"), WITHIN, "5")
    process.send_signal(number)
    rest, errors = process.communicate(timeout=20)
    assert "[forever] bye" in rest
    assert "KeyboardInterrupt" in errors or "Terminated" in errors
    assert not alive(child)


def test_signals_while_stopping_leave_no_node_running(world):
    world.script("deaf", DEAF)
    process, child = start(world, node("deaf"), WITHIN, "60")
    while process.poll() is None:
        process.send_signal(signal.SIGTERM)
        time.sleep(0.3)
    process.communicate()
    wait_until(lambda: not alive(child))


def test_a_launcher_that_is_killed_leaves_no_node_running(world):
    world.script("forever", FOREVER)
    process, child = start(world, node("forever"))
    process.kill()
    process.wait()
    wait_until(lambda: not alive(child))
    process.communicate()


PATIENT = """
import sys
from roller_bringup.launching import load, run
sys.exit(run(load(sys.argv[1]), grace_s=600.0))
"""


def test_a_second_signal_hurries(world):
    world.script("deaf", DEAF)
    process, child = start(world, node("deaf"), PATIENT)
    while alive(child):  # not the launcher: at its very end a signal has its usual effect
        process.send_signal(signal.SIGINT)
        time.sleep(0.1)
    process.communicate()
    assert process.returncode == 1
    assert not alive(child)


def test_up_finds_files_and_arguments(world, capsys, monkeypatch):
    path = world.launch('<arg name="who" description="whom"/><arg name="b" default="2"/>')
    parser = up.argparse.ArgumentParser()
    up.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["up", str(path), "--show-args"])
    assert arguments.run(arguments) == 0
    assert capsys.readouterr().out == (
        "Arguments of test.launch.xml (name:=value):\n"
        "  who (must be given)\n      whom\n  b (default: '2')\n"
    )
    assert up.split(["a:=1", "b:=x:=y", "c:="]) == {"a": "1", "b": "x:=y", "c": ""}
    for words, reason in ((["a=1"], "write name:=value"), (["a:=1", "a:=2"], "given twice")):
        with pytest.raises(LaunchError, match=reason):
            up.split(words)
    with pytest.raises(LaunchError, match=r"there is no launch file nope; ours are .*virtual"):
        up.find("nope")
    assert up.find("virtual").name == "virtual.launch.xml"
    assert up.find("cell.launch.xml").name == "cell.launch.xml"
