"""Node parameters from a settings model: names, defaults, descriptions and ranges."""

from __future__ import annotations

import difflib
import sys
import types
from collections.abc import Collection
from contextlib import suppress
from itertools import pairwise
from typing import Any, TypeVar, Union, get_args, get_origin

import annotated_types
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from roller_core.errors import SettingsError
from roller_core.parameter_files import (
    clashing_parameters,
    misspelt_section,
    passed_over_section,
)
from roller_core.settings import Settings

S = TypeVar("S", bound=Settings)


def declare_settings(node: Node, model: type[S], live: Collection[str] = ()) -> S:
    """Declare one parameter a field and return the validated settings.

    Fields of a group are parameters `group.name`. Parameters are read-only: a node keeps the
    settings it started with, so what a bag's report says holds for the whole bag.

    Parameters
    ----------
    node : Node
        Whose they are.
    model : type of Settings
        The settings.
    live : collection of str
        Parameters that may be changed all the same; the node sees to them.

    Raises
    ------
    SettingsError
        Naming the parameter that is out of range or of the wrong type.
    """
    source = f"parameters of node '{node.get_name()}'"
    _check_sections(node)
    _mend_clashes(node)
    values = _declare(node, model, None, "", source, live)
    # Those meant for others may be among them (section `/**`), so it is no error.
    for name in getattr(node, "_parameter_overrides", {}):
        if not node.has_parameter(name) and not name.startswith("qos_overrides."):
            alike = difflib.get_close_matches(name, model.names(), 1, 0.7)
            hint = f"; is it '{alike[0]}'?" if alike else ""
            node.get_logger().warning(f"there is no parameter '{name}'{hint}")
    return model.create(values, source)


def _check_sections(node: Node) -> None:
    """Warn of parameter files on the command line with sections that may be meant for the node."""
    for word, path in pairwise(sys.argv):
        if word == "--params-file":
            with suppress(SettingsError):  # ROS has taken it
                text = passed_over_section(path, node.get_fully_qualified_name())
                if text := text or misspelt_section(path, [node.get_name()]):
                    node.get_logger().warning(text)


def _mend_clashes(node: Node) -> None:
    """Put what the command line says last in the place of what ROS keeps of two types."""
    with suppress(SettingsError):  # ROS has taken it
        for name, value in clashing_parameters(sys.argv, node.get_fully_qualified_name()).items():
            node._parameter_overrides[name] = Parameter(name, value=value)


def _declare(
    node: Node,
    model: type[Settings],
    defaults: Settings | None,
    prefix: str,
    source: str,
    live: Collection[str],
) -> dict[str, Any]:
    """Values of a model's parameters by field; defaults are the model's unless given."""
    values: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        full = prefix + name
        default = getattr(defaults, name) if defaults else model.default_of(name)
        if isinstance(default, Settings):
            values[name] = _declare(node, type(default), default, full + ".", source, live)
            continue
        if isinstance(default, tuple):
            default = list(default)
        try:
            about = descriptor(full, field)
            about.read_only = full not in live
            node.declare_parameter(full, default, about)
        except (InvalidParameterValueException, InvalidParameterTypeException) as error:
            raise SettingsError(f"{source}: '{full}': {error}") from error
        value = node.get_parameter(full).value
        values[name] = list(value) if hasattr(value, "tolist") else value
    return values


def descriptor(name: str, field: FieldInfo) -> ParameterDescriptor:
    """The ROS descriptor of one settings field."""
    out = ParameterDescriptor(
        name=name, description=field.description or "", read_only=True, dynamic_typing=True
    )
    low, high = -float("inf"), float("inf")
    for rule in field.metadata:
        if isinstance(rule, annotated_types.Ge):
            low = max(low, float(rule.ge))  # type: ignore[arg-type]
        elif isinstance(rule, annotated_types.Gt):
            low = max(low, float(rule.gt))  # type: ignore[arg-type]
        elif isinstance(rule, annotated_types.Le):
            high = min(high, float(rule.le))  # type: ignore[arg-type]
        elif isinstance(rule, annotated_types.Lt):
            high = min(high, float(rule.lt))  # type: ignore[arg-type]
    kinds = _plain_types(field.annotation)
    if high == float("inf") and low == -float("inf"):
        return out
    if float in kinds:
        out.floating_point_range = [
            FloatingPointRange(from_value=max(low, -1e300), to_value=min(high, 1e300))
        ]
    elif int in kinds:
        limit = 2**62
        out.integer_range = [
            IntegerRange(from_value=int(max(low, -limit)), to_value=int(min(high, limit)))
        ]
    return out


def _plain_types(annotation: Any) -> set[Any]:
    if get_origin(annotation) in (Union, types.UnionType):
        return {t for a in get_args(annotation) for t in _plain_types(a)}
    return {annotation}
