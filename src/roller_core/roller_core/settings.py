"""Settings: frozen, validated once at the edge, one source of defaults.

A settings model is what node parameters, parameter files and the documentation are made from:
every field carries a description and, for numbers, its range. A field that is itself a model is a
group; ROS names its parameters `group.name`.
"""

from __future__ import annotations

import difflib
import re
import textwrap
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from .errors import SettingsError
from .text_file import TextFileError, read_yaml

S = TypeVar("S", bound="Settings")

#: Our nodes, and the record of the calibration, as parameter files name them.
SECTIONS = (
    "event_camera", "ur10", "virtual_cell", "player", "emvs", "stitcher", "surface", "braille",
    "inspect", "recorder", "calibration",
)  # fmt: skip
#: Most namespaces around a node.
_DEEPEST = 6
#: What rclpy asks of every node.
_OF_RCLPY = {"use_sim_time", "qos_overrides", "start_type_description_service"}
#: So many entries are listed for who names another.
_FEW_ENTRIES = 16
#: What may stand where something else does, by pydantic's name of the fault, as far as its own
#: words are of Python.
_EXPECTED = {
    "missing": "is missing",
    "tuple_type": "a list is expected, [..., ...]",
    "list_type": "a list is expected, [..., ...]",
    "dict_type": "entries are expected, name: value",
    "model_type": "entries are expected, name: value",
    "string_type": "a text is expected; put it in quotes",
    "float_type": "a number is expected",
    "float_parsing": "a number is expected",
    "int_type": "a whole number is expected",
    "int_parsing": "a whole number is expected",
    "int_from_float": "a whole number is expected",
    "too_long": "{max_length} values are expected, not {actual_length}",
    "too_short": "at least {min_length} are expected",
    "literal_error": "is not {expected}",
    "greater_than_equal": "at least {ge} is expected",
    "greater_than": "more than {gt} is expected",
    "less_than_equal": "at most {le} is expected",
    "less_than": "less than {lt} is expected",
}


def _in_words(fault: Any) -> str:
    """What is wrong with a value, in a person's words."""
    text = _EXPECTED.get(fault["type"])
    if text is None:
        return str(fault["msg"]).removeprefix("Value error, ")
    return text.format(**fault.get("ctx", {}))


def _group(annotation: Any) -> type[Settings] | None:
    """The settings model in a field's type, alone or in a list or mapping."""
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        return annotation
    return next(filter(None, map(_group, get_args(annotation))), None)


def _leaves(annotation: Any) -> Iterator[Any]:
    """The types in a field's type."""
    inner = get_args(annotation)
    return iter([annotation]) if not inner else (t for part in inner for t in _leaves(part))


