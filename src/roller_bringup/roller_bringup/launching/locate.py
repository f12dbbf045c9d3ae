"""Where packages and their executables are."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path


class NotFoundError(LookupError):
    """A package or an executable isn't installed."""


def prefixes() -> Iterator[Path]:
    """List install prefixes, the one that counts most first.

    That is the environment of this Python, then those a sourced workspace named in
    AMENT_PREFIX_PATH.
    """
    yield Path(sys.prefix)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix)


def package_prefix(package: str) -> Path:
    """Find the prefix a package is installed in.

    Raises
    ------
    NotFoundError
        It is in none.
    """
    for prefix in prefixes():
        if (prefix / "share/ament_index/resource_index/packages" / package).exists():
            return prefix
    raise NotFoundError(f"package '{package}' is not installed")


def package_share(package: str) -> Path:
    """Find share/<package>, where launch files and parameters are."""
    return package_prefix(package) / "share" / package


def executable(package: str, name: str) -> Path:
    """Find a node's executable.

    colcon installs it as lib/<package>/<name>; pip and uv put it into bin/, where it counts when
    the package has an entry point of that name.

    Raises
    ------
    NotFoundError
        The package or the executable isn't installed.
    """
    prefix = package_prefix(package)
    found = shutil.which(name, path=str(prefix / "lib" / package))
    if found is None and prefix == Path(sys.prefix):
        try:
            scripts = metadata.distribution(package).entry_points.select(group="console_scripts")
        except metadata.PackageNotFoundError:
            scripts = metadata.EntryPoints(())
        if name in scripts.names:
            found = shutil.which(name, path=str(prefix / "bin"))
    if found is None:
        raise NotFoundError(f"package '{package}' has no executable '{name}'")
    return Path(found)
