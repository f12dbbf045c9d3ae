"""What holds for every node: its names, its topics, and how it refuses bad parameters."""

import ast
import importlib
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from roller_core import outputs
from roller_core.errors import RollerError
from roller_recording.writing.recorder_settings import RecorderParameters
from roller_ros import stage_node, topics
from roller_ros.parameters import declare_settings

SRC = Path(__file__).resolve().parents[2] / "src"
#: A parameter file without a section for the robot.
OTHERS_FILE = SRC.parent / "config" / "emvs.yaml"
NODES = sorted(p for p in SRC.glob("*/*/**/*node.py") if "underlay" not in p.parts)
#: Methods that rclpy means to be extended.
EXTENDED = {"destroy_node"}


@pytest.fixture(scope="module")
def taken() -> set[str]:
    """Names that rclpy.Node uses itself."""
    context = Context()
    rclpy.init(context=context)
    node = Node("bare", context=context)
    names = set(dir(node))
    node.destroy_node()
    context.try_shutdown()
    return names


@pytest.mark.parametrize("path", NODES, ids=lambda p: p.stem)
def test_no_node_takes_a_name_of_rclpy(path: Path, taken: set[str]) -> None:
    """`self._parameters` is rclpy's own: with it taken, `ros2 param list` kills the node."""
    for kind in ast.walk(ast.parse(path.read_text())):
        if not isinstance(kind, ast.ClassDef):
            continue
        if not any(isinstance(base, ast.Name) and base.id.endswith("Node") for base in kind.bases):
            continue
        own = {item.name for item in kind.body if isinstance(item, ast.FunctionDef)}
        own |= {
            node.attr
            for node in ast.walk(kind)
            if isinstance(node, ast.Attribute)
            and isinstance(node.ctx, ast.Store)
            and isinstance(node.value, ast.Name)
            and node.value.id == "self"
        }
        assert not {n for n in own & taken if not n.startswith("__")} - EXTENDED


def test_topics_follow_a_namespace() -> None:
    """All but what cells share is relative; no node goes past the table."""
    absolute = {topic.name for topic in topics.ALL if topic.name.startswith("/")}
    assert absolute == {outputs.TF, outputs.TF_STATIC, outputs.DIAGNOSTICS}
    for path in NODES:
        assert not re.findall(r'"/(?:roller|event_camera)/\w+', path.read_text()), path


@pytest.fixture
def own_process_state() -> Iterator[None]:
    """A node's end leaves signals ignored, as its process is over then."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


SLOW_TO_END = """
import sys, time
from roller_ros.node import RollerNode
from roller_ros.node_main import run_node

class SlowNode(RollerNode):
    def __init__(self):
        super().__init__("slow")
        self.create_timer(0.05, lambda: print("ready", flush=True))

    def destroy_node(self):
        print("ending", flush=True)
        time.sleep(0.5)
        super().destroy_node()

code = run_node(SlowNode)
print("ended", flush=True)
time.sleep(0.5)  # as libraries do that end with the process
sys.exit(code)
"""


@pytest.mark.usefixtures("domain")
def test_signals_in_teardown_do_not_end_it_half_way() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_TO_END], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    asked = {"ready": [signal.SIGTERM]}
    asked |= {word: [signal.SIGTERM, signal.SIGINT] for word in ("ending", "ended")}
    for line in process.stdout:
        for number in asked.pop(line.strip(), []):
            process.send_signal(number)
    assert asked == {}
    assert process.wait(timeout=60) == 0


#: `PyDLL` keeps the interpreter's lock during the call, as Fast DDS does when it hangs.
HANGS_HALF_MADE = """
import ctypes, sys
from roller_core.errors import RollerError
from roller_ros.node import RollerNode
from roller_ros.node_main import run_node

class HalfNode(RollerNode):
    def __init__(self):
        super().__init__("half")
        self.create_timer(9.0, self.destroy_node)
        raise RollerError("no")

    def destroy_node(self):
        ctypes.PyDLL(None).sleep(60)