def _holds_truth(value: Any) -> bool:
    """Whether a value is yes or no, or holds one."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return any(map(_holds_truth, value))
    return isinstance(value, bool)


class Settings(BaseModel):
    """Base of all settings models."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _complete_groups(cls, values: Any) -> Any:
        """A group given in part keeps the rest of the field's default, not of its own class."""
        if not isinstance(values, Mapping):
            return values
        return {k: _completed(cls.default_of(k), v) for k, v in values.items()}

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML's `yes` is no 1."""
        if _holds_truth(value):
            annotation = cls.model_fields[str(info.field_name)].annotation
            leaves = set(_leaves(annotation))
            if leaves & {int, float} and bool not in leaves and _group(annotation) is None:
                raise ValueError("a number is expected, not yes or no")
        return value

    @classmethod
    def default_of(cls, name: str) -> Any:
        """Default of a field; None if there is no such field."""
        field = cls.model_fields.get(name)
        return field.get_default(call_default_factory=True) if field else None

    @classmethod
    def create(cls: type[S], values: Mapping[str, Any], source: str = "settings") -> S:
        """Validate values; missing ones take their defaults.

        Values of groups are given as `{"group": {"name": 1}}` or as `{"group.name": 1}`.

        Raises
        ------
        SettingsError
            Naming the first entry that is unknown, of the wrong type or out of range.
        """
        try:
            return cls.model_validate(nested(values))
        except ValidationError as error:
            raise SettingsError(f"{source}: {cls._first_fault(error)}") from error

    def changed(self: S, values: Mapping[str, Any]) -> S:
        """A copy with other values, by the names of `create`, and validated as there."""
        return self.create(_completed(self, nested(values)))

    @classmethod
    def names(cls) -> list[str]:
        """Names of all fields as parameters, those of groups as `group.name`."""
        found = []
        for name in cls.model_fields:
            default = cls.default_of(name)
            group = type(default).names() if isinstance(default, Settings) else []
            found += [f"{name}.{inner}" for inner in group] or [name]
        return found

    @classmethod
    def _first_fault(cls, error: ValidationError) -> str:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"]) or "the values"
        if fault["type"] == "extra_forbidden":
            return f"unknown entry '{where}'" + cls._meant(fault["loc"])
        said = _in_words(fault)
        if not fault["loc"]:
            return said
        if fault["type"] == "missing":
            return f"'{where}' {said}"
        return f"'{where}' = {fault['input']!r}: {said}"

    @classmethod
    def _meant(cls, loc: tuple[int | str, ...]) -> str:
        """What may have been meant by an unknown entry: the most alike, or all if they are few."""
        model, before = cls, ""
        for part in loc[:-1]:
            inner = (
                _group(model.model_fields[str(part)].annotation)
                if (part in model.model_fields)
                else None
            )
            model, before = inner or model, f"{before}{part}."
        own = [str(field.alias or name) for name, field in model.model_fields.items()]
        alike = difflib.get_close_matches(str(loc[-1]), own, 1, 0.7) or (
            difflib.get_close_matches(str(loc[-1]), model.names(), 1, 0.7)
        )
        if alike:
            return f"; is it '{before}{alike[0]}'?"
        return f"; there are {', '.join(own)}" if len(own) <= _FEW_ENTRIES else ""

    @classmethod
    def from_yaml(cls: type[S], path: Path | str, node: str) -> S:
        """Read a node's parameters from a ROS 2 parameter file; see `read_parameters`."""
        return cls.create(read_parameters(path, node), str(path))


def read_parameters(path: Path | str, node: str) -> dict[str, Any]:
    """Parameters of one node in a ROS 2 parameter file, whatever namespace it names.

    As in ROS 2, entries under ``/**`` hold for every node and ``/**/node`` for one in any
    namespace, and what the file says last counts. What rclpy itself asks of every node, such as
    ``use_sim_time``, is left out.

    Parameters
    ----------
    path : path
        YAML file `{/**: {ros__parameters: {...}}, /**/node: {ros__parameters: {...}}}`.
    node : str
        Name of the node, without namespace.

    Raises
    ------
    SettingsError
        If the file can't be read or has another shape.
    """
    found: dict[str, Any] = {}
    for pattern, values in read_sections(path).items():
        if pattern.lstrip("/") == "**" or node_name(pattern) == node:
            _merge(found, values)
    return {name: value for name, value in found.items() if name not in _OF_RCLPY}


def read_sections(path: Path | str) -> dict[str, dict[str, Any]]:
    """All of a ROS 2 parameter file: parameters by node, as the file writes its name.

    Raises
    ------
    SettingsError
        If the file can't be read or has another shape.
    """
    try:
        data = read_yaml(path)
    except TextFileError as error:
        raise SettingsError(f"parameters {error}") from error
    if not isinstance(data, dict):
        raise SettingsError(f"parameters {path}: expected a node's name and ros__parameters")
    found: dict[str, dict[str, Any]] = {}
    # Namespaces may stand around a node: `left: {emvs: {ros__parameters: ...}}`.
    rest = [(str(pattern), section) for pattern, section in reversed(data.items())]
    while rest:
        pattern, section = rest.pop()
        if section is None:
            continue
        if not isinstance(section, dict):
            raise SettingsError(f"parameters {path}: '{pattern}' has no 'ros__parameters'")
        if isinstance(section.get("ros__parameters"), dict):
            found[pattern] = section["ros__parameters"]
        elif section and "ros__parameters" not in section and pattern.count("/") < _DEEPEST:
            inner = reversed(section.items())
            rest += [(f"{pattern}/{str(name).lstrip('/')}", below) for name, below in inner]
        else:
            raise SettingsError(f"parameters {path}: '{pattern}' has no 'ros__parameters'")
    return found


