"""Settings: frozen, validated once at the edge, one source of defaults.

A settings model is what node parameters, parameter files and the documentation are made from:
every field carries a description and, for numbers, its range.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import SettingsError

S = TypeVar("S", bound="Settings")


class Settings(BaseModel):
    """Base of all settings models."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def create(cls: type[S], values: Mapping[str, Any], source: str = "settings") -> S:
        """Validate values; missing ones take their defaults.

        Raises
        ------
        SettingsError
            Naming the first entry that is unknown, of the wrong type or out of range.
        """
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise SettingsError(f"{source}: {_first_fault(error)}") from error

    @classmethod
    def from_yaml(cls: type[S], path: Path | str, node: str) -> S:
        """Read a node's parameters from a ROS 2 parameter file; see `read_parameters`."""
        return cls.create(read_parameters(path, node), str(path))


def read_parameters(path: Path | str, node: str) -> dict[str, Any]:
    """Parameters of one node in a ROS 2 parameter file.

    Entries under ``/**`` hold for every node, those under the node's name go before them.

    Parameters
    ----------
    path : path
        YAML file `{/**: {ros__parameters: {...}}, node: {ros__parameters: {...}}}`.
    node : str
        Name of the node, without namespace.

    Raises
    ------
    SettingsError
        If the file can't be read or has another shape.
    """
    try:
        data = yaml.safe_load(Path(path).read_text())
    except OSError as error:
        raise SettingsError(f"parameters {path}: can't be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise SettingsError(f"parameters {path}: not a YAML file ({error})") from error
    if not isinstance(data, dict):
        raise SettingsError(f"parameters {path}: expected a node's name and ros__parameters")
    found: dict[str, Any] = {}
    for pattern in ("/**", "**", node, f"/{node}"):
        section = data.get(pattern)
        if section is None:
            continue
        if not isinstance(section, dict) or not isinstance(section.get("ros__parameters"), dict):
            raise SettingsError(f"parameters {path}: '{pattern}' has no 'ros__parameters'")
        found.update(section["ros__parameters"])
    return found


def parameter_file(sections: Mapping[str, type[Settings]]) -> str:
    """A ROS 2 parameter file with all defaults, each under its description.

    Parameters
    ----------
    sections : mapping
        Settings model by node name.
    """
    lines = []
    for node, model in sections.items():
        lines += [f"{node}:", "  ros__parameters:", *_entries(model, "    ")]
    return "\n".join(lines) + "\n"


def _entries(model: type[Settings], indent: str) -> list[str]:
    """Lines of a model's defaults; models within it are groups."""
    lines = []
    for name, field in model.model_fields.items():
        kind = field.annotation
        group = kind if isinstance(kind, type) and issubclass(kind, Settings) else None
        about_group = (group.__doc__ if group else None) or ""
        text = field.description or about_group.split("\n")[0]
        lines += [f"{indent}# {line}" for line in textwrap.wrap(text, 94 - len(indent))]
        if group is not None:
            lines += [f"{indent}{name}:", *_entries(group, indent + "  ")]
            continue
        default = field.get_default(call_default_factory=True)
        if isinstance(default, tuple):
            default = list(default)
        value = yaml.safe_dump(default, default_flow_style=True, width=10_000)
        entry = f"{name}: {value.removesuffix('...' + chr(10)).strip()}"
        # ROS 2's parameter files have no null: what is not set is left out.
        lines.append(indent + (entry if default is not None else f"# {name}:"))
    return lines


def _first_fault(error: ValidationError) -> str:
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"]) or "the values"
    if fault["type"] == "extra_forbidden":
        return f"unknown entry '{where}'"
    if not fault["loc"]:
        return fault["msg"].removeprefix("Value error, ")
    return f"'{where}' = {fault['input']!r}: {fault['msg'].removeprefix('Value error, ')}"
