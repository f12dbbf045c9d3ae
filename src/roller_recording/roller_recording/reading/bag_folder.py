"""Which storage files a bag has, and in which order."""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

import zstandard

from roller_core.output_mark import entries_made
from roller_core.text_file import TextFileError, read_yaml

from .base import RecordingError, TruncatedRecordingError
from .storage import MCAP, ROS1, SQLITE

_ZSTD = ".zstd"
#: In a folder of results: the recording, of the demonstration; else the results as topics.
_BAGS_OF_RESULTS = ("bag", "result")
_KINDS = (MCAP, SQLITE, ROS1)


@dataclass
class BagFolder:
    """The storage files of a bag."""

    #: In order: what is read, and what it is called. They differ where a file was compressed as a
    #: whole; it is unpacked.
    files: list[tuple[Path, Path]] = field(default_factory=list)
    #: Messages that the metadata speak of.
    message_count: int | None = None
    #: What the recorder noted in the metadata.
    custom: dict[str, str] = field(default_factory=dict)
    #: What is odd and costs no data.
    notes: list[str] = field(default_factory=list)
    #: What is missing.
    faults: list[RecordingError] = field(default_factory=list)
    _unpacked: Any = None

    @classmethod
    def open(cls, path: Path) -> BagFolder:
        """Find the files of a bag: of a folder, or the one that is named.

        Raises
        ------
        RecordingError
            If there are none.
        """
        if not path.exists():
            raise RecordingError(f"{path}: there is no such file or folder")
        folder = cls()
        found = [path] if path.is_file() else sorted(path.iterdir(), key=_order)
        found = [file for file in found if _kind(file)]
        if path.is_dir():
            found = folder._as_listed(path, found)
        made = entries_made(path) if not found and path.is_dir() else {}
        if bags := [path / name for name in _BAGS_OF_RESULTS if name in made]:
            raise RecordingError(
                f"{path}: holds results and is no recording itself; the bag in it is {bags[0]}"
            )
        if not found:
            raise RecordingError(
                f"{path}: holds no rosbag2 storage (.mcap or .db3) and is no ROS 1 bag (.bag); "
                "read are also AEDAT4 (.aedat4), Prophesee (.raw, EVT 3.0) and DSEC (.h5) files "
                "and folders with events.txt"
            )
        if len({_kind(file) for file in found}) > 1:
            raise RecordingError(
                f"bag {path}: holds both .mcap and .db3 files and no metadata.yaml that says "
                "which count; name one file"
            )
        folder.files = [(folder._plain(file), file) for file in found]
        return folder

    def _as_listed(self, path: Path, found: list[Path]) -> list[Path]:
        """The files that metadata.yaml names, as far as it can be trusted."""
        names = self._read_metadata(path / "metadata.yaml")
        if not names:
            return found
        there = {file.name: file for file in found}
        listed = [there[name] for name in names if name in there]
        missing = [name for name in names if name not in there]
        if not listed:
            if found:
                self.notes.append(f"metadata.yaml names other files ({', '.join(missing)})")
            return found
        self.faults += [
            RecordingError(f"bag {path}: {name} is missing; the other files are read")
            for name in missing
        ]
        # A recording that was ended before it could write its metadata again.
        newest, kind = _order(listed[-1]), _kind(listed[-1])
        later = [
            f
            for f in found
            if _kind(f) == kind and _order(f)[0] == newest[0] and _order(f) > newest
        ]
        if later:
            self.notes.append(
                f"metadata.yaml doesn't name {', '.join(f.name for f in later)}; read as well"
            )
        return listed + later

    def _read_metadata(self, path: Path) -> list[str]:
        """Names of files as metadata.yaml has them; none if it is no help."""
        if not path.is_file():
            self.notes.append("there is no metadata.yaml; was the recording ended early?")
            return []
        try:
            data = read_yaml(path)["rosbag2_bagfile_information"]
            names = [PurePath(name).name for name in data["relative_file_paths"]]
            count = int(data["message_count"])
            custom = {str(k): str(v) for k, v in (data.get("custom_data") or {}).items()}
        except (TextFileError, ValueError, LookupError, TypeError, AttributeError) as error:
            reason = f"({error})" if isinstance(error, TextFileError) else "as a bag's"
            self.notes.append(f"metadata.yaml can't be read {reason}; done without it")
            return []
        self.message_count, self.custom = count, custom
        return names

    def _plain(self, file: Path) -> Path:
        """The file itself, or what it is when unpacked."""
        if file.suffix != _ZSTD:
            return file
        if self._unpacked is None:
            self._unpacked = tempfile.TemporaryDirectory(prefix="roller-")
        out = Path(self._unpacked.name) / file.stem
        try:
            with open(file, "rb") as packed, open(out, "wb") as plain:
                zstandard.ZstdDecompressor().copy_stream(packed, plain)
        except zstandard.ZstdError as error:
            self.faults.append(
                TruncatedRecordingError(
                    f"bag {file}: can't be unpacked to its end ({error}); what came before is kept"
                )
            )
        except OSError as error:
            raise RecordingError(
                f"bag {file}: can't be unpacked to {out.parent} ({error.strerror}); "
                "set TMPDIR to a folder with room"
            ) from error
        return out


def _kind(file: Path) -> str:
    """Which storage a file is; empty if none."""
    suffix = Path(file.stem).suffix if file.suffix == _ZSTD else file.suffix
    return suffix if suffix in _KINDS else ""


def _order(file: Path) -> tuple[str, int]:
    """Series and number: bag_10 comes after bag_9."""
    match = re.fullmatch(r"(.*?)_(\d+)", file.name.split(".")[0])
    return (match[1], int(match[2])) if match else (file.name.split(".")[0], -1)
