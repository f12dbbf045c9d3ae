"""The root of every error the workspace raises on purpose."""

from __future__ import annotations


class RollerError(Exception):
    """A fault that is reported to the user in one line: what is wrong, where, what to do.

    Commands print the message and exit non-zero; nodes report it as a diagnostic and go on.
    """


class SettingsError(RollerError):
    """A setting is unknown, of the wrong type or out of its range."""


class UnwritableOutputError(RollerError):
    """The folder or file that results should go to can't be written."""