def misspelt_section(path: Path | str, nodes: Collection[str]) -> str:
    """What to say of a parameter file of which a section may be meant for one of some nodes.

    Sections of other people's nodes may be among them, so it is no error.

    Returns
    -------
    str
        Names the section that is called nearly as a node, or all if none is for any node of ours;
        empty if nothing is to be said.

    Raises
    ------
    SettingsError
        As `read_sections`.
    """
    names = {node_name(pattern): pattern for pattern in read_sections(path)}
    ours = {*SECTIONS, *nodes}
    for name in names.keys() - ours:
        if alike := difflib.get_close_matches(name, nodes, 1, 0.7):
            return f"{path}: no node of ours is called '{names[name]}'; is it '{alike[0]}'?"
    if names and not any("*" in name or name in ours for name in names):
        return f"{path}: no section is for a node of ours; there are {', '.join(names.values())}"
    return ""


def passed_over_section(path: Path | str, node: str) -> str:
    """What to say of a parameter file that names a node, but in other namespaces alone.

    Parameters
    ----------
    path : path
        YAML file.
    node : str
        The node with its namespace, such as `/left/emvs`.

    Returns
    -------
    str
        Empty if a section holds for the node, or none is of its name.

    Raises
    ------
    SettingsError
        As `read_sections`.
    """
    name = node_name(node)
    named = [pattern for pattern in read_sections(path) if node_name(pattern) == name]
    if not named or any(_holds_for(pattern, node) for pattern in named):
        return ""
    return f"{path}: '{named[0]}' doesn't hold for {node}: call the section '/**/{name}'"


def _holds_for(pattern: str, node: str) -> bool:
    """Whether ROS 2 takes a section for a node: `*` is a namespace, `**` any number of them."""
    words = {"*": r"/\w+", "**": r"(/\w+)*"}
    parts = pattern.strip("/").split("/")
    return bool(re.fullmatch("".join(words.get(p, f"/{re.escape(p)}") for p in parts), node))


def node_name(pattern: str) -> str:
    """A node's name as a parameter file writes it, without its namespace."""
    return pattern.rpartition("/")[2]


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with each group a mapping of its own."""
    found: dict[str, Any] = {}
    _merge(found, values)
    return found


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Add parameters to those before; `group.name: 1` and `group: {name: 1}` say the same."""
    for name, value in values.items():
        group, dot, rest = str(name).partition(".")
        if dot:
            _merge(into, {group: {rest: value}})
        elif isinstance(value, Mapping):
            own = into.get(name)
            into[name] = dict(own) if isinstance(own, Mapping) else {}
            _merge(into[name], value)
        else:
            into[name] = value


def _completed(default: Any, given: Any) -> Any:
    """What is given of a group, and of groups within, on top of the default."""
    if not isinstance(default, Settings) or not isinstance(given, Mapping):
        return given
    values = {name: getattr(default, name) for name in type(default).model_fields}
    return values | {k: _completed(values.get(k), v) for k, v in given.items()}


def parameter_file(sections: Mapping[str, type[Settings]]) -> str:
    """A ROS 2 parameter file with all defaults, each under its description; in any namespace.

    Parameters
    ----------
    sections : mapping
        Settings model by node name.
    """
    lines = []
    for node, model in sections.items():
        lines += [f"/**/{node}:", "  ros__parameters:", *_entries(model, None, "    ")]
    return "\n".join(lines) + "\n"


def _entries(model: type[Settings], values: Settings | None, indent: str) -> list[str]:
    """Lines of a model's defaults, those of `values` if given; models within it are groups."""
    lines = []
    for name, field in model.model_fields.items():
        default = getattr(values, name) if values else model.default_of(name)
        group = type(default) if isinstance(default, Settings) else None
        about_group = (group.__doc__ if group else None) or ""
        text = field.description or about_group.split("\n")[0]
        lines += [f"{indent}# {line}" for line in textwrap.wrap(text, 94 - len(indent))]
        if group is not None:
            lines += [f"{indent}{name}:", *_entries(group, default, indent + "  ")]
            continue
        if isinstance(default, tuple):
            default = list(default)
        value = yaml.safe_dump(default, default_flow_style=True, width=10_000)
        entry = f"{name}: {value.removesuffix('...' + chr(10)).strip()}"
        # ROS 2's parameter files have no null: what is not set is left out.
        lines.append(indent + (entry if default is not None else f"# {name}:"))
    return lines
