"""The linter: what is well-formed and yet a mistake. Its rules stand in the files of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ...world.files.document import Fault
from ..mission import Mission
from ..surroundings import Surroundings
from .causes import needless_handlers, unhandled
from .hand import left_in_hand
from .keys import never_read, read_before_written
from .loops import endless, unbounded_recovery, vain_attempts
from .needless import needless_defaults, without_effect
from .ports import breakpoints, unused_files, unused_ports, unused_trees
from .reaching import unreachable
from .resources import at_the_same_time, started_anew
from .survey import Survey

RULES: tuple[Callable[[Survey], Iterable[Fault]], ...] = (
    read_before_written,
    never_read,
    unhandled,
    needless_handlers,
    unreachable,
    endless,
    unbounded_recovery,
    vain_attempts,
    without_effect,
    needless_defaults,
    left_in_hand,
    at_the_same_time,
    started_anew,
    unused_trees,
    unused_ports,
    unused_files,
    breakpoints,
)


def lint(mission: Mission, known: Surroundings | None = None) -> tuple[Fault, ...]:
    """What the rules find in a mission without errors; `known` are the names of its scene and robot.

    In the order of the file. Only what stands in the mission's own file: others are judged by themselves.
    """
    survey = Survey(mission, known)
    found = dict.fromkeys(fault for rule in RULES for fault in rule(survey))
    return tuple(sorted(found, key=lambda fault: (fault.mark, fault.code)))
