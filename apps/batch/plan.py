"""Plan of a batch: a matrix of missions, scenes, faults and settings, each with many seeds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Literal, TypeAlias

from pydantic import TypeAdapter, ValidationError

from ...files.atomic_write import whole
from ...files.errors import PicktreeError
from ...session.recipe import Recipe, RunRequest, installed_meshes, read_recipe, recipe_files
from ...session.recipe_archive import write_recipe
from ...simulation.backends import Backend

Keep: TypeAlias = Literal["all", "failures", "none"]
"""Logs that are kept."""


@dataclass(frozen=True, slots=True)
class JobLimits:
    """Limits of one job."""

    simulated: float = 3600.0
    """Simulated time limit, s; the run then ends as `timeout`."""
    wall: float = 3600.0
    """Wall time limit, s; the job is then ended."""
    memory: int = 4 << 30
    """Limit of resident memory, bytes; the job is then ended."""
    disk: int = 10 * 10**9
    """Limit of written data, bytes; the job is then ended."""


@dataclass(frozen=True, slots=True)
class Variant:
    """One cell of the matrix, without a seed."""

    mission: Path
    scene: str | None
    """Scene that replaces the mission's; the path of a file is absolute. None: the mission's own."""
    faults: Path | None
    settings: Mapping[str, str]
    label: str
    """Properties that distinguish this variant from the others of its plan."""
    robot: str | None = None
    """Robot that replaces the scene's; the path of a file is absolute. None: the scene's own."""


@dataclass(frozen=True, slots=True)
class BatchPlan:
    """Requested batch. Paths are absolute."""

    name: str
    missions: tuple[Path, ...]
    seeds: tuple[int, ...]
    scenes: tuple[str | None, ...] = (None,)
    faults: tuple[Path | None, ...] = (None,)
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, "tuple[str, ...]"])
    """Values to try, by parameter of the mission or port of its nodes."""
    backend: Backend = "physics"
    verify: bool = False
    limits: JobLimits = JobLimits()
    keep: Keep = "failures"
    robots: tuple[str | None, ...] = (None,)

    def variants(self) -> Iterator[Variant]:
        """Yield every combination; the last list changes fastest."""
        names = list(self.settings)
        for mission, scene, robot, faults in product(self.missions, self.scenes, self.robots, self.faults):
            for values in product(*self.settings.values()):
                settings = dict(zip(names, values, strict=True))
                variant = Variant(mission, scene, faults, settings, "", robot)
                yield replace(variant, label=self._label(variant))

    def _label(self, variant: Variant) -> str:
        mission, scene, faults = variant.mission, variant.scene, variant.faults
        words: list[str] = []
        if len(self.missions) > 1:
            words.append(mission.stem)
        if len(self.scenes) > 1:
            words.append(Path(scene).stem if scene else "own scene")
        if len(self.robots) > 1:
            words.append(Path(variant.robot).stem if variant.robot else "own robot")
        if len(self.faults) > 1:
            words.append(faults.stem if faults else "no faults")
        words += [
            f"{name}={value}" for name, value in variant.settings.items() if len(self.settings[name]) > 1
        ]
        return ", ".join(words) or mission.stem


RECIPES = "recipes"
"""Folder of a batch with the recipes of its jobs, one for each variant."""


@dataclass(frozen=True, slots=True)
class Job:
    """Unit of work of one worker."""

    id: str
    """Hash over the content of the job's files, its settings, its seed and its options."""
    number: int
    """Index in the plan, from 0."""
    variant: Variant
    seed: int
    recipe: str
    """Hash over the same without the seed; it names the recipe's file."""

    def recipe_in(self, folder: Path) -> Path:
        """Return the recipe's file in the batch's `folder`."""
        return folder / RECIPES / f"{self.recipe}.zip"


def jobs_of(plan: BatchPlan, folder: Path) -> tuple[Job, ...]:
    """Return every job of a checked plan, by variant, then seed; write their recipes into `folder`.

    Raises FileError for a file that was edited since the check, PicktreeError when a recipe cannot be
    written.
    """
    jobs: list[Job] = []
    for variant in plan.variants():
        recipe = read_recipe(_request(plan, variant))
        content = _content(variant, recipe)
        for seed in plan.seeds:
            jobs.append(Job(_id(content, seed), len(jobs), variant, seed, content[:16]))
        write_recipe(recipe, jobs[-1].recipe_in(folder))
    return tuple(jobs)


def _id(content: str, seed: int) -> str:
    return hashlib.sha256(f"{content} seed {seed}".encode()).hexdigest()[:16]


def _content(variant: Variant, recipe: Recipe) -> str:
    """Return a fingerprint of everything but the seed on which the outcome depends."""
    said = {
        "settings": dict(variant.settings),
        "backend": recipe.backend,
        "verify": recipe.verify,
        "limit": recipe.limit,
        "files": {file.name: hashlib.sha256(file.data).hexdigest() for file in recipe_files(recipe)},
        "robot": {name: word.partition(" ")[0] for name, word in installed_meshes(recipe.robot).items()},
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _request(plan: BatchPlan, variant: Variant) -> RunRequest:
    return RunRequest(
        mission=variant.mission,
        scene=variant.scene,
        parameters=variant.settings,
        robot=variant.robot,
        faults=variant.faults,
        backend=plan.backend,
        verify=plan.verify,
        limit=plan.limits.simulated,
    )


PLAN_FILE = "plan.json"
_ADAPTER = TypeAdapter(BatchPlan)


def write_plan(plan: BatchPlan, folder: Path) -> None:
    """Write the plan. Raises PicktreeError when it cannot be written."""
    with whole([folder / PLAN_FILE], folder / PLAN_FILE) as (beside,):
        beside.write_bytes(_ADAPTER.dump_json(plan, indent=1))


def read_plan(folder: Path) -> BatchPlan:
    """Read the plan of a batch. Raises PicktreeError when there is none."""
    try:
        return _ADAPTER.validate_json((folder / PLAN_FILE).read_bytes())
    except OSError:
        raise PicktreeError(f"{folder}: no batch: there is no {PLAN_FILE} in it") from None
    except ValidationError as error:
        raise PicktreeError(f"{folder / PLAN_FILE}: no plan of a batch: {error.errors()[0]['msg']}") from None
