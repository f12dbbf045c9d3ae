"""The arguments a launch file declares, without running it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from . import document, locate, substitutions
from .document import Element


@dataclass(frozen=True)
class Argument:
    """One argument of a launch file.

    Attributes
    ----------
    name
        Its name.
    default
        Its default as written, or None when it must be given.
    description
        What it is for.
    choices
        What it may be; empty when that is free.
    """

    name: str
    default: str | None
    description: str
    choices: tuple[str, ...] = ()


def list_arguments(path: Path | str) -> list[Argument]:
    """List the arguments of a launch file and of the files it includes.

    An argument that an include sets is the including file's business and isn't listed; of two
    with the same name the first counts.

    Raises
    ------
    LaunchError
        A file can't be read.
    """
    found: dict[str, Argument] = {}
    for argument in _walk(document.read(Path(path).absolute()), frozenset(), 0):
        found.setdefault(argument.name, argument)
    return list(found.values())


def _walk(element: Element, settled: frozenset[str], depth: int) -> Iterator[Argument]:
    for child in element.children:
        if child.tag == "arg" and child.attributes.get("name") not in settled:
            yield Argument(
                child.attributes.get("name", ""),
                child.attributes.get("default"),
                child.attributes.get("description", ""),
                tuple(choice.attributes.get("value", "") for choice in child.children),
            )
        elif child.tag == "group":
            yield from _walk(child, settled, depth)
        elif child.tag == "include" and depth < 32:
            given = {item.attributes.get("name", "") for item in child.children}
            file = _included(child)
            if file is not None:
                yield from _walk(document.read(file), settled | given, depth + 1)


def _included(element: Element) -> Path | None:
    """Give the file of an include, if that can be told without running."""

    def resolve(name: str, arguments: object) -> str:
        if name == "dirname":
            return str(element.file.parent)
        if name == "find-pkg-share" and isinstance(arguments, list):
            return str(locate.package_share(arguments[0]))
        raise substitutions.SubstitutionError(name)

    try:
        template = substitutions.parse(element.attributes.get("file", ""))
        path = Path(substitutions.expand(template, resolve))
    except (substitutions.SubstitutionError, locate.NotFoundError):
        return None
    return path if path.is_file() else None
