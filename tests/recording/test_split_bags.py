"""Bags in several files."""

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer

from recording.bags import Recipe, bag_messages, events_in, scan, write_messages
from roller_recording.raw_message import RawMessage
from roller_recording.reading.bag_folder import BagFolder
from roller_recording.reading.bag_reader import BagReader
from roller_recording.reading.base import RecordingError

MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


def split(folder: Path, storage: StoragePlugin, parts: int) -> Path:
    """A bag in several files, as `ros2 bag record --max-bag-size` makes them."""
    suffix = ".mcap" if storage == MCAP else ".db3"
    items = list(bag_messages(Recipe()))
    size = -(-len(items) // parts)
    folder.mkdir()
    names = []
    for k in range(parts):
        part = folder.parent / f"part{k}"
        writer = Writer(part, version=9, storage_plugin=storage)
        write_messages(writer, items[k * size : (k + 1) * size])
        names.append(f"bag_{k}{suffix}")
        shutil.move(part / f"part{k}{suffix}", folder / names[-1])
        metadata = yaml.safe_load((part / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    information |= {"relative_file_paths": names, "message_count": len(items)}
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    return folder


@pytest.mark.parametrize("storage", [MCAP, SQLITE])
@pytest.mark.parametrize("metadata", [True, False])
def test_a_bag_in_several_files(metadata: bool, storage: StoragePlugin, tmp_path: Path) -> None:
    bag = split(tmp_path / "bag", storage, 12)  # bag_10 comes after bag_9
    if not metadata:
        (bag / "metadata.yaml").unlink()
    assert events_in(bag) == len(scan())


def test_a_split_bag_with_parts_missing_or_cut(tmp_path: Path) -> None:
    bag = split(tmp_path / "bag", MCAP, 6)
    (bag / "bag_1.mcap").unlink()
    cut = bag / "bag_3.mcap"
    cut.write_bytes(cut.read_bytes()[:-3000])
    reader = BagReader(bag)
    found = list(reader.messages(set(reader.topics)))
    faults = [str(item) for item in found if not isinstance(item, RawMessage)]
    assert len(faults) == 2
    assert "bag_1.mcap is missing; the other files are read" in faults[0]
    assert re.search(r"bag_3.mcap: cut off at byte \d+", faults[1])
    last = [item for item in found if isinstance(item, RawMessage)][-1]
    assert last.t_ns == list(bag_messages(Recipe()))[-1][0]


def test_files_that_the_metadata_do_not_know_yet(tmp_path: Path) -> None:
    bag = split(tmp_path / "bag", MCAP, 3)
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())
    names = metadata["rosbag2_bagfile_information"]["relative_file_paths"]
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = names[:1]
    (bag / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    shutil.copyfile(bag / names[0], bag / "backup.mcap")  # no part of the bag
    assert events_in(bag) == len(scan())
    assert "doesn't name bag_1.mcap, bag_2.mcap; read as well" in BagReader(bag).notes[0]


def test_a_folder_of_results_names_the_bag_in_it(tmp_path):
    for name in ("result", "bag"):  # of a replay; of the demonstration, beside it
        (tmp_path / name).mkdir()
        made = {"made_by": "roller", "format": 1, "made": {name: "x", "report.json": "y"}}
        (tmp_path / ".roller-output.json").write_text(json.dumps(made))
        with pytest.raises(RecordingError, match=f"the bag in it is {tmp_path / name}$"):
            BagFolder.open(tmp_path)
