"""Doing what a launch file says, element by element, as launch does it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from . import document, locate, node, substitutions
from .document import Element
from .plan import LaunchPlan

_CONDITIONS = {"if", "unless"}
_DEEPEST_INCLUDE = 32


class Interpreter:
    """The state while a launch file is read from top to bottom.

    Parameters
    ----------
    plan
        Gets the processes.
    configurations
        Arguments and variables by name.
    environment
        The environment of the processes to come.
    """

    def __init__(
        self, plan: LaunchPlan, configurations: dict[str, str], environment: dict[str, str]
    ) -> None:
        self.plan = plan
        self.configurations = dict(configurations)
        self.environment = dict(environment)
        self.namespace: str | None = None
        self.declared: set[str] = set()
        self._files: list[Path] = []
        self._actions: dict[str, Callable[[Element], None]] = {
            "arg": self._arg,
            "let": self._let,
            "group": self._group,
            "push-ros-namespace": self._push_namespace,
            "push_ros_namespace": self._push_namespace,
            "node": lambda element: node.add(self, element),
            "include": self._include,
            "set_env": self._set_env,
        }

    def run_file(self, path: Path) -> None:
        """Do all of a launch file."""
        root = document.read(path)
        root.only(set(), {"version"}, set(self._actions))
        self._files.append(path)
        self._run(root.children)
        self._files.pop()

    def _run(self, elements: Sequence[Element]) -> None:
        for element in elements:
            if self._applies(element):
                self._actions[element.tag](element)

    def text(self, element: Element, name: str) -> str:
        """Give an attribute with its substitutions done."""
        return self.expand(element, element.attributes[name])

    def expand(self, element: Element, text: str) -> str:
        """Do the substitutions of a text that stands in an element."""
        try:
            return substitutions.expand(substitutions.parse(text), self.resolve)
        except (substitutions.SubstitutionError, locate.NotFoundError) as error:
            raise element.error(str(error)) from None

    def resolve(self, name: str, arguments: Sequence[str]) -> str:
        """Give the value of a substitution."""
        if name == "find-pkg-share":
            return str(locate.package_share(arguments[0]))
        if name == "dirname":
            return str(self._files[-1].parent)
        if name == "equals":
            return str(substitutions.equal(*arguments)).lower()
        values = self.configurations if name == "var" else self.environment
        if arguments[0] in values:
            return values[arguments[0]]
        if len(arguments) == 2:
            return arguments[1]
        what = "variable" if name == "var" else "environment variable"
        raise substitutions.SubstitutionError(f"there is no {what} '{arguments[0]}'")

    def boolean(self, element: Element, name: str) -> bool:
        """Give an attribute that must be true or false (or 1 or 0)."""
        text = self.text(element, name).strip().lower()
        if text in ("true", "1"):
            return True
        if text in ("false", "0"):
            return False
        raise element.error(f"'{name}' must be true or false, not {text!r}")

    def _applies(self, element: Element) -> bool:
        """Tell whether an element's condition holds."""
        present = sorted(_CONDITIONS & element.attributes.keys())
        if len(present) == 2:
            raise element.error("'if' and 'unless' can't stand together")
        if not present:
            return True
        return self.boolean(element, present[0]) == (present[0] == "if")

    def _arg(self, element: Element) -> None:
        """Declare an argument; one that was given keeps its value."""
        element.only({"name"}, {"default", "description", *_CONDITIONS}, {"choice"})
        name = element.attributes["name"]
        self.declared.add(name)
        if name not in self.configurations:
            if "default" not in element.attributes:
                raise element.error(f"the argument '{name}' must be given: {name}:=VALUE")
            self.configurations[name] = self.text(element, "default")
        choices = [choice.attributes.get("value", "") for choice in element.children]
        if choices and self.configurations[name] not in choices:
            value = self.configurations[name]
            raise element.error(f"'{name}' must be one of {', '.join(choices)}, not {value!r}")

    def _let(self, element: Element) -> None:
        element.only({"name", "value"}, _CONDITIONS, set())
        self.configurations[self.text(element, "name")] = self.text(element, "value")

    def _set_env(self, element: Element) -> None:
        element.only({"name", "value"}, _CONDITIONS, set())
        self.environment[self.text(element, "name")] = self.text(element, "value")

    def _group(self, element: Element) -> None:
        """Do the elements of a group; scoped, what they set ends with it."""
        element.only(set(), {"scoped", *_CONDITIONS}, set(self._actions))
        scoped = "scoped" not in element.attributes or self.boolean(element, "scoped")
        kept = (dict(self.configurations), dict(self.environment), self.namespace)
        self._run(element.children)
        if scoped:
            self.configurations, self.environment, self.namespace = kept

    def _push_namespace(self, element: Element) -> None:
        element.only({"namespace"}, _CONDITIONS, set())
        joined = node.join_namespace(self.namespace, self.text(element, "namespace"))
        node.check_namespace(element, joined)
        self.namespace = joined

    def _include(self, element: Element) -> None:
        """Do another file here. As in launch, what it sets stays set unless a group scopes it."""
        element.only({"file"}, _CONDITIONS, {"arg"})
        path = Path(self.text(element, "file"))
        if not path.is_file():
            raise element.error(f"there is no launch file {path}")
        if not path.name.endswith(".xml"):
            raise element.error(f"only XML launch files are supported, not {path.name}")
        if len(self._files) >= _DEEPEST_INCLUDE:
            raise element.error("launch files include each other without end")
        for argument in element.children:
            argument.only({"name", "value"}, set(), set())
            name = self.text(argument, "name")
            self.configurations[name] = self.text(argument, "value")
        self.run_file(path)
