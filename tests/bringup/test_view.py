"""The operator's page over HTTP, without a browser."""

import json
import os
import signal
import struct
import time
import tracemalloc

import numpy as np
import pytest
from roller_msgs.msg import FindingArray

from bringup.view_results import (
    BASE_FROM_MAP,
    DENT,
    cells_of,
    frames,
    get,
    serving,
    write_result,
)
from roller_bringup import cli
from roller_bringup.view import graph, health
from roller_bringup.view.findings import listed
from roller_bringup.view.grid import MEASURED, UNMEASURED, Grid
from roller_bringup.view.result import ResultError, read_result
from roller_bringup.view.scene import Scene
from roller_bringup.view.server import PageServer
from roller_bringup.view.tiles import TILE
from roller_core import outputs
from roller_core.errors import RollerError
from roller_core.outputs import Cloud, Output
from roller_emvs.ply import PlyWriter
from roller_inspect.inspect_stage import DEVIATION_FIELDS
from roller_inspect.results.result_writer import ResultBag


def unpacked(data: bytes) -> tuple[dict, dict]:
    """Header of an answer with tiles, and of each cell that is inside its state and values."""
    (size,) = struct.unpack("<I", data[:4])
    header, at, cells = json.loads(data[4 : 4 + size]), 4 + size, {}
    for tx, ty in header["tiles"]:
        layers = {}
        for name in header["layers"]:
            layers[name] = np.frombuffer(data, np.float32, TILE * TILE, at).reshape(TILE, TILE)
            at += 4 * TILE * TILE
        state = np.frombuffer(data, np.uint8, TILE * TILE, at).reshape(TILE, TILE)
        at += TILE * TILE
        for j, i in zip(*np.nonzero(state), strict=True):
            values = {name: layer[j, i] for name, layer in layers.items()}
            cells[tx * TILE + i, ty * TILE + j] = (state[j, i], values)
    assert at == len(data)
    return header, cells


def test_a_long_list_of_findings_is_read_now_and_then(monkeypatch):
    read, clock = [], [100.0]

    def message_of(data: bytes, _: object) -> FindingArray:
        read.append(data)
        clock[0] += 0.1  # what reading takes
        return FindingArray()

    monkeypatch.setattr(graph, "deserialize_message", message_of)
    monkeypatch.setattr(graph.time, "monotonic", lambda: clock[0])
    shown = graph.Graph.__new__(graph.Graph)
    shown._scene, shown._list, shown._list_due_s = Scene("live"), None, 0.0
    for number in range(100):
        shown._take_findings([b"older", b"%d" % number])
        shown._read_list()
        clock[0] += 0.1
    assert len(read) == 4
    clock[0] += 10.0
    shown._read_list()
    shown._read_list()
    assert read[-1] == b"99"  # the newest is read in the end, and once
    assert len(read) == 5


def test_what_can_not_be_shown_is_left_out_and_reported_once(capsys):
    shown = graph.Graph.__new__(graph.Graph)
    shown._not_shown = set()
    for _ in range(3):
        with shown._left_out("/surface/points"):
            raise KeyError("height")
    assert capsys.readouterr().err.count("messages of /surface/points can't be shown") == 1


@pytest.mark.parametrize("at_once", [3, 8])
def test_who_has_some_tiles_gets_the_rest(monkeypatch, at_once):
    monkeypatch.setattr("roller_bringup.view.scene._TILES_AT_ONCE", at_once)
    scene, seen, since, epoch = Scene("x"), {}, -1, ""
    scene.grid = Grid(1e-3)
    rng = np.random.default_rng(2)
    for k in range(30):
        x = rng.uniform(k * 0.02, k * 0.02 + 0.03, 500)
        scene.grid.add(x, rng.uniform(0, 0.01, 500), {"height": x.astype(np.float32)})
        if k % 7 == 3 or k == 29:
            more = True
            while more:
                header, cells = unpacked(scene.map_answer(epoch, since))
                since, epoch, more = header["revision"], header["epoch"], header["more"]
                seen |= {k: (v[0], float(v[1]["height"])) for k, v in cells.items()}
    assert seen.keys() == cells_of(scene.grid).keys()
    np.testing.assert_equal(seen, cells_of(scene.grid))
    assert not unpacked(scene.map_answer(epoch, since))[0]["tiles"]
    assert unpacked(scene.map_answer("another", since))[0]["tiles"]


def test_who_has_none_sees_at_once_where_the_scan_is(monkeypatch):
    monkeypatch.setattr("roller_bringup.view.scene._TILES_AT_ONCE", 8)
    scene = Scene("x")
    for x in np.arange(0.0, 0.3, 0.005) + 1e-4:
        scene.grid.add(np.array([x]), np.array([1e-4]), {"height": np.ones(1, np.float32)})
    newest = max(scene.grid.tiles)
    header, _ = unpacked(scene.map_answer("", -1))
    assert header["more"]
    assert len(header["tiles"]) == 8
    assert list(newest) in header["tiles"]


