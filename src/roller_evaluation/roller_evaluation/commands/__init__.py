"""Subcommands of roller: bench and evaluate."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

from roller_core.errors import SettingsError
from roller_core.progress import OnProgress


def words(text: str) -> tuple[str, ...]:
    """Words of an option, separated by commas, each of them once; one at least."""
    found = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    if not found:
        raise argparse.ArgumentTypeError("nothing is named; leave the option out for its default")
    return found


def numbers(text: str) -> tuple[float, ...]:
    """Numbers of an option, separated by commas, each of them once."""
    try:
        return tuple(dict.fromkeys(float(word) for word in words(text)))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not numbers with commas") from None


def given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Options that were given, of these."""
    return {name: v for name in names if (v := getattr(args, name)) is not None}


def check_names(option: str, names: Collection[str], known: Collection[str]) -> None:
    """Refuse names that an option doesn't know.

    Raises
    ------
    SettingsError
        With those that it knows.
    """
    for name in names:
        if name not in known:
            raise SettingsError(f"--{option}: {name!r} is none of {', '.join(known)}")


@contextmanager
def shown_progress(title: str) -> Iterator[OnProgress]:
    """Show what is being done on standard error."""
    from rich.console import Console

    with Console(stderr=True).status(title) as status:
        yield lambda text, share: status.update(f"{title}: {share:.0%}, {text}")
