"""Settings: frozen, validated once at the edge, one source of defaults.

A settings model is what node parameters, parameter files and the documentation are made from:
every field carries a description and, for numbers, its range. A field that is itself a model is a
group; ROS names its parameters `group.name`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from .errors import SettingsError

S = TypeVar("S", bound="Settings")

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


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with each group a mapping of its own."""
    found: dict[str, Any] = {}
    merge(found, values)
    return found


def merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Add parameters to those before; `group.name: 1` and `group: {name: 1}` say the same."""
    for name, value in values.items():
        group, dot, rest = str(name).partition(".")
        if dot:
            merge(into, {group: {rest: value}})
        elif isinstance(value, Mapping):
            own = into.get(name)
            into[name] = dict(own) if isinstance(own, Mapping) else {}
            merge(into[name], value)
        else:
            into[name] = value


def _completed(default: Any, given: Any) -> Any:
    """What is given of a group, and of groups within, on top of the default."""
    if not isinstance(default, Settings) or not isinstance(given, Mapping):
        return given
    values = {name: getattr(default, name) for name in type(default).model_fields}
    return values | {k: _completed(values.get(k), v) for k, v in given.items()}
