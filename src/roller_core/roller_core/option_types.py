"""Options that commands share: numbers held to what makes sense, and where results go."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

N = TypeVar("N", int, float)


class Once(argparse.Action):
    """An option that may be given once: of two argparse would drop the first without a word."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any,
        option_string: str | None = None,
    ) -> None:  # fmt: skip
        """Take the value."""
        if getattr(namespace, self.dest) is not None:
            parser.error(f"{option_string} is given twice; put what both say into one file")
        setattr(namespace, self.dest, values)


def number(kind: type[N], least: N, most: N) -> Callable[[str], N]:
    """What reads an option's number, for `type` of argparse.

    Parameters
    ----------
    kind : type
        int or float.
    least, most : int or float
        Its range, both ends included.
    """

    def read(text: str) -> N:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:  # NaN isn't either
            what = "a whole number" if kind is int else "a number"
            raise argparse.ArgumentTypeError(f"'{text}' is not {what} from {least} to {most}")
        return value

    return read


def path(text: str) -> Path:
    """A file or folder, for `type` of argparse; an empty name would be the folder one is in."""
    if not text:
        raise argparse.ArgumentTypeError("the name is empty")
    return Path(text)


def add_output(
    parser: argparse._ActionsContainer, what: str, metavar: str = "DIR", **more: Any
) -> None:
    """Add `--output`; `what` is its help, `more` as `add_argument` takes it."""
    parser.add_argument("--output", "-o", type=path, metavar=metavar, help=what, **more)
