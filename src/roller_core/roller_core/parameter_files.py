"""ROS 2 parameter files: what they hold for a node of ours, and files with all defaults."""

from __future__ import annotations

import difflib
import re
import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from .errors import SettingsError
from .settings import Settings, merge
from .text_file import TextFileError, parse_yaml, read_yaml

#: Our nodes, and the record of the calibration, as parameter files name them.
SECTIONS = (
    "event_camera", "ur10", "virtual_cell", "player", "emvs", "stitcher", "surface", "braille",
    "inspect", "recorder", "calibration",
)  # fmt: skip
#: Most namespaces around a node.
_DEEPEST = 6
#: Numbers to ROS, text to YAML 1.1, which asks for a point and a sign. Our files hold such text.
_EXPONENT = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+")
#: What rclpy asks of every node.
_OF_RCLPY = {"use_sim_time", "qos_overrides", "start_type_description_service"}


def read_parameters(path: Path | str | None, node: str) -> dict[str, Any]:
    """Parameters of one node in a ROS 2 parameter file, whatever namespace it names.

    As in ROS 2, entries under ``/**`` hold for every node and ``/**/node`` for one in any
    namespace, and what the file says last counts. What rclpy itself asks of every node, such as
    ``use_sim_time``, is left out. Of two cells' parameters in one file, which hold isn't known.

    Parameters
    ----------
    path : path, optional
        YAML file `{/**: {ros__parameters: {...}}, /**/node: {ros__parameters: {...}}}`; without
        one there are none.
    node : str
        Name of the node, without namespace.

    Raises
    ------
    SettingsError
        If the file can't be read or has another shape, or if it names the node in two namespaces.
    """
    found: dict[str, Any] = {}
    named: dict[str, str] = {}
    for pattern, values in (read_sections(path) if path else {}).items():
        if pattern.lstrip("/") == "**" or node_name(pattern) == node:
            merge(found, values)
            if namespace := "/".join(p for p in pattern.split("/")[:-1] if p.strip("*")):
                named.setdefault(namespace, pattern)
    if len(named) > 1:
        one, other = list(named.values())[:2]
        raise SettingsError(
            f"parameters {path}: '{one}' and '{other}' are of two cells, and which is meant isn't "
            f"known: give a file with the one, as '/**/{node}'"
        )
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


def clashing_parameters(words: Sequence[str], node: str) -> dict[str, Any]:
    """Parameters of which a node's command line says two types, with what it says last.

    Of two values of different types ROS keeps the one of the type that it looks at first (bool,
    integer, double, text), whichever comes last, and says nothing.

    Parameters
    ----------
    words : sequence of str
        The command line, with `--params-file FILE` and `-p NAME:=VALUE`.
    node : str
        The node with its namespace, such as `/left/emvs`.

    Returns
    -------
    dict
        Value by parameter, groups with a point between.

    Raises
    ------
    SettingsError
        As `read_sections`.
    """
    given: dict[str, dict[str, Any]] = {}
    clashes: set[tuple[str, str]] = set()
    for word, text in pairwise(words):
        sections: dict[str, dict[str, Any]] = {}
        if word == "--params-file":
            sections = read_sections(text)
        elif word in ("-p", "--param"):
            name, _, value = text.partition(":=")
            pattern, _, name = name.rpartition(":")
            with suppress(yaml.YAMLError, ValueError):  # ROS has its say about that
                sections = {pattern or "**": {name: parse_yaml(value)}}
        for pattern, values in sections.items():
            own = given.setdefault(pattern.strip("/"), {})
            for name, value in _flat(values):
                if name in own and _kind(own[name]) != _kind(value):
                    clashes.add((pattern.strip("/"), name))
                own[name] = value
    merged: dict[str, Any] = {}
    named: set[str] = set()
    for pattern, values in given.items():
        if _holds_for(pattern, node):
            merged |= values
            named |= {name for name in values if (pattern, name) in clashes}
    return {name: merged[name] for name in named}


def _flat(values: Mapping[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Parameters with the names that ROS gives them."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{group}{name}.")
        elif isinstance(value, str) and _EXPONENT.fullmatch(value):
            yield f"{group}{name}", float(value)
        else:
            yield f"{group}{name}", value


def _kind(value: Any) -> tuple[type, ...]:
    """The type of a value, and that of what is in a list."""
    inner = {type(v) for v in value} if isinstance(value, list) else set()
    return (type(value), *sorted(inner, key=str))


def _holds_for(pattern: str, node: str) -> bool:
    """Whether ROS 2 takes a section for a node: `*` is a namespace, `**` any number of them."""
    words = {"*": r"/\w+", "**": r"(/\w+)*"}
    parts = pattern.strip("/").split("/")
    return bool(re.fullmatch("".join(words.get(p, f"/{re.escape(p)}") for p in parts), node))


def node_name(pattern: str) -> str:
    """A node's name as a parameter file writes it, without its namespace."""
    return pattern.rpartition("/")[2]


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
