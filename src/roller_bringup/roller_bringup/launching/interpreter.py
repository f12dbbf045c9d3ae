"""Doing what a launch file says, element by element, as launch does it."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from roller_core.text_file import TextFileError, read_text

from . import document, locate, substitutions
from .document import Element, LaunchError
from .plan import LaunchPlan, NodeProcess

_CONDITIONS = " if unless"
_ACTIONS = "arg let group push-ros-namespace node include set_env"
_DEEPEST_INCLUDE = 16
_MOST_INCLUDES = 100
_WITHOUT_END = "launch files include each other without end"
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
#: With it and the names of nodes and services, a name in DDS has at most 255 characters.
_LONGEST_NAMESPACE = 180
_NAMESPACE = re.compile(r"/|(/[A-Za-z_]\w*)+", re.ASCII)


@dataclass(frozen=True)
class Argument:
    """One argument of a launch file: its default as written (None: it must be given)."""

    name: str
    default: str | None
    description: str


def list_arguments(path: Path | str) -> list[Argument]:
    """List the arguments of a launch file, without running it.

    Raises
    ------
    LaunchError
        The file can't be read, or includes itself whatever the arguments are.
    """
    root = document.read(Path(path))
    _check_includes(root, (Path(path).resolve(),))
    found = (e.attributes for e in root.children if e.tag == "arg")
    return [Argument(a.get("name", ""), a.get("default"), a.get("description", "")) for a in found]


def _check_includes(parent: Element, above: tuple[Path, ...]) -> None:
    """Refuse files that include themselves without a condition, by names without substitutions."""
    for element in parent.children:
        if element.attributes.keys() & set(_CONDITIONS.split()):
            continue
        if element.tag == "group":
            _check_includes(element, above)
        path = Path(element.attributes.get("file", "")).resolve()
        if element.tag == "include" and path.is_file():
            if path in above or len(above) > _DEEPEST_INCLUDE:
                raise element.error(_WITHOUT_END)
            _check_includes(document.read(path), (*above, path))


def load(path: Path | str, arguments: Mapping[str, str] | None = None) -> LaunchPlan:
    """Work out which processes a launch file starts, in its order.

    Its arguments are given by name; those that it gives no default must be there.

    Raises
    ------
    LaunchError
        The file has something outside the subset, an argument is missing or unknown, or a
        package, an executable or a parameter file isn't there.
    """
    file = Path(path).absolute()
    given = dict(arguments or {})
    plan = LaunchPlan(file)
    try:
        interpreter = _Interpreter(plan, dict(given), dict(os.environ))
        interpreter.run_file(file)
        unknown = sorted(given.keys() - interpreter.declared)
        if unknown:
            known = ", ".join(sorted(interpreter.declared)) or "none"
            raise LaunchError(f"no argument '{unknown[0]}'; there are: {known}", file)
        if not plan.processes:
            raise LaunchError("nothing to start", file)
    except BaseException:
        plan.close()
        raise
    return plan


class _Interpreter:
    """The state while a launch file is read from top to bottom."""

    def __init__(
        self, plan: LaunchPlan, configurations: dict[str, str], environment: dict[str, str]
    ) -> None:
        self.plan = plan
        self.configurations = configurations
        self.environment = environment
        self.namespace: str | None = None
        self.declared: set[str] = set()
        self._depth = self._includes = 0

    def run_file(self, path: Path) -> None:
        """Do all of a launch file."""
        root = document.read(path)
        root.only("", "version", _ACTIONS)
        self._run(root.children)

    def _run(self, elements: Sequence[Element]) -> None:
        for element in elements:
            if self._applies(element):
                getattr(self, "_" + element.tag.replace("-", "_"))(element)

    def _text(self, element: Element, name: str) -> str:
        """Give an attribute with its substitutions done."""
        return self._expand(element, element.attributes[name])

    def _expand(self, element: Element, text: str) -> str:
        try:
            return substitutions.expand(text, self._resolve)
        except (substitutions.SubstitutionError, locate.NotFoundError) as error:
            raise element.error(str(error)) from None

    def _resolve(self, name: str, arguments: Sequence[str]) -> str:
        if name == "find-pkg-share":
            return str(locate.package_share(arguments[0]))
        if name == "equals":
            return str(arguments[0] == arguments[1]).lower()
        if name == "file-content":
            try:
                return read_text(arguments[0])
            except TextFileError as error:
                raise substitutions.SubstitutionError(str(error)) from None
        values = self.configurations if name == "var" else self.environment
        if arguments[0] in values:
            return values[arguments[0]]
        if len(arguments) == 2:
            return arguments[1]
        what = "variable" if name == "var" else "environment variable"
        raise substitutions.SubstitutionError(f"there is no {what} '{arguments[0]}'")

    def _boolean(self, element: Element, name: str) -> bool:
        """Give an attribute that must be true or false (or 1 or 0)."""
        text = self._text(element, name).strip().lower()
        if text not in ("true", "1", "false", "0"):
            raise element.error(f"'{name}' must be true or false, not {text!r}")
        return text in ("true", "1")

    def _seconds(self, element: Element, name: str) -> float | None:
        """Give an attribute that is a time, if it is there."""
        if name not in element.attributes:
            return None
        text = self._text(element, name)
        if not re.fullmatch(r"\d{1,4}(\.\d*)?", text):
            raise element.error(f"'{name}' must be seconds, not {text!r}")
        return float(text)

    def _applies(self, element: Element) -> bool:
        if "if" in element.attributes and "unless" in element.attributes:
            raise element.error("'if' and 'unless' can't stand together")
        if "if" in element.attributes:
            return self._boolean(element, "if")
        return "unless" not in element.attributes or not self._boolean(element, "unless")

    def _arg(self, element: Element) -> None:
        """Declare an argument; one that was given keeps its value."""
        element.only("name", "default description" + _CONDITIONS)
        name = element.attributes["name"]
        self.declared.add(name)
        if name not in self.configurations:
            if "default" not in element.attributes:
                raise element.error(f"the argument '{name}' must be given: {name}:=VALUE")
            self.configurations[name] = self._text(element, "default")

    def _let(self, element: Element) -> None:
        element.only("name value", _CONDITIONS)
        self.configurations[self._text(element, "name")] = self._text(element, "value")

    def _set_env(self, element: Element) -> None:
        element.only("name value", _CONDITIONS)
        self.environment[self._text(element, "name")] = self._text(element, "value")

    def _group(self, element: Element) -> None:
        """Do the elements of a group; what they set ends with it."""
        element.only("", _CONDITIONS, _ACTIONS)
        before = (dict(self.configurations), dict(self.environment), self.namespace)
        self._run(element.children)
        self.configurations, self.environment, self.namespace = before

    def _push_ros_namespace(self, element: Element) -> None:
        """Put the nodes to come into a namespace, below the one they are in."""
        element.only("namespace", _CONDITIONS)
        pushed = self._text(element, "namespace")
        below = "" if pushed.startswith("/") else self.namespace or ""
        joined = "/" + f"{below}/{pushed}".strip("/")
        if not _NAMESPACE.fullmatch(joined):
            raise element.error(f"{joined!r} can't be a namespace")
        if len(joined) > _LONGEST_NAMESPACE:
            raise element.error(
                f"a namespace has at most {_LONGEST_NAMESPACE} characters, not {len(joined)}"
            )
        self.namespace = joined

    def _include(self, element: Element) -> None:
        """Do another file here. As in launch, what it sets stays set unless a group scopes it."""
        element.only("file", _CONDITIONS, "arg")
        path = Path(self._text(element, "file"))
        if not path.is_file():
            raise element.error(f"there is no launch file {path}")
        self._includes += 1
        if self._depth == _DEEPEST_INCLUDE or self._includes > _MOST_INCLUDES:
            raise element.error(_WITHOUT_END)
        for argument in element.children:
            argument.only("name value")
            name = self._text(argument, "name")
            self.configurations[name] = self._text(argument, "value")
        self._depth += 1
        self.run_file(path)
        self._depth -= 1

    def _node(self, element: Element) -> None:
        """Plan a node's process, with the arguments launch_ros would give it."""
        element.only("pkg exec name", "args output on_exit sigterm_timeout" + _CONDITIONS, "param")
        if element.attributes.get("output", "screen") not in ("screen", "log"):
            raise element.error("'output' must be screen or log")
        if element.attributes.get("on_exit", "shutdown") != "shutdown":
            raise element.error("'on_exit' can only be shutdown")
        name = self._text(element, "name")
        if not _NAME.fullmatch(name):
            raise element.error(f"{name!r} can't be a node's name")
        package = self._text(element, "pkg")
        try:
            program = locate.executable(package, self._text(element, "exec"))
        except locate.NotFoundError as error:
            raise element.error(str(error)) from None
        words = substitutions.split(element.attributes.get("args", ""))
        if any(quote in word for word in words for quote in "'\""):
            raise element.error("quotes in 'args' are not supported")
        command = [str(program), *(self._expand(element, word) for word in words)]
        command += ["--ros-args", "-r", f"__node:={name}"]
        if self.namespace is not None:
            command += ["-r", f"__ns:={self.namespace}"]
        for child in element.children:
            command += ["--params-file", str(self._parameter_file(child))]
        environment = dict(self.environment)
        if not program.is_relative_to(sys.prefix):
            # Set by ROS wheels in our Python; a Python of another environment would skip finding
            # its own libraries because of it.
            environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        required = "on_exit" in element.attributes
        process = NodeProcess(
            name, tuple(command), environment, required, self.namespace or "/",
            self._seconds(element, "sigterm_timeout"), package.startswith("roller_"),
        )  # fmt: skip
        if any(other.label == process.label for other in self.plan.processes):
            raise element.error(f"a second node is called {process.label}")
        self.plan.processes.append(process)

    def _parameter_file(self, element: Element) -> Path:
        """Give the file that a `<param>` names, or a copy with its substitutions done."""
        element.only("from", "allow_substs")
        path = Path(self._text(element, "from"))
        if not path.is_file():
            raise element.error(f"there is no parameter file {path}")
        if "allow_substs" not in element.attributes or not self._boolean(element, "allow_substs"):
            return path
        try:
            text = self._expand(element, path.read_text(encoding="utf-8"))
            yaml.safe_load(text)
        except (OSError, ValueError, yaml.YAMLError, RecursionError):
            raise element.error(f"{path} isn't YAML with these arguments in it") from None
        return self.plan.write(text)
