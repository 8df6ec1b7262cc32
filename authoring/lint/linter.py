"""Linter of missions: its rules, and their findings in the order of the file."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from picktree.files import Diagnostic
from picktree.trees import Mission
from picktree.trees.loading import SceneNames

from .arm_use import at_the_same_time, cleaning_arm, left_in_hand, nothing_held, started_anew
from .constants import short_timeouts, unknown_objects
from .endless_loops import endless, only_failing, unbounded_recovery, vain_attempts
from .handlers import needless_handlers, unhandled
from .mission_survey import LintModel
from .needless_nodes import needless_defaults, unreachable, without_effect
from .unused import breakpoints, never_read, read_before_written, unused_files, unused_ports, unused_trees

RULES: tuple[Callable[[LintModel], Iterable[Diagnostic]], ...] = (
    read_before_written,
    never_read,
    unhandled,
    needless_handlers,
    unreachable,
    endless,
    only_failing,
    unbounded_recovery,
    vain_attempts,
    without_effect,
    needless_defaults,
    short_timeouts,
    unknown_objects,
    left_in_hand,
    nothing_held,
    at_the_same_time,
    started_anew,
    cleaning_arm,
    unused_trees,
    unused_ports,
    unused_files,
    breakpoints,
)


def lint(mission: Mission, known: SceneNames | None = None) -> tuple[Diagnostic, ...]:
    """Return the findings of the rules in a mission without errors; `known`: names of its scene and robot.

    They are in the order of the file. Only nodes of the mission's own file count: other files are checked by
    themselves.
    """
    survey = LintModel(mission, known)
    found = dict.fromkeys(fault for rule in RULES for fault in rule(survey))
    return tuple(sorted(found, key=lambda fault: (fault.mark, fault.code)))
