"""Python libraries: are they there, and in versions that work."""

from __future__ import annotations

import importlib
import importlib.util
import platform
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import metadata

from .result import Level, Result, ok

_PYTHONS = ">=3.10,<3.14"


@dataclass(frozen=True)
class Library:
    """A library that the workspace uses."""

    #: Its name in Python and on PyPI.
    module: str
    package: str
    #: What needs it; empty: everything.
    purpose: str = ""
    #: Versions that work, as pip writes them; empty: any.
    versions: str = ""
    #: Takes so long to import that only its place is looked up.
    slow: bool = False
    #: Versions of Python that it has wheels for, as far as that is not all.
    pythons: str = ""


#: As in requirements.in.
LIBRARIES = (
    Library("numpy", "numpy", versions="<2.5"),
    Library("scipy", "scipy", versions="<1.18"),
    Library("numba", "numba"),
    Library("pydantic", "pydantic", versions=">=2"),
    Library("yaml", "pyyaml"),
    Library("cv2", "opencv-contrib-python-headless", versions="<5"),
    Library("open3d", "open3d-cpu", slow=True),
    Library("rosbags", "rosbags"),
    Library("mcap", "mcap"),
    Library("usb", "pyusb", "drivers of the event camera"),
    Library("rtde_receive", "ur-rtde", "poses of the robot", pythons="<3.13"),
    Library("aedat", "aedat", "replays of AEDAT4 files"),
    Library("PIL", "pillow", "overview pictures"),
    Library("matplotlib", "matplotlib", "pictures of evaluations", slow=True),
    Library("rich", "rich", "tables and progress"),
)


def find_version(library: Library) -> str:
    """Version of a library; empty where it doesn't say.

    Raises
    ------
    ImportError
        If it isn't there or can't be loaded.
    """
    if library.slow:
        if importlib.util.find_spec(library.module) is None:
            raise ImportError(f"No module named '{library.module}'")
        module = None
    else:
        module = importlib.import_module(library.module)
    try:
        return metadata.version(library.package)
    except metadata.PackageNotFoundError:
        return str(getattr(module, "__version__", ""))


def find_libraries(
    find: Callable[[Library], str] = find_version,
) -> dict[Library, str | ImportError]:
    """Version of each library, or why it can't be loaded."""
    found: dict[Library, str | ImportError] = {}
    for library in LIBRARIES:
        try:
            found[library] = find(library)
        except ImportError as error:
            found[library] = error
    return found


def judge_libraries(
    found: Mapping[Library, str | ImportError], python: str = platform.python_version()
) -> Result:
    """Whether all libraries are there, in versions that work."""
    levels, wrong, advice = [], [], []
    if not _fits(python, _PYTHONS):
        levels.append("fault")
        wrong.append(f"Python {python}, known to work is {_PYTHONS}")
    for library, version in found.items():
        if isinstance(version, ImportError):
            levels.append("warning" if library.purpose else "fault")
            need = f"; {library.purpose} need it" if library.purpose else ""
            if not _fits(python, library.pythons):
                wrong.append(
                    f"{library.package} has wheels for Python {library.pythons} alone{need}"
                )
                continue
            wrong.append(f"{library.package} can't be loaded ({version}){need}")
            advice.append(library.package)
        elif library.versions and not _fits(version, library.versions):
            levels.append("warning")
            wrong.append(f"{library.package} {version}, known to work is {library.versions}")
            advice.append(f"'{library.package}{library.versions}'")
    if not wrong:
        some = ", ".join(f"{lib.package} {v}" for lib, v in list(found.items())[:3])
        return ok("libraries", f"Python {python}, {len(found)} libraries: {some}…")
    level: Level = "fault" if "fault" in levels else "warning"
    repair = f"run `make setup`, or pip install {' '.join(advice)}" if advice else ""
    return Result("libraries", level, "; ".join(wrong), repair)


def _fits(version: str, versions: str) -> bool:
    """Whether a version is among those named, by its leading numbers (`>=`, `<`)."""
    number = _numbers(version)
    for bound in versions.split(","):
        if bound.startswith(">=") and number < _numbers(bound[2:]):
            return False
        if bound.startswith("<") and number >= _numbers(bound[1:]):
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    found = re.match(r"\d+(\.\d+)*", version)
    return tuple(int(part) for part in found.group().split(".")) if found else ()
