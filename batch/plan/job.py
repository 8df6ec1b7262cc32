"""One job of a batch: a variant with a seed, and an id that follows from all that it runs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from ...session.recipe import Recipe
from ...session.recipe_files import installed_meshes, recipe_files
from ...session.request import RunRequest, read_recipe
from ...session.resume.recipe_archive import write_recipe
from .plan import Plan, Variant

RECIPES = "recipes"
"""Folder of a batch with all that its jobs run, once for each variant."""


@dataclass(frozen=True, slots=True)
class Job:
    """What one worker runs at a time."""

    id: str
    """Hash over the content of its files, its settings, its seed and how it is run."""
    number: int
    """Its place in the plan, from 0."""
    variant: Variant
    seed: int
    recipe: str
    """Hash over all of that but the seed, which names the file that holds it."""

    def recipe_in(self, folder: Path) -> Path:
        """What it runs, as the batch in `folder` keeps it."""
        return folder / RECIPES / f"{self.recipe}.zip"


def jobs_of(plan: Plan, folder: Path) -> tuple[Job, ...]:
    """Every job of a checked plan, seeds together by variant. What they run is put into the batch's `folder`.

    Raises FileError for a file that was edited since it was checked, PicktreeError when one cannot be
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
    """A fingerprint of everything but the seed on which the outcome depends."""
    said = {
        "settings": dict(variant.settings),
        "backend": recipe.backend,
        "verify": recipe.verify,
        "limit": recipe.limit,
        "files": {file.name: hashlib.sha256(file.data).hexdigest() for file in recipe_files(recipe)},
        "robot": {name: word.partition(" ")[0] for name, word in installed_meshes(recipe.robot).items()},
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _request(plan: Plan, variant: Variant) -> RunRequest:
    return RunRequest(
        mission=variant.mission,
        scene=variant.scene,
        parameters=variant.settings,
        faults=variant.faults,
        backend=plan.backend,
        verify=plan.verify,
        limit=plan.limits.simulated,
    )
