"""Examples in the help of commands."""

from __future__ import annotations

import argparse

_HEAD = "examples:\n"


class _Formatter(argparse.HelpFormatter):
    """Wraps text, and leaves examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        before, head, examples = text.partition(_HEAD)
        wrapped = super()._fill_text(before, width, indent)
        return f"{wrapped}\n\n{head}{examples}" if wrapped and head else wrapped + head + examples


def add_examples(parser: argparse.ArgumentParser, *lines: str) -> None:
    """Have a command's help end with examples.

    Parameters
    ----------
    parser : ArgumentParser
        Of the command.
    *lines : str
        Words after `roller`, and behind a # what they do.
    """
    examples = _HEAD + "".join(f"  roller {line}\n" for line in lines)
    parser.epilog = f"{parser.epilog or ''}\n{examples}"
    parser.formatter_class = _Formatter
