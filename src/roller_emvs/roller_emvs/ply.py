"""A point cloud file that grows as patches come, so no scan has to fit in memory."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from roller_core.errors import UnwritableOutputError

_COUNT_WIDTH = 12
_LONGEST_HEADER = 10_000


class PlyWriter:
    """Writes a binary PLY of float64 positions and float32 properties, patch by patch.

    The header holds the count of what is complete after every patch, so a run that is cut short
    leaves a file that opens.

    Parameters
    ----------
    path : path
        File to write.
    properties : tuple of str
        Names of the float32 properties that follow x, y, z.
    comment : str
        One line for the header.

    Raises
    ------
    UnwritableOutputError
        If the file can't be created.
    """

    def __init__(self, path: Path | str, properties: tuple[str, ...], comment: str = "") -> None:
        self.count = 0
        self._kind = np.dtype(
            [(n, "<f8") for n in ("x", "y", "z")] + [(n, "<f4") for n in properties]
        )
        lines = ["ply", "format binary_little_endian 1.0"]
        lines += [f"comment {comment}"] if comment else []
        head = "\n".join([*lines, "element vertex "])
        names = [f"property double {n}" for n in ("x", "y", "z")]
        names += [f"property float {n}" for n in properties]
        self._path = path
        self._end = 0
        try:
            self._file = open(path, "wb", buffering=0)  # noqa: SIM115 (closed by close)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            self._append(head.encode())
            self._count_at = self._end
            self._append(
                (f"{0:<{_COUNT_WIDTH}}\n" + "\n".join([*names, "end_header"]) + "\n").encode()
            )
        except OSError as error:
            self._file.close()
            raise self._unwritable(error) from error

    def write(self, points: npt.NDArray[np.float64], *properties: npt.NDArray[np.float32]) -> None:
        """Append points, shape (n, 3), and their properties, each shape (n,).

        Raises
        ------
        UnwritableOutputError
            If the disk doesn't take them; the file then ends with the patch before.
        """
        if not len(points):
            return
        rows = np.empty(len(points), self._kind)
        names = self._kind.names or ()
        for name, column in zip(names, [*points.T, *properties], strict=True):
            rows[name] = column
        end, count = self._end, self.count + len(points)
        try:
            self._append(rows.tobytes())
            self._write_count(count)
        except OSError as error:
            self._end = end
            with suppress(OSError):
                self._write_count(self.count)
                self._file.truncate(end)
            raise self._unwritable(error) from error
        self.count = count

    def _write_count(self, count: int) -> None:
        self._file.seek(self._count_at)
        self._file.write(f"{count:<{_COUNT_WIDTH}}".encode())

    def _unwritable(self, error: OSError) -> UnwritableOutputError:
        return UnwritableOutputError(f"{self._path}: can't be written ({error.strerror})")

    def _append(self, data: bytes) -> None:
        """Write at the end; a full disk takes part of it before it says so."""
        self._file.seek(self._end)
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
        self._end += len(data)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def __enter__(self) -> PlyWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def ply_rows(path: Path | str) -> npt.NDArray[np.void]:
    """Rows of a PLY file as `PlyWriter` writes it, read from the disk as they are looked at.

    Raises
    ------
    ValueError
        If it isn't such a file, or ends early.
    """
    with open(path, "rb") as file:
        head = file.read(_LONGEST_HEADER)
    end = head.find(b"end_header\n") + len(b"end_header\n")
    if not head.startswith(b"ply\n") or end < len(b"end_header\n"):
        raise ValueError(f"{path} is no PLY file")
    kinds = {"double": "<f8", "float": "<f4"}
    fields, count = [], 0
    for line in head[:end].decode(errors="replace").splitlines():
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[0] == "property":
            if words[1] not in kinds:
                raise ValueError(f"{path} holds '{line}', which isn't read")
            fields.append((words[2], kinds[words[1]]))
    if not count:
        return np.empty(0, np.dtype(fields))
    return np.memmap(path, np.dtype(fields), "r", end, (count,))


def read_ply(path: Path | str) -> dict[str, npt.NDArray[np.float64]]:
    """Columns of a PLY file as `PlyWriter` writes it, by property name."""
    rows = ply_rows(path)
    return {name: rows[name].astype(np.float64) for name in rows.dtype.names or ()}
