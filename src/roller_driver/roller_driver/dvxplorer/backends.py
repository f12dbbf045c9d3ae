"""Which USB library to use: the system's libusb, or one that a parameter names."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import BackendError


def load_backend(name: str) -> Any:
    """Load a pyusb backend.

    Parameters
    ----------
    name : str
        `package.module:function` of a function without arguments that returns a
        `usb.backend.IBackend`; empty: the system's libusb.

    Raises
    ------
    BackendError
        If libusb isn't installed, or what `name` says can't be imported or makes no backend.
    """
    if not name:
        import usb.backend.libusb1

        found = usb.backend.libusb1.get_backend()
        if found is None:
            raise BackendError("libusb 1.0 is not installed: apt install libusb-1.0-0")
        return found
    module, _, function = name.partition(":")
    try:
        return getattr(importlib.import_module(module), function)()
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        raise BackendError(
            f"USB backend '{name}' can't be loaded ({error}); expected package.module:function"
        ) from error
