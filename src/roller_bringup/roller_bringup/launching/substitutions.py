"""Substitutions in attributes: $(var …), $(find-pkg-share …), $(env …), $(dirname), $(equals …).

They nest, as in `$(env PROFILE $(find-pkg-share roller_bringup)/config/profile.xml)`. The grammar
is launch's: a backslash takes the next character as it is, arguments are separated by one space,
and an argument may be quoted as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

#: Known substitutions and how many arguments they take.
KNOWN = {
    "var": (1, 2),
    "find-pkg-share": (1, 1),
    "env": (1, 2),
    "dirname": (0, 0),
    "equals": (2, 2),
}

_TRUTHS = {"true": True, "1": True, "false": False, "0": False}

Resolve: TypeAlias = Callable[[str, Sequence[str]], str]


@dataclass(frozen=True)
class Call:
    """A substitution with its arguments, each of which may hold substitutions."""

    name: str
    arguments: tuple[Template, ...]


Template: TypeAlias = "tuple[str | Call, ...]"


class SubstitutionError(ValueError):
    """A text whose substitutions can't be understood."""


def parse(text: str) -> Template:
    """Split a text into plain pieces and substitutions.

    Raises
    ------
    SubstitutionError
        A substitution is unknown, has the wrong number of arguments or isn't closed.
    """
    template, _ = _Reader(text).template("")
    return template


def expand(template: Template, resolve: Resolve) -> str:
    """Replace the substitutions of a template.

    Parameters
    ----------
    template
        From `parse`.
    resolve
        Gives the value of a substitution by its name and its arguments.
    """
    return "".join(
        piece
        if isinstance(piece, str)
        else resolve(piece.name, [expand(argument, resolve) for argument in piece.arguments])
        for piece in template
    )


def equal(left: str, right: str) -> bool:
    """Compare the arguments of $(equals …).

    They are compared as texts, but two that both are truth values (true, false, 1, 0 in any case)
    or both are numbers by their values, as launch does it.
    """
    truths = [_TRUTHS.get(text.lower()) for text in (left, right)]
    if None not in truths:
        return truths[0] == truths[1]
    try:
        return math.isclose(float(left), float(right))
    except ValueError:
        return left == right


class _Reader:
    """Reads one text from left to right."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0

    def template(self, end: str) -> tuple[Template, str]:
        """Read until one of the characters `end` (or the end of the text); don't take it."""
        pieces: list[str | Call] = []
        plain = ""
        while self.at < len(self.text):
            here = self.text[self.at]
            if here in end:
                break
            if here == "\\" and self.at + 1 < len(self.text):
                plain += self.text[self.at + 1]
                self.at += 2
            elif self.text.startswith("$(", self.at):
                if plain:
                    pieces.append(plain)
                    plain = ""
                self.at += 2
                pieces.append(self.call())
            else:
                plain += here
                self.at += 1
        if plain or not pieces:
            pieces.append(plain)
        return tuple(pieces), self.text[self.at : self.at + 1]

    def call(self) -> Call:
        """Read a substitution after its `$(`."""
        start = self.at
        while self.at < len(self.text) and (
            self.text[self.at].isalnum() or self.text[self.at] in "_-"
        ):
            self.at += 1
        name = self.text[start : self.at]
        if name not in KNOWN:
            known = ", ".join(f"$({word})" for word in KNOWN)
            raise SubstitutionError(f"$({name} ...) is not supported; known are {known}")
        arguments: list[Template] = []
        while self.text[self.at : self.at + 1] == " ":
            self.at += 1
            arguments.append(self.argument())
        if self.text[self.at : self.at + 1] != ")":
            raise SubstitutionError(f"$({name} ...) in {self.text!r} is not closed as it should be")
        self.at += 1
        low, high = KNOWN[name]
        if not low <= len(arguments) <= high:
            wanted = str(low) if low == high else f"{low} or {high}"
            raise SubstitutionError(f"$({name}) takes {wanted} arguments, not {len(arguments)}")
        return Call(name, tuple(arguments))

    def argument(self) -> Template:
        """Read one argument, quoted or not."""
        quote = self.text[self.at : self.at + 1]
        if quote and quote in "'\"":
            self.at += 1
            template, end = self.template(quote)
            if not end:
                raise SubstitutionError(f"a quote in {self.text!r} is not closed")
            self.at += 1
            return template
        start = self.at
        template, _ = self.template(" )")
        if self.at == start:
            raise SubstitutionError(f"an argument is empty in {self.text!r}")
        return template