def test_an_answer_of_tiles_is_held_once():
    scene = Scene("x")
    x, y = np.mgrid[0:0.05:1e-4, 0:0.02:1e-4].reshape(2, -1)
    scene.grid.add(x, y, {"height": x.astype(np.float32)})
    tracemalloc.start()
    try:
        answer = scene.map_answer("", -1)
        assert tracemalloc.get_traced_memory()[1] < 1.3 * len(answer)
    finally:
        tracemalloc.stop()


def test_a_result_is_served(tmp_path):
    scene = read_result(write_result(tmp_path / "result"))
    with serving(scene) as server:
        state = next(frames(server))
        assert (state["big"]["word"], state["big"]["level"]) == ("NONCONFORM", "bad")
        found = json.loads(get(server, "/api/findings")[2])
        # Worst first: by verdict, then by depth.
        assert [f["id"] for f in found] == ["F2", "F3", "F1"]
        assert found[0]["at_m"] == pytest.approx(_on_grid(scene, DENT), abs=1e-9)
        header, cells = unpacked(get(server, "/api/map")[2])
        i, j = (int(v // header["cell_m"]) for v in found[0]["at_m"])
        assert cells[i, j][0] == MEASURED
        assert cells[i, j][1]["height"] == pytest.approx(-2.2e-4)
        assert cells[i, j][1]["sigma"] == pytest.approx(2e-5)
        assert sum(state == UNMEASURED for state, _ in cells.values()) == 30 * 95
        assert get(server, "/api/text")[2] == b"plate seven\n"
        status, headers, page = get(server, "/")
        assert status == 200
        assert "script-src 'self'" in headers["content-security-policy"]
        assert b"/page/main.js" in page
        assert get(server, "/page/main.js")[0] == 200


def _on_grid(scene: Scene, at: tuple[float, float]) -> np.ndarray:
    """A place of the file's map in that of the page."""
    place = np.linalg.inv(scene.base_from_map) @ BASE_FROM_MAP @ [*at, 0, 1]
    return place[:2]


def test_deviations_of_the_run_in_make_the_map_no_larger(tmp_path):
    folder = write_result(tmp_path / "result")
    bounds = read_result(folder).grid.bounds
    x = np.arange(-0.05, 0.03, 1e-4)
    xyz = np.column_stack([x, np.full((len(x), 2), 0.005)]) @ BASE_FROM_MAP[:3, :3].T
    rows = np.column_stack([xyz + BASE_FROM_MAP[:3, 3], x, x, np.full(len(x), 3)])
    cloud = Cloud(rows.astype(np.float32), DEVIATION_FIELDS)
    bag = ResultBag(folder / "result")
    bag.write(Output(outputs.DEVIATION, 1, "base", cloud))
    bag.close()
    grid = read_result(folder).grid
    assert "deviation" in grid.layers
    assert grid.bounds == bounds


def test_only_files_of_the_result_are_given_out(tmp_path):
    folder = write_result(tmp_path / "result")
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    (folder / "page.html").write_text("<script>1</script>")
    with serving(read_result(folder)) as server:
        listed_names = [entry["name"] for entry in json.loads(get(server, "/api/files")[2])]
        assert listed_names[0] == "page.html"  # what is read comes first
        names = set(listed_names)
        assert {"height_map.npz", "findings.csv", "page.html"} <= names
        assert get(server, "/files/findings.csv")[2] == b"id,kind\n"
        # What a result says runs apart from the page, and reaches nothing.
        assert "sandbox" in get(server, "/files/page.html")[1]["content-security-policy"]
        for name in (
            "../secret.txt",
            "..%2fsecret.txt",
            "%2e%2e/secret.txt",
            "/etc/passwd",
            "link.txt",
            ".roller-output.json",
            "nothing.txt",
            "",
        ):
            status, _, body = get(server, f"/files/{name}")
            assert (status, b"secret" in body) == (404, False), name
        assert get(server, "/page/../server.py")[0] == 404
        assert get(server, "/api/map?since=x")[0] == 400


def test_a_recording_that_needs_more_than_its_name_is_sent_to_replay(tmp_path, capsys):
    (tmp_path / "events.raw").write_bytes(b"% evt 3.0\n% format EVT3;height=480;width=640\n% end\n")
    assert cli.main(["view", str(tmp_path / "events.raw"), "--port", "0"]) == 1
    said = capsys.readouterr().err
    assert "give --poses FILE" in said
    assert "`roller replay` takes that: view the folder that it writes" in said
    (tmp_path / "other").mkdir()
    (tmp_path / "empty.mcap").touch()
    for name, says in (("other", "holds no rosbag2 storage"), ("empty.mcap", "is empty")):
        assert cli.main(["view", str(tmp_path / name), "--port", "0"]) == 1
        said = capsys.readouterr().err
        assert says in said
        assert "`roller replay` takes that" not in said
    assert cli.main(["view", str(tmp_path / "nothing"), "--port", "0"]) == 1
    assert capsys.readouterr().err.strip().endswith("there is no such file or folder")


def test_ctrl_c_is_how_the_page_ends(tmp_path, capsys):
    folder = write_result(tmp_path / "a")
    pages = []

    def serve(self):
        pages.append(self)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(PageServer, "run", serve)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            assert cli.main(["view", str(folder), "--port", "0"]) == 0
        finally:
            signal.signal(signal.SIGINT, before)
    assert len(pages) == 1
    assert capsys.readouterr().err == "ended\n"


def test_bad_results_are_one_line_or_a_note(tmp_path):
    with pytest.raises(ResultError, match="no result there"):
        read_result(tmp_path)
    folder = write_result(tmp_path / "a")
    (folder / "inspection.json").write_text('{"verdict": ')
    scene = read_result(folder)
    assert "inspection.json can't be read" in scene.notes[0]
    (folder / "height_map.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(RollerError, match=r"height_map\.npz: no height map can be read: no NumPy"):
        read_result(folder)
    assert cli.main(["view", str(tmp_path / "none"), "--port", "0"]) == 1


def test_a_replay_without_inspection_shows_its_surface(tmp_path):
    rng = np.random.default_rng(3)
    xyz = rng.uniform(0, 0.01, (500, 3))
    with PlyWriter(tmp_path / "surface.ply", ("height", "confidence")) as ply:
        ply.write(xyz, xyz[:, 2].astype(np.float32), np.ones(500, np.float32))
    scene = read_result(tmp_path)
    assert scene.grid.points == 500
    assert scene.state(0.0)["big"]["word"] == "RESULT"
    assert scene.state(0.0)["big"]["detail"] == "not inspected"


@pytest.mark.parametrize("bad", ["x", None, {"center_m": "a", "depth_m": float("nan"), "id": 7}])
def test_findings_that_are_none_spoil_nothing(bad):
    found = listed([bad] if isinstance(bad, dict) else [], np.eye(4))
    json.dumps(found, allow_nan=False)
    assert all("at_m" not in f and "depth_m" not in f for f in found)


def test_the_whole_in_a_word():
    def word(*nodes: health.Node, speed: float | None = 0.3) -> str:
        return health.overall({n.name: n for n in nodes}, speed, 100.0)["word"]

    well = health.Node("emvs: depth", 0, "running", seen_s=99.5)
    assert word() == "NO CELL"
    assert word(well) == "ROLLING"
    assert word(well, speed=0.0) == "STANDING"
    assert word(well, speed=None) == "WAITING"
    assert word(well, health.Node("ur10: robot", 2, "the robot stands", seen_s=99)) == "DATA BAD"
    gone = health.Node("braille: text", 0, "running", seen_s=90)
    assert word(well, gone) == "NODE LOST"
    assert gone.shown(100.0)["level"] == "gone"
    assert "start it again" in gone.shown(100.0)["advice"]
    done = health.Node("virtual_cell: scan", 0, "finished", seen_s=90)
    assert word(well, done) == "ROLLING"
    assert word(gone) == "STOPPED"
    bad = health.Node("event_camera: camera", 2, "looking for the camera", seen_s=99)
    assert "--camera" in bad.shown(100.0)["advice"]


def test_figures_that_are_no_numbers_are_none():
    """NaN in JSON would stop the page."""
    nodes = [health.Node("a", values={"rate": word}) for word in ("nan", "inf", "none", "5")]
    assert health.number(nodes[:3], "rate") is None
    assert health.number(nodes, "rate") == 5.0


@pytest.mark.parametrize(
    ("node", "said", "advice"),
    [
        ("event_camera: camera", "the camera sends nothing", "--camera"),
        ("event_camera: camera", "no DVXplorer Mini is plugged in (no USB device", "--camera"),
        ("ur10: robot", "robot 10.0.0.1:30004: it can't be reached (Connection", "--robot-ip"),
        ("ur10: robot", "robot 10.0.0.1: the connection was lost", "--robot-ip"),
        ("ur10: robot", "another node publishes tool0_controller on /tf too", "ROS_DOMAIN_ID"),
        ("ur10: robot", "26 poses were missed", "directly"),
        ("emvs: depth", "no poses base -> tool0_controller on /tf", "Start the robot's node"),
        ("emvs: depth", "data were lost", "USB 3"),
    ],
)
def test_what_nodes_say_has_its_advice(node, said, advice):
    assert advice in health.advice_for(node, said)
