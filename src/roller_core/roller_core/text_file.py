"""Text and YAML of files that a user names: bounded, and never waited for without end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from .errors import RollerError

#: Largest file of settings: a thousand times ours.
_MOST_BYTES = 10_000_000
#: Collections within collections of a YAML file, at most.
_MOST_DEEP = 100
#: Largest file of numbers: weeks of poses.
MOST_NUMBERS_BYTES = 4_000_000_000


class TextFileError(RollerError):
    """A file that can't be read, as one line: the path, the line where known, and why."""


#: libyaml's parser, where PyYAML has it, is ten times as fast.
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Parser):  # type: ignore[misc]
    """Takes no name twice: of the two the first would be forgotten."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        names = set()
        for name, _ in node.value:
            if isinstance(name, yaml.ScalarNode) and name.value in names:
                raise _error(f"'{name.value}' is there twice", name)
            names.add(name.value if isinstance(name, yaml.ScalarNode) else None)
        return dict(super().construct_mapping(node, deep))


def _error(problem: str, at: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=at.start_mark)


def _check(text: str) -> None:
    """Refuse what a file of a few lines could fill any memory, or the stack, with."""
    depth = 0
    for event in yaml.parse(text, _Parser):
        if isinstance(event, yaml.AliasEvent):  # ten lines of them can stand for any number
            raise _error("aliases (*) aren't taken", event)
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_DEEP:
            raise _error("nested too deeply", event)


def read_text(path: Path | str, most_bytes: int = _MOST_BYTES) -> str:
    """The text of a file, UTF-8, with or without a byte order mark.

    Raises
    ------
    TextFileError
        If it is a pipe or a device, whose end may never come, is larger than `most_bytes`, can't
        be read or isn't text.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise TextFileError(f"{path}: not a file")
        if path.is_file() and path.stat().st_size > most_bytes:
            raise TextFileError(f"{path}: over {most_bytes} bytes")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TextFileError(f"{path}: can't be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise TextFileError(f"{path}: not a text file") from error


def parse_yaml(text: str) -> Any:
    """What YAML text holds: plain data.

    Raises
    ------
    yaml.YAMLError
        If it isn't YAML, is nested too deeply, has aliases or a name twice.
    """
    _check(text)
    return yaml.load(text, _Loader)


def read_yaml(path: Path | str) -> Any:
    """What a YAML file holds: plain data.

    Raises
    ------
    TextFileError
        As `read_text`; or if it isn't YAML, is nested too deeply, has aliases or a name twice.
    """
    text = read_text(path)
    try:
        return parse_yaml(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        # The end of the text may be said to be beyond its last line.
        line = f", line {min(mark.line + 1, len(text.splitlines()))}" if mark else ""
        problem = getattr(error, "problem", None) or ""
        ours = problem.startswith(("aliases", "nested")) or problem.endswith("is there twice")
        reason = problem if ours else "not a YAML file"
        raise TextFileError(f"{path}{line}: {reason}") from error
    except ValueError as error:  # a number of too many digits, a date that isn't
        raise TextFileError(f"{path}: not a YAML file ({' '.join(str(error).split())})") from error
