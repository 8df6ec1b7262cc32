"""Old names of picktree's modules and classes. They work for one release, each with one DeprecationWarning.

`from picktree.planning.requests import Line` imports what the tables name in its place. A module that
exists is always the one that is imported; the tables only count where there is none.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Final, cast

if TYPE_CHECKING:
    from importlib.abc import Loader  # slow to import

# Without the package's name, so that they remain as they are when all names in the sources are rewritten.
MODULES: Final[Mapping[str, str]] = {
    "analysis.replay.cursor": "analysis.cursor",
    "batch.batch": "batch.workers.batch",
    "batch.cluster.executor": "batch.cluster.ray_executor",
    "cell.handover": "skill_world.world",
    "cell.operator_desk": "skill_world.operator_desk",
    "cell.vision": "skill_world.vision",
    "cell.world": "skill_world.world",
    "logs.comparing.alignment": "analysis.compare.alignment",
    "logs.comparing.first_difference": "analysis.compare.divergence",
    "logs.operators": "session.observer",
    "logs.resimulation.changes": "analysis.resim.changes",
    "logs.resimulation.resim": "analysis.resim.resim",
    "logs.resimulation.whatif": "analysis.resim.whatif",
    "logs.resuming.resumption": "session.resume.resumption",
    "logs.session": "session.session",
    "logs.stepping.cursor": "analysis.cursor",
    "trees.debugger": "session.debugger",
    "trees.drawing.charting": "authoring.drawing.chart_builder",
    "trees.drawing.svg": "authoring.drawing.formats.svg",
    "trees.running.debugger": "session.debugger",
    "world.control.courses": "control.cartesian.compliant_motion",
    "world.control.jogging": "control.execution.jog_motion",
    "world.control.stiffness": "control.cartesian.compliant_motion",
    "world.control.twist": "control.cartesian.twist",
    "world.errors": "errors",
    "world.motion.requests": "planning.requests",
    "world.motion.solver": "planning.service.solver",
    "world.robot.load": "robots.loading",
    "world.robot.model": "robots.model",
    "world.scene.load": "world.scene.loading.scene_loading",
    "world.scene.planning_scene": "world.belief.planning_scene",
    "world.world": "skill_world.world",
}
"""New name of a module by its old one."""
NAMES: Final[Mapping[str, str]] = {
    "logs.Run": "analysis.Run",
    "logs.operators.GivenAnswers": "session.observer.PresetAnswers",
    "logs.resimulation.changes.Changes": "analysis.resim.changes.RunChanges",
    "trees.debugger.Stop": "session.debugger.DebuggerStop",
    "world.control.courses.Course": "control.cartesian.compliant_motion.CompliantMotion",
    "world.control.courses.Felt": "control.cartesian.compliant_motion.ContactState",
    "world.control.jogging.JogStatus": "control.execution.jog_motion.JogFeedback",
    "world.control.stiffness.Stiffness": "control.cartesian.compliant_motion.CartesianStiffness",
    "world.motion.requests.Holding": "planning.requests.HeldObject",
    "world.motion.requests.Line": "planning.requests.LineGoal",
    "world.motion.requests.Offset": "planning.requests.OffsetGoal",
    "world.motion.requests.Upright": "planning.requests.UprightConstraint",
    "world.motion.solver.Solver": "planning.service.solver.RequestSolver",
}
"""New place of a class or function by its old one, where its name or its package has changed."""


class Aliases:
    """Finder and loader of modules that exist under another name only, by tables as `MODULES` and `NAMES`."""

    def __init__(self, package: str, modules: Mapping[str, str], names: Mapping[str, str]) -> None:
        self._package = package
        self._modules = modules
        self._names = names
        self._above = {old[:at] for old in modules for at, letter in enumerate(old) if letter == "."}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the specification of an alias; None when the tables have no such module."""
        package, _, old = fullname.partition(".")
        if package != self._package or not (old in self._modules or old in self._above):
            return None
        return ModuleSpec(fullname, cast("Loader", self), is_package=old in self._above)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return a module without content."""
        return _Alias(spec.name, self)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: an alias imports its module when a name is asked of it."""

    def find(self, module: str, name: str) -> object:
        """Return what `name` of the old `module` is now, with one DeprecationWarning that names its place.

        A package that still exists calls it from its `__getattr__(name)`, with its own `__name__`. Raises
        AttributeError when neither the tables nor the new module have the name.
        """
        old = module.partition(".")[2]
        place, _, new = self._names.get(f"{old}.{name}", "").rpartition(".")
        place = place or self._modules.get(old, "")
        if not place or name.startswith("__"):
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        there = import_module(f"{self._package}.{place}")
        new = new if hasattr(there, new) else name  # a class that has moved, and is not yet renamed
        if not hasattr(there, new):
            raise AttributeError(
                f"module {module!r} is {there.__name__!r} now, and has no attribute {name!r}"
            )
        import warnings  # an import of picktree needs none

        message = f"{module}.{name} is deprecated: write from {there.__name__} import {new}"
        warnings.warn(message, DeprecationWarning, stacklevel=3)
        found: object = getattr(there, new)
        setattr(sys.modules[module], name, found)  # asked for once
        return found


class _Alias(ModuleType):
    """Module under its old name."""

    def __init__(self, name: str, aliases: Aliases) -> None:
        super().__init__(name)
        self._aliases = aliases

    def __getattr__(self, name: str) -> object:
        return self._aliases.find(self.__name__, name)


ALIASES: Final = Aliases(__name__.partition(".")[0], MODULES, NAMES)


def install() -> None:
    """Let the old names be imported. Modules that exist are found before."""
    if ALIASES not in sys.meta_path:
        sys.meta_path.append(ALIASES)
