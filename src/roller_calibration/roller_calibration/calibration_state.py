"""What an interrupted calibration has done so far, in a file beside its output."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from roller_core.calibration_file import CalibrationError
from roller_core.errors import UnwritableOutputError

from . import ErrorTable


class OtherInputsError(CalibrationError):
    """A state that belongs to another calibration."""


class SearchState:
    """A table of errors that outlives its process.

    Parameters
    ----------
    output : path or None
        File that the calibration writes; without one nothing is kept.
    key : mapping
        All that the errors depend on, JSON.
    """

    def __init__(self, output: Path | None, key: Mapping[str, Any]) -> None:
        self.path = output.with_name(output.name + ".state.npz") if output else None
        self._key = json.loads(json.dumps(key))

    def load(self, table: ErrorTable) -> bool:
        """Fill a table with what is known; whether there was anything.

        Raises
        ------
        OtherInputsError
            If the state isn't of the same recordings, settings and grid.
        """
        if self.path is None or not self.path.exists():
            return False
        try:
            with np.load(self.path, allow_pickle=False) as state:
                key = json.loads(str(state["key"]))
                errors, points = state["errors_m"], state["points"]
                pixels = state["pixels"]
        except (OSError, ValueError, KeyError, EOFError) as error:
            raise OtherInputsError(
                f"{self.path}: not the state of a calibration; delete it or leave out --resume"
            ) from error
        except Exception as error:  # zipfile's own errors, of a file that was cut off
            raise OtherInputsError(
                f"{self.path}: can't be read ({error}); delete it or leave out --resume"
            ) from error
        other = [name for name in self._key if key.get(name) != self._key[name]]
        if (
            other
            or errors.shape != table.errors_m.shape
            or not np.array_equal(pixels, table.pixels)
        ):
            raise OtherInputsError(
                f"{self.path}: the state is of other {', '.join(other) or 'windows'}; give the "
                "same, or leave out --resume to start anew"
            )
        table.errors_m[:], table.points[:] = errors, points
        return True

    def save(self, table: ErrorTable) -> None:
        """Keep a table.

        Raises
        ------
        UnwritableOutputError
            If it can't be written.
        """
        if self.path is None:
            return
        part = self.path.with_name(self.path.name + ".part")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as stream:
                np.savez(
                    stream, key=json.dumps(self._key), errors_m=table.errors_m,
                    points=table.points, pixels=table.pixels,
                )  # fmt: skip
            os.replace(part, self.path)
        except OSError as error:
            raise UnwritableOutputError(
                f"{self.path}: can't be written ({error.strerror})"
            ) from error

    def forget(self) -> None:
        """Delete the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)
