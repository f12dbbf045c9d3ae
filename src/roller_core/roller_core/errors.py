"""The root of every error the workspace raises on purpose."""

from __future__ import annotations

import re

#: Environment variable: set to 1, it has a fault of ours shown where it happened.
TRACEBACK = "ROLLER_TRACEBACK"
#: Of a longer message the begin and the end are shown.
_BEGIN, _END = 400, 200
#: Where an output folder is written aside; see `output_folder`.
ASIDE = ".roller-partial"


class RollerError(Exception):
    """A fault that is reported to the user in one line: what is wrong, where, what to do.

    Commands print the message and exit non-zero; nodes report it as a diagnostic and go on. What it
    quotes may come from anybody and be of any length.
    """

    def __str__(self) -> str:
        """The message: one line, bounded, without what steers a terminal."""
        text = re.sub(r"[\x00-\x1f\x7f-\x9f]+", " ", super().__str__())
        return text if len(text) <= _BEGIN + _END else f"{text[:_BEGIN]} … {text[-_END:]}"


class SettingsError(RollerError):
    """A setting is unknown, of the wrong type or out of its range."""


class UnwritableOutputError(RollerError):
    """The folder or file that results should go to can't be written.

    Its message names where that would be, not where it is written aside, which is gone by then.
    """

    def __str__(self) -> str:
        """The message; see `RollerError`."""
        return re.sub(rf"([^/]+)/{re.escape(ASIDE)}/\1(?=[/:;,) ]|$)", r"\1", super().__str__())


def describe_fault_of_ours(error: BaseException, then: str = "") -> str:
    """One line on an error that nobody foresaw, which a user should report.

    Parameters
    ----------
    error : BaseException
        The error.
    then : str, optional
        What comes of it, such as `the node ends`.
    """
    text = " ".join(str(error).split())
    whose = f"a fault of roller, {then}" if then else "a fault of roller"
    return f"{type(error).__name__}: {text} ({whose}: please report it; {TRACEBACK}=1 shows where)"
