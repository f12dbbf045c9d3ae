"""Subcommands of roller: bench and evaluate."""

from __future__ import annotations


def words(text: str) -> tuple[str, ...]:
    """Words of an option, separated by commas, each of them once."""
    return tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))


def numbers(text: str) -> tuple[float, ...]:
    """Numbers of an option, separated by commas, each of them once."""
    return tuple(dict.fromkeys(float(word) for word in words(text)))
