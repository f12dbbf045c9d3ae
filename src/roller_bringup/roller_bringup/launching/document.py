"""Reading a launch file into elements that know their line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from .errors import LaunchError


@dataclass
class Element:
    """One element of a launch file.

    Attributes
    ----------
    tag
        Its name.
    attributes
        Name to text, as written.
    children
        The elements in it.
    file, line
        Where it starts.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)

    def error(self, message: str) -> LaunchError:
        """Make an error that names this element's place."""
        return LaunchError(message, self.file, self.line)

    def only(self, required: set[str], optional: set[str], children: set[str]) -> None:
        """Refuse attributes and children this element doesn't have in our subset.

        Raises
        ------
        LaunchError
            Something is missing or unknown.
        """
        for name in sorted(required - self.attributes.keys()):
            raise self.error(f"<{self.tag}> needs the attribute '{name}'")
        for name in self.attributes:
            if name not in required | optional:
                raise self.error(f"<{self.tag}> has an attribute '{name}' that is not supported")
        for child in self.children:
            if child.tag not in children:
                raise child.error(f"<{child.tag}> is not supported in <{self.tag}>")


def read(path: Path) -> Element:
    """Read a launch file.

    Parameters
    ----------
    path
        The file, XML.

    Returns
    -------
    Element
        Its root, `<launch>`.

    Raises
    ------
    LaunchError
        The file can't be read, isn't XML, or has text or a root that a launch file doesn't.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LaunchError(f"can't read the launch file: {error.strerror}", path) from None

    parser = expat.ParserCreate()
    open_elements: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_tag: str) -> None:
        open_elements.pop()

    def text(data: str) -> None:
        if data.strip():
            raise LaunchError(f"unexpected text {data.strip()!r}", path, parser.CurrentLineNumber)

    def doctype(*_: object) -> None:
        raise LaunchError("a DOCTYPE is not supported", path, parser.CurrentLineNumber)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise LaunchError(f"not well-formed XML: {reason}", path, error.lineno) from None

    root = roots[0]
    if root.tag != "launch":
        raise root.error(f"a launch file starts with <launch>, not <{root.tag}>")
    return root