sys.exit(run_node(HalfNode))
"""


@pytest.mark.usefixtures("domain")
def test_a_node_whose_constructor_failed_leaves_in_time() -> None:
    ended = subprocess.run([sys.executable, "-c", HANGS_HALF_MADE], timeout=40, capture_output=True)
    assert (ended.returncode, ended.stderr) == (1, b"error: no\n")


@pytest.mark.usefixtures("own_process_state", "domain")
@pytest.mark.parametrize(
    "path", [p for p in NODES if "roller_ros" not in p.parts], ids=lambda p: p.stem
)
def test_any_node_may_fail_before_it_has_anything(
    path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise RollerError("no such parameter")

    module = importlib.import_module(f"{path.parent.name}.{path.stem}")
    for each in (module, stage_node):
        monkeypatch.setattr(each, "declare_settings", refuse, raising=False)
    monkeypatch.setattr("sys.argv", ["node"])
    for name in ("roller_inspect.inspect_node", "roller_braille.braille_node"):
        monkeypatch.setattr(f"{name}.give_way", lambda _: None)
    with pytest.raises(SystemExit) as end:
        module.main()
    assert (end.value.code, capsys.readouterr().err) == (1, "error: no such parameter\n")


@pytest.mark.usefixtures("own_process_state")
@pytest.mark.parametrize(
    ("module", "parameter", "message"),
    [
        ("roller_emvs.emvs_node", "paper.planes:=1", "planes"),
        ("roller_emvs.emvs_node", "depth_min_m:=0.05", "depth_min_m"),
        ("roller_emvs.emvs_node", "method:=magic", "method"),
        ("roller_emvs.emvs_node", "method:=surface", "it has a node of its own, 'surface'"),
        ("roller_emvs.surface_node", "depth_min_m:=0.05", "depth_min_m"),
        ("roller_recording.player_node", "bag:=/nowhere", "there is no such file or folder"),
        ("roller_recording.player_node", "rate:=1.0", "'bag' is empty"),
        ("roller_driver.ur10_node", f"hand_eye_file:={OTHERS_FILE}", "no camera's place on the"),
        ("roller_recording.recorder_node", "output:=/proc/nowhere", "can't be written"),
    ],
)
def test_bad_parameters_stop_a_node_with_one_line(
    module: str,
    parameter: str,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("sys.argv", ["node", "--ros-args", "-p", parameter])
    with pytest.raises(SystemExit) as end:
        importlib.import_module(module).main()
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert message in line


def test_a_parameter_that_is_none_of_the_nodes_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    context = Context()
    rclpy.init(context=context)
    given = [Parameter("queue_nb", value=1.0), Parameter("raw", value=True)]
    node = Node("recorder", context=context, parameter_overrides=given)
    assert declare_settings(node, RecorderParameters).raw
    node.destroy_node()
    context.try_shutdown()
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line.endswith("[recorder]: there is no parameter 'queue_nb'; is it 'queue_mb'?")


def test_a_section_that_is_called_nearly_as_the_node_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text("/**/recoder: {ros__parameters: {raw: true}}\nemvs: {ros__parameters: {a: 1}}")
    monkeypatch.setattr(sys, "argv", ["recorder", "--ros-args", "--params-file", str(file)])
    context = Context()
    rclpy.init(context=context)
    node = Node("recorder", context=context)
    declare_settings(node, RecorderParameters)
    node.destroy_node()
    context.try_shutdown()
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line.endswith(f"{file}: no node of ours is called '/**/recoder'; is it 'recorder'?")


@pytest.mark.usefixtures("own_process_state")
@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("depth_min_m: hello", "'depth_min_m' = 'hello': a number is expected"),
        ("pose_smoothing: 2.5", "'pose_smoothing' = 2.5: a whole number is expected"),
        ("average_flats: 0.5", "'average_flats' = 0.5: "),
        ("focus: {planes_per_px: many}", "'focus.planes_per_px' = 'many': a number is expected"),
    ],
)
def test_a_later_file_with_a_value_of_another_type_stops_a_node(
    given: str,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """ROS itself goes on with the earlier file's, and says nothing."""
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"/**/emvs: {{ros__parameters: {{{given}}}}}")
    files = ["--params-file", str(SRC.parent / "config" / "emvs.yaml"), "--params-file", str(mine)]
    monkeypatch.setattr("sys.argv", ["node", "--ros-args", *files])
    with pytest.raises(SystemExit) as end:
        importlib.import_module("roller_emvs.emvs_node").main()
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"error: parameters of node 'emvs': {says}")


def test_of_a_whole_and_a_broken_number_the_last_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("a", "100"), ("b", "50.5"), ("c", "2.5e2")):
        text = f"/**/recorder: {{ros__parameters: {{queue_mb: {value}}}}}"
        (tmp_path / f"{name}.yaml").write_text(text)
    for order, says in (("ab", 50.5), ("ba", 100.0), ("abc", 250.0), ("ca", 100.0)):
        words = ["recorder", "--ros-args"]
        for name in order:
            words += ["--params-file", str(tmp_path / f"{name}.yaml")]
        monkeypatch.setattr(sys, "argv", words)
        context = Context()
        rclpy.init(args=words, context=context)
        node = Node("recorder", context=context)
        settings = declare_settings(node, RecorderParameters)
        assert settings.queue_mb == node.get_parameter("queue_mb").value == says
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.usefixtures("own_process_state")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--params-file", "/"], "Couldn't parse params file: '--params-file /'"),
        (["-p", "rate:=["], "Couldn't parse parameter override rule"),
        (["--parms-file", "cell.yaml"], "no such --ros-args: ['--parms-file', 'cell.yaml']"),
        (["-r", "__ns:=/" + 300 * "n"], "namespace should not exceed"),
        (["-r", "__ns:=/" + 220 * "n"], "Invalid service name: topic length should not exceed"),
    ],
)
@pytest.mark.filterwarnings("ignore:Failed to fini")
def test_what_ros_refuses_stops_a_node_with_one_line(
    words: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("sys.argv", ["node", "--ros-args", *words])
    with pytest.raises(SystemExit) as end:
        importlib.import_module("roller_emvs.stitcher_node").main()
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert "a fault of roller" not in line
    assert len(line) < 300


def test_ros_is_started_in_one_place() -> None:
    """There it asks for shared memory, and Fast DDS takes what our profile says of memory."""
    found = [f for f in SRC.rglob("*.py") if "rclpy.init(" in f.read_text()]
    assert [f.name for f in found] == ["refusals.py"]
