"""Reading a launch file into elements that know their line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from roller_core.errors import RollerError

_DEEPEST = 32


class LaunchError(RollerError):
    """A launch file can't be read or run; the message names file and line where there is one."""

    def __init__(self, message: str, file: Path | None = None, line: int | None = None) -> None:
        self.file = file
        self.line = line
        where = "" if file is None else f"{file}:{line}: " if line else f"{file}: "
        super().__init__(where + message)


@dataclass
class Element:
    """One element of a launch file: its name, attributes, children, and where it starts."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    def error(self, message: str) -> LaunchError:
        """Make an error that names this element's place."""
        return LaunchError(message, self.file, self.line)

    def only(self, required: str, optional: str = "", children: str = "") -> None:
        """Refuse attributes and children but these; their names have spaces between.

        Raises
        ------
        LaunchError
            Something is missing or unknown.
        """
        for name in required.split():
            if name not in self.attributes:
                raise self.error(f"<{self.tag}> needs the attribute '{name}'")
        for name in self.attributes:
            if name not in required.split() + optional.split():
                raise self.error(f"<{self.tag}> has an attribute '{name}' that is not supported")
        for child in self.children:
            if child.tag not in children.split():
                raise child.error(f"<{child.tag}> is not supported in <{self.tag}>")


def read(path: Path) -> Element:
    """Read a launch file and give its root, `<launch>`.

    Raises
    ------
    LaunchError
        The file can't be read, isn't XML, or has what no launch file of ours has.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LaunchError(f"can't read the launch file: {error.strerror}", path) from None

    parser = expat.ParserCreate()
    top = Element("", {}, path, 1)
    open_elements = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        if len(open_elements) > _DEEPEST:
            raise element.error("elements are nested too deeply")
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def text(data: str) -> None:
        if data.strip():
            raise LaunchError(f"unexpected text {data.strip()!r}", path, parser.CurrentLineNumber)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.CharacterDataHandler = text
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise LaunchError(f"not well-formed XML: {reason}", path, error.lineno) from None
    (root,) = top.children
    if root.tag != "launch":
        raise root.error(f"a launch file starts with <launch>, not <{root.tag}>")
    return root
