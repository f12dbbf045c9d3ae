"""Parameters of nodes, with the types launch_ros gives them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import yaml

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | Sequence[Scalar]

_SCALARS: dict[str, type] = {"bool": bool, "int": int, "float": float, "str": str}
_LISTS = {f"list_of_{name}": kind for name, kind in _SCALARS.items()}
TYPES = ("yaml", *_SCALARS, *_LISTS)


def convert(text: str, type_name: str | None = None) -> Value:
    """Turn an attribute into a value.

    Parameters
    ----------
    text
        The attribute, its substitutions done.
    type_name
        One of `TYPES`; by default what YAML makes of the text.

    Raises
    ------
    ValueError
        The text isn't of the type, or isn't a scalar or a list of one kind of them.
    """
    if type_name not in (None, *TYPES):
        raise ValueError(f"unknown type '{type_name}'; known are {', '.join(TYPES)}")
    if type_name == "str":
        return text
    if type_name in ("int", "float"):
        try:
            return _SCALARS[type_name](text)
        except ValueError:
            raise ValueError(f"{text!r} is not of type {type_name}") from None
    if not text and type_name in (None, "yaml"):
        return text
    if type_name == "bool":
        text = {"1": "true", "0": "false"}.get(text, text)
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise ValueError(f"{text!r} is not YAML") from None
    if type_name == "bool" and not isinstance(value, bool):
        raise ValueError(f"{text!r} is not of type bool")
    if type_name in _LISTS:
        kind = _LISTS[type_name]
        if not isinstance(value, list) or any(type(item) is not kind for item in value):
            raise ValueError(f"{text!r} is not of type {type_name}")
    if isinstance(value, list):
        kinds = {type(item) for item in value}
        if len(kinds) == 1 and kinds <= set(_SCALARS.values()):
            return value
        raise ValueError(f"{text!r} is not a list of one kind of values")
    if type(value) not in _SCALARS.values():
        raise ValueError(f"{text!r} is not a value a parameter can have; quote it to make it text")
    return value


def write(path: Path, node: str, values: Mapping[str, Value]) -> None:
    """Write a ROS 2 parameter file.

    Parameters
    ----------
    path
        The file.
    node
        The node's full name, or `/**` for any.
    values
        Parameters by name; the dots of nested names stay in them.
    """
    content = {node: {"ros__parameters": dict(values)}}
    path.write_text(yaml.safe_dump(content, default_flow_style=False, allow_unicode=True))
