"""Files that are none: each is refused in one line, and nothing waits for its end."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import yaml

from roller_core.camera import Camera
from roller_core.errors import RollerError, SettingsError
from roller_core.parameter_files import (
    SECTIONS,
    clashing_parameters,
    misspelt_section,
    node_name,
    passed_over_section,
    read_parameters,
    read_sections,
)
from roller_emvs.depth_settings import DepthSettings
from roller_recording.reading.tum import read_tum
from roller_sim.errors import TruthError
from roller_sim.truth_files import load_truth

BOMB = ["a0: &a0 [x, x]", *(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 60))]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("\n".join(BOMB), "line 2: aliases"),
        ("emvs: &e {ros__parameters: {}, inner: *e}", "line 1: aliases"),
        ("[" * 5000, "line 1: nested too deeply"),
        ("emvs:\n  a: " + "{b: " * 99 + "1" + "}" * 99, "line 2: nested too deeply"),
        ("emvs: [1", "line 1: not a YAML file"),
        ("emvs: 1\nsurface: [1\n", "line 2: not a YAML file"),
        ("emvs: " + "9" * 5000, "not a YAML file .*digits"),
        ("emvs: 2026-02-31", "not a YAML file .*day is out of range"),
        ("x" * 10_000_001, "over 10000000 bytes"),
    ],
)
def test_what_is_written_is_bounded(text: str, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    with pytest.raises(SettingsError, match=reason) as refused:
        read_sections(file)
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("read", [read_sections, Camera.from_yaml, read_tum])
def test_pipes_devices_and_folders(read: Callable[[Path], object], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (
        (tmp_path / "pipe", "not a file"),
        (Path("/dev/zero"), "not a file"),
        (tmp_path, "Is a directory"),
    ):
        with pytest.raises(RollerError, match=reason):
            read(path)


@pytest.mark.parametrize("name", ["truth.yaml", "truth.npz"])
def test_a_truth_that_is_a_pipe(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    if name == "truth.npz":
        grid = {"file": name, "x0": 0, "y0": 0, "step": 1}
        (tmp_path / "truth.yaml").write_text(yaml.safe_dump({"grid": grid}))
    with pytest.raises(TruthError, match=r"no truth\.yaml|no such file"):
        load_truth(tmp_path)


def test_all_of_our_sections_are_known() -> None:
    config = Path(__file__).parents[2] / "config"
    found = {node_name(k) for file in config.glob("*.yaml") for k in read_sections(file)}
    assert found - {"**"} <= set(SECTIONS)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        (["/**/emvz", "/**/braille"], "called '/**/emvz'; is it 'emvs'?"),
        (["stitch", "camera_of_theirs"], "called 'stitch'; is it 'stitcher'?"),
        (["/left/theirs", "other"], "is for a node of ours; there are /left/theirs, other"),
        (["/left/emvs", "theirs"], ""),
        (["/**", "theirs"], ""),
        (["/**/calibration"], ""),
        ([], ""),
    ],
)  # fmt: skip
def test_a_misspelt_section_is_named(sections: list[str], said: str, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(yaml.safe_dump({name: {"ros__parameters": {"a": 1}} for name in sections}))
    found = misspelt_section(file, SECTIONS)
    assert said in found
    assert bool(found) == bool(said)


@pytest.mark.parametrize(
    ("sections", "node", "said"),
    [
        (["emvs"], "/left/emvs", "'emvs' doesn't hold for /left/emvs: call the section '/**/emvs'"),
        (["/right/emvs", "/left/braille"], "/left/emvs", "'/right/emvs' doesn't hold"),
        (["/*/emvs"], "/emvs", "'/*/emvs' doesn't hold"),
        (["/right/emvs", "left/emvs"], "/left/emvs", ""),
        (["/**/emvs"], "/left/emvs", ""),
        (["/**/emvs"], "/emvs", ""),
        (["/*/emvs"], "/left/emvs", ""),
        (["emvs"], "/emvs", ""),
        (["/**", "braille"], "/left/emvs", ""),
    ],
)
def test_a_section_for_another_namespace_is_named(
    sections: list[str], node: str, said: str, tmp_path: Path
) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(yaml.safe_dump({name: {"ros__parameters": {"a": 1}} for name in sections}))
    found = passed_over_section(file, node)
    assert said in found
    assert bool(found) == bool(said)


@pytest.mark.parametrize(
    ("sections", "holds"),
    [
        (["/left/emvs", "/right/emvs"], None),
        (["/a/b/emvs", "/**/emvs", "/a/emvs"], None),
        (["/left/emvs", "left/emvs", "/**/emvs", "/right/surface"], 2),
        (["/**/emvs", "/*/emvs", "emvs"], 2),
    ],
)
def test_which_of_two_cells_is_meant_is_not_guessed(
    sections: list[str], holds: int | None, tmp_path: Path
) -> None:
    file = tmp_path / "params.yaml"
    entries = {name: {"ros__parameters": {"threads": k}} for k, name in enumerate(sections)}
    file.write_text(yaml.safe_dump(entries, sort_keys=False))
    if holds is None:
        with pytest.raises(SettingsError, match="of two cells"):
            read_parameters(file, "emvs")
    else:
        assert read_parameters(file, "emvs") == {"threads": holds}


def test_of_values_of_two_types_the_last_is_known(tmp_path: Path) -> None:
    texts = {
        "ours": "/**/emvs: {ros__parameters: {d: 0.5, n: 8, focus: {p: 1.0}, l: [1.0], s: a}}",
        "mine": "/**/emvs: {ros__parameters: {d: x, n: 9, focus: {p: 2}, l: [1], s: b}}",
        "all": "/**: {ros__parameters: {d: true}}",
        "left": "left: {emvs: {ros__parameters: {d: 7}}}",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)

    def found(*names: str, node: str = "/emvs", also: Sequence[str] = ()) -> dict[str, object]:
        words = [w for name in names for w in ("--params-file", str(tmp_path / name))]
        return clashing_parameters(["node", "--ros-args", *words, *also], node)

    assert found("ours", "mine") == {"d": "x", "focus.p": 2, "l": [1]}
    assert found("mine", "ours") == {"d": 0.5, "focus.p": 1.0, "l": [1.0]}
    # Sections of other names are no clash to ROS: the one that is named later counts.
    assert found("ours", "all") == found("ours", "left") == {}
    assert found("ours", "mine", "all")["d"] is True
    assert found("all", "ours", "mine")["d"] == "x"
    assert found("all", also=("-p", "d:=1")) == {"d": 1}
    assert found("all", also=("-p", "d:=1e-3")) == {"d": 1e-3}
    for words in ("d:=[", "d:=2026-02-31"):
        assert found("all", also=("-p", words, "--param", "s:=b")) == {}
    assert found("ours", also=("-p", "/**/emvs:d:=2")) == {"d": 2}
    assert found("ours", "mine", node="/left/emvs") == {"d": "x", "focus.p": 2, "l": [1]}
    assert found("ours", "mine", node="/stitcher") == {}


def test_text_that_looks_like_a_number_comes_back_as_it_was_written(tmp_path: Path) -> None:
    """A skin may be called 7e2; a parameter 43e-3 is a number to its settings all the same."""
    file = tmp_path / "cell.yaml"
    data = {"emvs": {"ros__parameters": {"depth_min_m": "43e-3", "skin": "7e2"}}}
    file.write_text(yaml.safe_dump(data))
    read = read_parameters(file, "emvs")
    assert read == data["emvs"]["ros__parameters"]
    assert DepthSettings.create({"depth_min_m": read["depth_min_m"]}).depth_min_m == 0.043
