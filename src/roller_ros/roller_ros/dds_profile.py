"""The Fast DDS profile of a process."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

N = TypeVar("N")

#: The environment's variable that names it.
PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE"
_SEGMENT = re.compile(r"(<segment_size>)(\d+)(</segment_size>)")
_LARGEST = re.compile(r"<maxMessageSize>(\d+)</maxMessageSize>")


@contextmanager
def sharing_less(most_bytes: int = 0) -> Iterator[None]:
    """Have Fast DDS keep less shared memory than the profile says, for who sends little.

    Fast DDS touches all of it when the first node of a process is made, so what is never used
    counts too. That node is to be made within this context.

    Parameters
    ----------
    most_bytes : int
        What is enough. It stays large enough for one message of the largest size.
    """
    before = os.environ.get(PROFILE, "")
    text = _changed(Path(before), most_bytes)
    if not text:
        yield
        return
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        file.write(text)
        file.flush()
        os.environ[PROFILE] = file.name
        try:
            yield
        finally:
            os.environ[PROFILE] = before


def less_shared(make: Callable[[], N], most_bytes: int = 0) -> Callable[[], N]:
    """What makes a node, in a process that sends little; see `sharing_less`."""

    def made() -> N:
        with sharing_less(most_bytes):
            return make()

    return made


def _changed(profile: Path, most_bytes: int) -> str:
    """The profile with less shared memory; empty where there is nothing to change."""
    if not profile.is_file():
        return ""
    text = profile.read_text()
    segment, largest = _SEGMENT.search(text), _LARGEST.search(text)
    if segment is None or largest is None:
        return ""
    size = max(most_bytes, int(largest[1]))
    return _SEGMENT.sub(rf"\g<1>{size}\g<3>", text) if size < int(segment[2]) else ""
