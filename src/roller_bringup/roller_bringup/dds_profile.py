"""The Fast DDS profile of a process."""

from __future__ import annotations

import atexit
import os
import re
import tempfile
from pathlib import Path

#: The environment's variable that names it.
PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE"


def listen_only() -> None:
    """Have Fast DDS keep as little shared memory as it can, in a process that publishes nothing."""
    profile = Path(os.environ.get(PROFILE, ""))
    if not profile.is_file():
        return
    text = profile.read_text()
    largest = re.search(r"<maxMessageSize>(\d+)</maxMessageSize>", text)
    if largest is None:
        return
    text = re.sub(
        r"<segment_size>\d+</segment_size>", f"<segment_size>{largest[1]}</segment_size>", text
    )
    with tempfile.NamedTemporaryFile("w", suffix=".xml", delete=False) as file:
        file.write(text)
    os.environ[PROFILE] = file.name
    atexit.register(Path(file.name).unlink, missing_ok=True)
