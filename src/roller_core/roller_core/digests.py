"""SHA-256 of plain data and of packages' source: what tells results, and what made them, apart."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from functools import cache
from pathlib import Path
from typing import Any


def data_digest(value: Any) -> str:
    """Digest of plain data, the same in every process and whatever the order of keys."""
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def source_digest(*packages: str) -> str:
    """Digest of packages' source: what older code left is made again."""
    found = hashlib.sha256()
    for package in packages:
        spec = importlib.util.find_spec(package)
        for folder in (spec.submodule_search_locations or []) if spec else []:
            for file in sorted(Path(folder).rglob("*.py")):
                found.update(file.relative_to(folder).as_posix().encode() + file.read_bytes())
    return found.hexdigest()
