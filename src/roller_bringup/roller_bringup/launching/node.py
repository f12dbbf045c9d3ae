"""The `<node>` element: one process with the arguments launch_ros would give it."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from . import locate, parameters, substitutions
from .document import Element
from .plan import NodeProcess

if TYPE_CHECKING:
    from .interpreter import Interpreter

_OPTIONAL = {
    "name",
    "namespace",
    "args",
    "output",
    "on_exit",
    "respawn",
    "respawn_delay",
    "if",
    "unless",
}
_OUTPUTS = ("screen", "log", "both", "own_log", "full")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NAMESPACE = re.compile(r"/|(/[A-Za-z_][A-Za-z0-9_]*)+")


def join_namespace(base: str | None, namespace: str | None) -> str | None:
    """Put a relative namespace below another; the result is absolute."""
    if namespace is None:
        joined = base
    elif not base or namespace.startswith("/"):
        joined = namespace
    else:
        joined = f"{base.rstrip('/')}/{namespace}"
    if joined is None:
        return None
    return joined if joined == "/" else "/" + joined.strip("/")


def check_namespace(element: Element, namespace: str | None) -> None:
    """Refuse what can't be a ROS namespace."""
    if namespace is not None and not _NAMESPACE.fullmatch(namespace):
        raise element.error(f"{namespace!r} can't be a namespace")


def add(state: Interpreter, element: Element) -> None:
    """Add the process of a `<node>` to the plan.

    Raises
    ------
    LaunchError
        The element has something unknown, or its executable or a parameter file isn't there.
    """
    element.only({"pkg", "exec"}, _OPTIONAL, {"param", "remap", "env"})
    try:
        program = locate.executable(state.text(element, "pkg"), state.text(element, "exec"))
    except locate.NotFoundError as error:
        raise element.error(str(error)) from None
    if state.text(element, "output") not in _OUTPUTS if "output" in element.attributes else False:
        raise element.error(f"'output' must be one of {', '.join(_OUTPUTS)}")
    if element.attributes.get("on_exit", "shutdown") != "shutdown":
        raise element.error("'on_exit' can only be shutdown")

    name = state.text(element, "name") if "name" in element.attributes else None
    if name is not None and not _NAME.fullmatch(name):
        raise element.error(f"{name!r} can't be a node's name")
    own = state.text(element, "namespace") if "namespace" in element.attributes else None
    namespace = join_namespace(state.namespace, own)
    check_namespace(element, namespace)

    command = [str(program)]
    if "args" in element.attributes:
        command += _arguments(state, element)
    command.append("--ros-args")
    if name is not None:
        command += ["-r", f"__node:={name}"]
    if namespace is not None:
        command += ["-r", f"__ns:={namespace}"]
    full_name = "/**" if name is None else f"{(namespace or '').rstrip('/')}/{name}"
    for child in element.children:
        if child.tag == "param":
            command += ["--params-file", str(_parameter_file(state, child, full_name))]
    for child in element.children:
        if child.tag == "remap":
            child.only({"from", "to"}, set(), set())
            command += ["-r", f"{state.text(child, 'from')}:={state.text(child, 'to')}"]

    state.plan.processes.append(
        NodeProcess(
            name=_label(state, name or program.name),
            command=tuple(command),
            env=_environment(state, element, program),
            required="on_exit" in element.attributes,
            respawn="respawn" in element.attributes and state.boolean(element, "respawn"),
            respawn_delay_s=_seconds(state, element, "respawn_delay"),
        )
    )


def _label(state: Interpreter, name: str) -> str:
    """Tell nodes of one name apart."""
    count = sum(process.name.split("-")[0] == name for process in state.plan.processes)
    return f"{name}-{count + 1}" if count else name


def _seconds(state: Interpreter, element: Element, name: str) -> float:
    """Give an attribute in seconds, 0 when absent."""
    if name not in element.attributes:
        return 0.0
    try:
        seconds = float(state.text(element, name))
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds < float("inf"):
        raise element.error(f"'{name}' must be a number of seconds, 0 or more")
    return seconds


def _environment(state: Interpreter, element: Element, program: Path) -> dict[str, str]:
    """Give the environment of a node's process."""
    environment = dict(state.environment)
    for child in element.children:
        if child.tag == "env":
            child.only({"name", "value"}, set(), set())
            environment[state.text(child, "name")] = state.text(child, "value")
    if not program.is_relative_to(sys.prefix):
        # Set by ROS wheels in our Python; a Python of another environment would skip finding its
        # own libraries because of it.
        environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return environment


def _arguments(state: Interpreter, element: Element) -> list[str]:
    """Split `args` at spaces, but not inside the values of substitutions, as launch does."""
    text = element.attributes["args"]
    try:
        template = substitutions.parse(text)
        words: list[str] = []
        glued = False
        for piece in template:
            if not isinstance(piece, str):
                value = substitutions.expand((piece,), state.resolve)
                if glued:
                    words[-1] += value
                else:
                    words.append(value)
                glued = True
                continue
            tokens = shlex.split(piece)
            if glued and tokens and not piece[0].isspace():
                words[-1] += tokens.pop(0)
            words += tokens
            glued = bool(piece) and not piece[-1].isspace() and bool(words)
    except (ValueError, locate.NotFoundError) as error:
        raise element.error(f"args: {error}") from None
    return words


def _parameter_file(state: Interpreter, element: Element, full_name: str) -> Path:
    """Give the file of a `<param>`: the one it names, or one written with its values."""
    if "from" in element.attributes:
        element.only({"from"}, set(), set())
        path = Path(state.text(element, "from"))
        if not path.is_file():
            raise element.error(f"there is no parameter file {path}")
        return path
    values = _values(state, element, "")
    path = state.plan.folder / f"parameters_{len(list(state.plan.folder.iterdir()))}.yaml"
    parameters.write(path, full_name, values)
    return path


def _values(state: Interpreter, element: Element, prefix: str) -> dict[str, parameters.Value]:
    """Give the values of a `<param>` and of those in it; nested names are joined with dots."""
    element.only({"name"}, {"value", "type"}, {"param"})
    name = prefix + state.text(element, "name")
    if not element.children:
        element.only({"name", "value"}, {"type"}, set())
        try:
            value = parameters.convert(state.text(element, "value"), element.attributes.get("type"))
        except ValueError as error:
            raise element.error(f"parameter '{name}': {error}") from None
        return {name: value}
    element.only({"name"}, set(), {"param"})
    found: dict[str, parameters.Value] = {}
    for child in element.children:
        found.update(_values(state, child, name + "."))
    return found
