"""What can be wrong with a packet."""

from __future__ import annotations

from roller_core.errors import RollerError


class CodecError(RollerError):
    """A packet that can't be decoded or events that can't be encoded."""


class UnknownEncodingError(CodecError):
    """An encoding that this workspace doesn't know."""


class PacketLengthError(CodecError):
    """A payload that is no whole number of words."""


class PacketTimeError(CodecError):
    """Times that are none, or that the encoding can't hold in one packet."""
