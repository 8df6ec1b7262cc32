"""What stands at the top of a mission file: its name, scene, goal and plug-ins."""

from __future__ import annotations

from ...files.expressions.expression import Expression, ExpressionError
from ...files.expressions.type_inference import INT, check_types
from ...files.yaml.document import Document, Fault, Location, nearest, where
from ..plugins.plugin_import import PluginError
from ..values.expression_pointer import Pointer
from ..values.fault_collector import Faults
from ..values.port_types import show
from .registry import Registry

_KEYS = ("picktree", "kind", "name", "scene", "goal", "library", "include", "plugins", "trees")
_NOT_IN_LIBRARY = ("scene", "goal")
_GOAL_NAMES = ("total", "sorted", "misplaced", "left", "outstanding")


class MissionHead:
    """Reads the top of one document; plug-ins are added to the registry."""

    def __init__(self, document: Document, registry: Registry, faults: Faults, pointer: Pointer) -> None:
        self._document = document
        self._registry = registry
        self._faults = faults
        self._pointer = pointer

    @property
    def library(self) -> bool:
        """Whether the file holds sub-trees for others only."""
        return self._document.data.get("library") is True

    def check_keys(self) -> None:
        if self._document.data.get("library") not in (None, True, False):
            self._fault(("library",), "'library' is true or false", code="P202")
        for key in self._document.data:
            if key not in _KEYS:
                hint = self._faults.nearest(key, _KEYS)
                self._fault((key,), f"a mission has no key {show(key)}", hint, code="P201", key=True)
            elif key in _NOT_IN_LIBRARY and self.library:
                message = f"a library has no {key!r}: that is for the mission to say"
                self._fault((key,), message, code="P248", key=True)

    def text(self, key: str) -> str | None:
        """The text under a key; None when there is none."""
        value = self._document.data.get(key)
        if value is None or (isinstance(value, str) and value):
            return value
        self._fault((key,), f"{key!r} is a text", code="P202")
        return None

    def goal(self) -> Expression | None:
        """What the scorer is to find after the run."""
        value = self._document.data.get("goal")
        if value is None:
            return None
        if not isinstance(value, str):
            hint = "as 'misplaced == 0 and left <= 1'"
            self._fault(("goal",), "the goal is an expression", hint, code="P203")
            return None
        try:
            goal = Expression.parse(value)
        except ExpressionError as error:
            self._goal_fault(value, error, "P225")
            return None
        unknown = sorted(goal.names - set(_GOAL_NAMES))
        for name in unknown:
            self._fault(("goal",), f"a goal knows no {name!r}", nearest(name, _GOAL_NAMES), code="P203")
        try:
            check_types(goal, dict.fromkeys((*_GOAL_NAMES, *unknown), INT), {})
        except ExpressionError as error:
            self._goal_fault(value, error, "P226")
        return goal

    def _goal_fault(self, goal: str, error: ExpressionError, code: str) -> None:
        mark, message = self._pointer.told(self._document.mark(("goal",)), goal, error)
        self._faults.add(Fault(mark, "goal", message, "", code))

    def plugins(self) -> tuple[str, ...]:
        """The plug-ins that the file names."""
        value = self._document.data.get("plugins")
        if value is None:
            return ()
        if not isinstance(value, list):
            message = "'plugins' is a list of modules and of Python files beside the mission"
            self._fault(("plugins",), message, code="P202")
            return ()
        for index, plugin in enumerate(value):
            loc: Location = ("plugins", index)
            if not isinstance(plugin, str) or not plugin:
                message = "a plug-in is the name of a module or of a Python file"
                self._fault(loc, message, code="P202")
                continue
            try:
                self._registry.add_plugin(plugin, self._document.path.parent)
            except PluginError as error:
                self._fault(loc, error.message, error.hint, code=error.code, detail=error.detail)
        return tuple(plugin for plugin in value if isinstance(plugin, str))

    def _fault(
        self, loc: Location, message: str, hint: str = "", *, code: str, key: bool = False, detail: str = ""
    ) -> None:
        at = where(loc)
        self._faults.at(self._document, loc, at, message, hint, code=code, key=key, detail=detail)
