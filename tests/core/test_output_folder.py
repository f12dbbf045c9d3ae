"""What a user has is never deleted: output folders are ours, whole, and have one writer."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from roller_core.errors import UnwritableOutputError
from roller_core.marked_file import SEAL, write_marked_file
from roller_core.output_folder import OutputFolder, release_reserve
from roller_core.output_mark import MARK
from roller_core.output_overlap import refuse_overlap

FILES = {"report.json": "first", "result/bag.mcap": "messages"}


def fill(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def contents(folder: Path) -> dict[str, str]:
    """Text by name of all files but our own marks."""
    return {
        str(file.relative_to(folder)): file.read_text()
        for file in folder.rglob("*")
        if file.is_file() and not file.name.startswith(".roller")
    }


def made(folder: Path, files: dict[str, str] = FILES) -> Path:
    with OutputFolder(folder, "replay") as output:
        fill(output.partial, files)
    return folder


def break_off(folder: Path, files: dict[str, str], publish: bool = False) -> None:
    """A run that an exception ends."""
    with OutputFolder(folder, "replay") as output:
        fill(output.partial, files)
        if publish:
            output.publish()
        raise RuntimeError


def write_into_the_way(folder: Path) -> None:
    with OutputFolder(folder, "replay") as output:
        fill(output.partial, {"overview.png": "ours"})
        fill(folder, {"overview.png": "theirs"})


def test_a_later_run_replaces_what_an_earlier_one_made(tmp_path: Path) -> None:
    folder = made(tmp_path / "deep" / "out", {**FILES, "overview.png": "picture"})
    fill(folder, {"notes.txt": "the user's"})
    made(folder, {"report.json": "second", "result/other.mcap": "more"})
    assert contents(folder) == {
        "report.json": "second", "result/other.mcap": "more", "notes.txt": "the user's",
    }  # fmt: skip
    assert sorted(os.listdir(folder)) == [
        ".roller-output.json", ".roller-output.lock", "notes.txt", "report.json", "result",
    ]  # fmt: skip


def test_what_another_command_made_stays(tmp_path: Path) -> None:
    folder = made(tmp_path / "out")
    with OutputFolder(folder, "evaluate") as output:
        fill(output.partial, {"index.html": "page", "report.json": "second"})
    assert contents(folder) == FILES | {"index.html": "page", "report.json": "second"}


def test_what_another_command_made_stays_run_after_run(tmp_path: Path) -> None:
    folder = made(tmp_path / "out", {"scan.mcap": "recording", "truth.yaml": "truth"})
    theirs = contents(folder)
    for text, lasting in (("first", ["passes"]), ("second", ["passes"]), ("third", [])):
        with OutputFolder(folder, "batch", lasting=lasting) as output:
            fill(output.partial, {f"{text}.html": text})
        assert contents(folder) == theirs | {f"{text}.html": text}
    with pytest.raises(KeyboardInterrupt), OutputFolder(folder, "bench", lasting=["scans"]):
        raise KeyboardInterrupt
    made(folder, {"scan.mcap": "another"})
    assert contents(folder) == {"scan.mcap": "another", "third.html": "third"}


def test_a_result_never_mixes_with_another_commands(tmp_path: Path) -> None:
    folder = made(tmp_path / "out")
    for _ in range(2):
        with (
            pytest.raises(UnwritableOutputError, match="`roller replay`, of which this one"),
            OutputFolder(folder, "demo", always=["report.json"]) as output,
        ):
            fill(output.partial, {"report.json": "second"})
        assert contents(folder) == FILES
    with OutputFolder(folder, "replay", always=["report.json"]) as output:
        fill(output.partial, {"report.json": "second"})
    assert contents(folder) == {"report.json": "second"}


def test_entries_of_which_an_older_mark_does_not_say_whose_they_are_stay(tmp_path: Path) -> None:
    folder = made(tmp_path / "out")
    mark = json.loads((folder / ".roller-output.json").read_text())
    del mark["makers"]
    (folder / ".roller-output.json").write_text(json.dumps(mark | {"command": "replay"}))
    made(folder, {"index.html": "page"})
    assert contents(folder) == FILES | {"index.html": "page"}
    with (
        pytest.raises(UnwritableOutputError, match="of an older version of roller"),
        OutputFolder(folder, "replay", always=["report.json"]),
    ):
        pass


def test_nothing_is_seen_before_it_is_whole_and_a_fault_leaves_the_old(tmp_path: Path) -> None:
    folder = made(tmp_path / "out")
    with pytest.raises(RuntimeError):
        break_off(folder, {"report.json": "second"})
    assert contents(folder) == FILES
    with pytest.raises(RuntimeError):
        break_off(tmp_path / "new", FILES)
    assert not (tmp_path / "new").exists()
    with pytest.raises(RuntimeError):
        break_off(folder, {"report.json": "up to the fault"}, publish=True)
    assert contents(folder) == {"report.json": "up to the fault"}


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda f: fill(f, {"thesis.tex": "years"}), "holds files that roller did not write"),
        (lambda f: fill(f, {MARK: "{}", "mine.txt": "x"}), "holds files that roller did not"),
        (lambda f: fill(made(f), {"result/bag.mcap": "edited"}), "result: was changed since"),
        (lambda f: fill(made(f), {"result/mine.txt": "added"}), "result: was changed since"),
        (lambda f: fill(f, {".roller-partial/mine.txt": "x"}), "stands in the way"),
        (lambda f: f.write_text("a file"), "is a file"),
        (lambda f: (f.mkdir(), os.mkfifo(f / MARK)), "holds files that roller did not write"),
    ],
)
def test_what_is_not_ours_is_refused_and_left(prepare, message: str, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "out"
    prepare(folder)
    before = contents(tmp_path)
    with pytest.raises(UnwritableOutputError) as caught, OutputFolder(folder, "replay"):
        pass
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == before


def test_a_new_folder_may_hold_nothing(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with OutputFolder(tmp_path / "empty", "simulate", new=True) as output:
        fill(output.partial, FILES)
    with (
        pytest.raises(UnwritableOutputError, match="is there already"),
        OutputFolder(tmp_path / "empty", "simulate", new=True),
    ):
        pass
    assert contents(tmp_path / "empty") == FILES


def test_what_comes_in_the_way_meanwhile_stays_and_so_do_the_results(tmp_path: Path) -> None:
    folder = made(tmp_path / "out")
    with pytest.raises(UnwritableOutputError, match=r"the results are in \S+/result_20"):
        write_into_the_way(folder)
    (kept,) = folder.glob("result_20*")
    assert contents(kept) == {"overview.png": "ours"}
    assert contents(folder) == FILES | {
        "overview.png": "theirs",
        f"{kept.name}/overview.png": "ours",
    }


def test_input_and_output_never_overlap(tmp_path: Path) -> None:
    bag = tmp_path / "data" / "bag"
    fill(bag, {"bag.mcap": "messages"})
    (tmp_path / "link").symlink_to(tmp_path / "data")
    for output in (
        bag, bag.parent, bag / "out", tmp_path / "link", tmp_path / "link" / "bag" / "new" / "out",
    ):  # fmt: skip
        for source in (bag, tmp_path / "link" / "bag"):
            with pytest.raises(UnwritableOutputError, match="overlaps with the input"):
                refuse_overlap(source, output)
    with pytest.raises(UnwritableOutputError, match="overlaps"):
        refuse_overlap(bag / "bag.mcap", tmp_path / "link")
    refuse_overlap(bag, tmp_path / "data" / "bag2")
    refuse_overlap(bag / "bag.mcap", bag / "out")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:")
    with pytest.raises(UnwritableOutputError, match="overlaps"):
        refuse_overlap(bag / "bag.mcap", bag / "out")
    (bag / "metadata.yaml").unlink()
    with (
        pytest.raises(UnwritableOutputError, match="overlaps"),
        OutputFolder(bag / "out", "replay", [None, bag]),
    ):
        pass
    assert contents(tmp_path / "data") == {"bag/bag.mcap": "messages"}
    assert not (bag / "out").exists()


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    with OutputFolder(tmp_path / "out", "replay") as output:
        fill(output.partial, FILES)
        with (
            pytest.raises(UnwritableOutputError, match="another roller command writes there"),
            OutputFolder(tmp_path / "out", "replay"),
        ):
            pass
    assert contents(tmp_path / "out") == FILES


@pytest.mark.parametrize("at", ["writing", "os.rename", "os.replace", "shutil.rmtree"])
def test_a_killed_run_leaves_a_whole_result(at: str, tmp_path: Path) -> None:
    """Killed while writing: the old. Killed while entries are moved: the next run finishes."""
    folder = made(tmp_path / "out", FILES | {"overview.png": "old"})
    program = f"""
