"""Substitutions in texts.

They are $(var A), $(find-pkg-share PACKAGE), $(env A DEFAULT), $(equals A B) and
$(file-content FILE). They nest, as in
`$(env PROFILE $(find-pkg-share roller_bringup)/config/profile.xml)`. As in launch, arguments are
separated by one space; its quotes and backslashes are not supported.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

#: How many arguments each takes, at least and at most.
_KNOWN = {
    "var": (1, 1),
    "find-pkg-share": (1, 1),
    "env": (1, 2),
    "equals": (2, 2),
    "file-content": (1, 1),
}
#: A substitution with none in it, and what stands for the value of one that is done.
_INNERMOST, _DONE = re.compile(r"\$\(([^()]*)\)"), re.compile("\0([0-9]+)\0")


class SubstitutionError(ValueError):
    """A text whose substitutions can't be understood."""


def expand(text: str, resolve: Callable[[str, Sequence[str]], str]) -> str:
    """Replace the substitutions in a text; `resolve` gives one's value by name and arguments.

    Raises
    ------
    SubstitutionError
        A substitution is unknown, has the wrong number of arguments or isn't closed.
    """
    values: list[str] = []

    def with_values(part: str) -> str:
        return _DONE.sub(lambda match: values[int(match[1])], part)

    def call(match: re.Match[str]) -> str:
        name, *arguments = match[1].split(" ")
        if name not in _KNOWN:
            known = ", ".join(f"$({word})" for word in _KNOWN)
            raise SubstitutionError(f"$({name} ...) is not supported; known are {known}")
        for refused in "'\"":
            if refused in match[1]:
                raise SubstitutionError(f"{refused} is not supported in {match[0]}")
        low, high = _KNOWN[name]
        if not low <= len(arguments) <= high or not all(arguments):
            wanted = str(low) if low == high else f"{low} or {high}"
            raise SubstitutionError(f"$({name}) takes {wanted} arguments: {match[0]}")
        values.append(resolve(name, [with_values(word) for word in arguments]))
        return f"\0{len(values) - 1}\0"

    if "\\" in text:
        raise SubstitutionError("\\ is not supported")
    found = 1
    while found:
        text, found = _INNERMOST.subn(call, text)
    if "$(" in text:
        raise SubstitutionError(f"$({text.partition('$(')[2][:80]} is not closed as it should be")
    return with_values(text)


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
