"""Reports as JSON, which knows neither NaN nor arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any


def plain(value: Any) -> Any:
    """A value of what JSON takes: NaN becomes null, arrays and data classes become lists, dicts."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if hasattr(value, "__dataclass_fields__"):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def to_text(value: Any) -> str:
    """The text of a JSON file; bytes of file names that are no text are escaped."""
    text = json.dumps(plain(value), indent=1, ensure_ascii=False, default=str) + "\n"
    return text.encode(errors="backslashreplace").decode()
