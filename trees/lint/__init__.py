"""The linter: what is well-formed and yet a mistake. Each rule has a code, and a file of this folder."""

from __future__ import annotations

from ...world.files.document import Fault
from ..mission import Mission
from ..surroundings import Surroundings


def lint(mission: Mission, known: Surroundings | None = None) -> tuple[Fault, ...]:
    """What the rules find in a mission that loads; `known` are the names of its scene and robot."""
    del mission, known
    return ()
