"""One job of a batch: a variant with a seed, and an id that follows from all that it runs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from ..logs.recipe_record import installed_meshes, recipe_files
from ..logs.request import RunRequest, read_recipe
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
        return _request(plan, self.variant, self.seed, out)


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
    recipe = read_recipe(_request(plan, variant, 0, None))
    said = {
        "settings": dict(variant.settings),
        "backend": recipe.backend,
        "verify": recipe.verify,
        "limit": recipe.limit,
        "files": {file.name: hashlib.sha256(file.data).hexdigest() for file in recipe_files(recipe)},
        "robot": {name: word.partition(" ")[0] for name, word in installed_meshes(recipe.robot).items()},
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _request(plan: Plan, variant: Variant, seed: int, out: Path | None) -> RunRequest:
    return RunRequest(
        mission=variant.mission,
        scene=variant.scene,
        seed=seed,
        parameters=variant.settings,
        faults=variant.faults,
        out=out,
        backend=plan.backend,
        verify=plan.verify,
        limit=plan.limits.simulated,
    )
