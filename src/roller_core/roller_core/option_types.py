"""Numbers on a command line, held to what makes sense."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeVar

N = TypeVar("N", int, float)


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