import os, shutil, signal, sys
from pathlib import Path
from roller_core.output_folder import OutputFolder
def kill(*a, **k): os.kill(os.getpid(), signal.SIGKILL)
with OutputFolder(Path({str(folder)!r}), "replay") as output:
    (output.partial / "report.json").write_text("second")
    (output.partial / "result").mkdir()
    (output.partial / "result" / "bag.mcap").write_text("other messages")
    if {at!r} == "writing": kill()
    module, name = {at!r}.split(".")
    real, left = getattr(globals()[module], name), [2]
    def later(*a, **k):
        left[0] -= 1
        return real(*a, **k) if left[0] > 0 else kill()
    setattr(globals()[module], name, later if module == "os" else kill)
"""
    ended = subprocess.run([sys.executable, "-c", program], check=False)
    assert ended.returncode == -signal.SIGKILL
    if at == "writing":
        assert contents(folder / ".roller-partial")  # and what a user sees is the old
    with pytest.raises(RuntimeError):
        break_off(folder, FILES)  # comes to nothing, but puts the earlier one in order
    expected = {"report.json": "second", "result/bag.mcap": "other messages"}
    if at == "writing":
        expected = FILES | {"overview.png": "old"}
    assert contents(folder) == expected
    assert not (folder / ".roller-partial").exists()


def test_a_lasting_folder_is_kept_from_run_to_run(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    for text in ("first", "second"):
        with OutputFolder(folder, "bench", lasting=["scans"]) as output:
            fill(output.partial, {f"scans/{text}.txt": text, "bench.json": text})
    with pytest.raises(RuntimeError), OutputFolder(folder, "bench", lasting=["scans"]):
        raise RuntimeError
    assert contents(folder) == {
        "scans/first.txt": "first", "scans/second.txt": "second", "bench.json": "second",
    }  # fmt: skip
    fill(folder, {"passes/mine.txt": "the user's"})
    with (
        pytest.raises(UnwritableOutputError, match="stands in the way"),
        OutputFolder(folder, "bench", lasting=["passes"]),
    ):
        pass
    assert contents(folder)["passes/mine.txt"] == "the user's"


def test_the_reserve_is_given_back_once(tmp_path: Path) -> None:
    with OutputFolder(tmp_path / "out", "replay") as output:
        (reserve,) = (p for p in output.partial.parent.iterdir() if p.stat().st_size > 1_000_000)
        release_reserve(output.partial)
        assert not reserve.exists()
        fill(output.partial, FILES)
    release_reserve(tmp_path / "out")
    assert contents(tmp_path / "out") == FILES


def test_a_single_file_replaces_only_one_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "sphere.yaml"
    for n in (1, 2):
        write_marked_file(path, f"# roller calibrate\n{n}", "# roller calibrate")
    assert contents(tmp_path) == {"sphere.yaml": "# roller calibrate\n2"}
    fill(tmp_path, {"mine.yaml": "emvs: {}"})
    with pytest.raises(UnwritableOutputError, match="so it stays; the results are in"):
        write_marked_file(tmp_path / "mine.yaml", "# roller calibrate", "# roller calibrate")
    assert contents(tmp_path)["mine.yaml"] == "emvs: {}"
    assert "# roller calibrate" in contents(tmp_path).values()


def test_a_sealed_file_stays_where_it_was_changed_since(tmp_path: Path) -> None:
    path, mark = tmp_path / "cell.yaml", "# roller calibrate"
    for n in (1, 2):
        write_marked_file(path, f"{mark}\n# {SEAL}\ndepth: {n} µm\n", mark)
    written = path.read_text()
    assert written.startswith(f"{mark}\n# as written: sha256 ")
    assert SEAL not in written
    for changed in (written.replace("2 µm", "9 µm"), written + "mine: 1\n"):
        path.write_text(changed)
        with pytest.raises(UnwritableOutputError, match="changed since roller wrote it, so it st"):
            write_marked_file(path, f"{mark}\n# {SEAL}\nthird", mark)
        assert path.read_text() == changed
    write_marked_file(path, f"{mark}\nfourth", mark, known=True)
    assert path.read_text() == f"{mark}\nfourth"
    write_marked_file(path, f"{mark}\nfifth", mark)
    assert "fifth" in path.read_text()


def test_a_single_file_takes_no_pipes_place_and_waits_for_none(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "endless").symlink_to("/dev/zero")
    for name in ("pipe", "folder", "endless"):
        with pytest.raises(UnwritableOutputError, match="is there and is no file"):
            write_marked_file(tmp_path / name, "# roller", "# roller")
    assert sorted(os.listdir(tmp_path)) == ["endless", "folder", "pipe"]


def test_a_fault_names_no_folder_that_goes(tmp_path: Path) -> None:
    with (
        pytest.raises(UnwritableOutputError, match=r"out/bag: the disk is full$") as caught,
        OutputFolder(tmp_path / "out", "replay") as output,
    ):
        raise UnwritableOutputError(f"{output.partial / 'bag'}: the disk is full")
    assert ".roller-partial" not in str(caught.value)
