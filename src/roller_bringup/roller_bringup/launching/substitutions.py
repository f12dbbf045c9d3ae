"""Substitutions in texts: $(var A), $(find-pkg-share PACKAGE), $(env A DEFAULT), $(equals A B).

They nest, as in `$(env PROFILE $(find-pkg-share roller_bringup)/config/profile.xml)`. As in launch,
arguments are separated by one space; its quotes and backslashes are not supported.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

#: How many arguments each takes, at least and at most.
_KNOWN = {"var": (1, 1), "find-pkg-share": (1, 1), "env": (1, 2), "equals": (2, 2)}
_DEEPEST = 16

Resolve = Callable[[str, Sequence[str]], str]


class SubstitutionError(ValueError):
    """A text whose substitutions can't be understood."""


def expand(text: str, resolve: Resolve) -> str:
    """Replace the substitutions in a text.

    Parameters
    ----------
    text
        Any text.
    resolve
        Gives the value of a substitution by its name and its arguments.

    Raises
    ------
    SubstitutionError
        A substitution is unknown, has the wrong number of arguments or isn't closed.
    """
    return _expand(text, 0, "", resolve, 0)[0]


def split(text: str) -> list[str]:
    """Split at spaces outside of substitutions, as launch does it with `args`."""
    words, depth = [""], 0
    for before, here in zip(" " + text, text, strict=False):
        depth += 1 if before + here == "$(" else -1 if here == ")" and depth else 0
        if here.isspace() and not depth:
            words.append("")
        else:
            words[-1] += here
    return [word for word in words if word]


def _expand(text: str, at: int, end: str, resolve: Resolve, depth: int) -> tuple[str, int]:
    """Expand up to one of the characters `end`, or the end; also tell where that is."""
    if depth > _DEEPEST:
        raise SubstitutionError("substitutions are nested too deeply")
    pieces = []
    while at < len(text) and text[at] not in end:
        if text.startswith("$(", at):
            piece, at = _call(text, at + 2, resolve, depth)
        elif text[at] == "\\" or (depth and text[at] in "'\""):
            raise SubstitutionError(f"{text[at]} is not supported in {_short(text)}")
        else:
            piece, at = text[at], at + 1
        pieces.append(piece)
    return "".join(pieces), at


def _call(text: str, at: int, resolve: Resolve, depth: int) -> tuple[str, int]:
    """Resolve the substitution whose name starts here; also tell where it ends."""
    name = re.compile(r"[\w-]*").match(text, at).group()  # type: ignore[union-attr]
    if name not in _KNOWN:
        known = ", ".join(f"$({word})" for word in _KNOWN)
        raise SubstitutionError(f"$({name} ...) is not supported; known are {known}")
    at += len(name)
    arguments = []
    while text[at : at + 1] == " ":
        start = at + 1
        argument, at = _expand(text, start, " )", resolve, depth + 1)
        if at == start:
            raise SubstitutionError(f"an argument of $({name} ...) is empty in {_short(text)}")
        arguments.append(argument)
    if text[at : at + 1] != ")":
        raise SubstitutionError(f"$({name} ...) is not closed as it should be in {_short(text)}")
    low, high = _KNOWN[name]
    if not low <= len(arguments) <= high:
        wanted = str(low) if low == high else f"{low} or {high}"
        raise SubstitutionError(f"$({name}) takes {wanted} arguments, not {len(arguments)}")
    return resolve(name, arguments), at + 1


def _short(text: str) -> str:
    return repr(text if len(text) < 80 else text[:77] + "...")
