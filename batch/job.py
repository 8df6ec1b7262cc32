"""One job of a batch: a variant with a seed, and an id that follows from all that it runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..logs.mission_record import mission_files
from ..logs.request import RunRequest
from ..trees.mission import Mission
from ..world.robot.load import load_robot
from ..world.scene.load import load_scene
from ..world.shapes import ConvexMesh
from .load import load_variant_mission
from .plan import Plan, Variant


@dataclass(frozen=True, slots=True)
class Job:
    """What one worker runs at a time."""

    id: str
    """Hash over the content of its files, its settings, its seed and how it is run."""
    number: int
    """Its place in the plan, from 0."""
    variant: Variant
    seed: int

    def request(self, plan: Plan, out: Path) -> RunRequest:
        """As a run; `out` is the folder in which the run's own folder is made."""
        return RunRequest(
            mission=self.variant.mission,
            scene=self.variant.scene,
            seed=self.seed,
            parameters=self.variant.settings,
            faults=self.variant.faults,
            out=out,
            backend=plan.backend,
            verify=plan.verify,
            limit=plan.limits.simulated,
        )


def jobs_of(plan: Plan) -> tuple[Job, ...]:
    """Every job of a checked plan, seeds together by variant. Raises FileError for an edited file."""
    jobs: list[Job] = []
    for variant in plan.variants():
        content = _content(plan, variant)
        jobs += (Job(_id(content, seed), len(jobs) + k, variant, seed) for k, seed in enumerate(plan.seeds))
    return tuple(jobs)


def _id(content: str, seed: int) -> str:
    return hashlib.sha256(f"{content} seed {seed}".encode()).hexdigest()[:16]


def _content(plan: Plan, variant: Variant) -> str:
    """A fingerprint of everything but the seed on which the outcome depends."""
    said = {
        "settings": dict(variant.settings),
        "backend": plan.backend,
        "verify": plan.verify,
        "limit": plan.limits.simulated,
        "files": dict(_files(variant)),
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _files(variant: Variant) -> Iterator[tuple[str, str]]:
    mission: Mission = load_variant_mission(variant)
    for file in mission_files(mission):
        yield file.name, _hash(file.content)
    name = variant.scene or mission.scene or ""
    scene = load_scene(name, None if variant.scene else variant.mission.parent)
    robot = load_robot(scene.robot, Path(scene.source).parent)
    yield "scene", _hash(scene.text)
    yield "robot", _hash(robot.text)
    yield "urdf", _hash(Path(robot.urdf).read_bytes())
    for entry in scene.catalogue:
        if isinstance(entry.shape, ConvexMesh):
            yield f"mesh/{entry.shape.source}", _hash(Path(entry.shape.source).read_bytes())
    if variant.faults is not None:
        yield "faults", _hash(variant.faults.read_bytes())


def _hash(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()
