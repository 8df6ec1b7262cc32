"""Checking a mission file as a whole: its language, its scene, the names that it uses, and the linter."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import PicktreeError
from ...files.yaml.document import Document, Fault, FileError
from ...trees.loading.loader import examine
from ...trees.loading.registry import Registry
from ...trees.loading.scene_names import Surroundings, load_surroundings
from ...trees.mission import Mission
from ..lint import lint
from .name_checks import misnamed


@dataclass(frozen=True, slots=True)
class MissionCheck:
    """What was found in a mission file. `mission` is None when the text has errors of its own."""

    mission: Mission | None
    faults: tuple[Fault, ...]
    """In the order of the files; also those of the scene and the robot, with their own places."""


def check_mission(
    document: Document, registry: Registry | None = None, known: Surroundings | None = None
) -> MissionCheck:
    """Everything that can be said of a document of kind `mission`; never raises for what stands in it.

    `known` are the names of the scene and the robot that it runs with, by default those that it names.
    """
    reading = examine(document, registry)
    known, faults = (known, []) if known is not None else _surroundings(reading.mission)
    faults = [*reading.faults, *faults]
    if known is not None:
        faults += misnamed(reading, known)
    if not any(fault.severity == "error" for fault in faults):
        faults += lint(reading.mission, known)
    ordered = sorted(dict.fromkeys(faults), key=lambda fault: fault.mark)
    wrong = any(fault.severity == "error" for fault in reading.faults)
    return MissionCheck(None if wrong else reading.mission, tuple(ordered))


def _surroundings(mission: Mission) -> tuple[Surroundings | None, list[Fault]]:
    """The names of the mission's scene and robot; None when it names no scene, or a faulty one."""
    if mission.scene is None:
        return None, []
    try:
        return load_surroundings(mission.scene, mission.document.path.parent), []
    except FileError as error:
        return None, list(error.faults)
    except PicktreeError as error:
        return None, [mission.document.fault(("scene",), str(error), code="P241")]
