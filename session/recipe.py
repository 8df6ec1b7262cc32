"""What a run is made from, apart from where that came from: files on the disk, a log, or a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..logs.schema.records import Continues
from ..robots.description import RobotDescription
from ..simulation.backends import Backend
from ..simulation.fault_files.fault_description import FaultFile
from ..trees.mission import Mission
from ..world.scene.description import SceneDescription
from .checkpoints import RunState

LIMIT = 3600.0
"""Simulated seconds after which a run is ended, unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Start:
    """A checkpoint from which a run goes on."""

    state: RunState
    continues: Continues
    """Whose checkpoint it is."""
    adopt: bool = False
    """The mission is another than the one of which the state was saved: what fits goes on, the rest begins
    anew."""
    changed: tuple[str, ...] = ()
    """Parameters that are set otherwise now: who runs and had read them reads them again."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything on which a run depends, read and checked. Two runs of the same recipe are the same."""

    mission: Mission
    scene: SceneDescription
    robot: RobotDescription
    seed: int = 0
    faults: FaultFile | None = None
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    """As `--set` gives them."""
    backend: Backend = "physics"
    verify: bool = False
    """Judge every trajectory by the second, independent collision checker."""
    limit: float = LIMIT
    """Simulated seconds."""
    own_scene: bool = True
    """The scene is the one that the mission names, not another that was given."""
    start: Start | None = None
    """None: from the beginning."""
    paths: Mapping[str, str] = field(default_factory=dict[str, str])
    """Of a recipe from a log: where its files stood when they were first read, by name of the attachment."""
