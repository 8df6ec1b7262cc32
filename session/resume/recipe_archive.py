"""A recipe as one file, from which it can be run wherever and whenever: a ZIP archive of its files."""

from __future__ import annotations

import hashlib
import io
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

from pydantic import TypeAdapter, ValidationError

from ...errors import PicktreeError
from ...files.atomic_write import whole
from ...simulation.backends import Backend
from ..recipe import LIMIT, Recipe, fingerprints, recipe_files
from .unpacking import Unpacking

CARD = "recipe.json"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Of all files in an archive, so that the same recipe is the same file."""


@dataclass(frozen=True, slots=True)
class RecipeHeader:
    """What a recipe says besides its files and the seed."""

    mission: str
    scene: str
    robot: str
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    backend: Backend = "physics"
    verify: bool = False
    limit: float = LIMIT
    own_scene: bool = True
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """By name in the archive: SHA-256 in hex and path of the file that it was made from."""


_ADAPTER = TypeAdapter(RecipeHeader)


def write_recipe(recipe: Recipe, path: Path) -> None:
    """Without its seed. Raises PicktreeError when the file cannot be written."""
    files = list(recipe_files(recipe))
    card = RecipeHeader(
        recipe.mission.name,
        recipe.scene.name,
        recipe.robot.name,
        dict(recipe.parameters),
        recipe.backend,
        recipe.verify,
        recipe.limit,
        recipe.own_scene,
        fingerprints(recipe, files),
    )
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(CARD, _EPOCH), _ADAPTER.dump_json(card, indent=1))
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name, _EPOCH), file.data, zipfile.ZIP_DEFLATED)
    with whole([path], path) as (beside,):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(data.getvalue())


class RecipeFile:
    """A recipe that was written. Its files are unpacked into a folder that goes with this.

    Raises PicktreeError for a file that is none, or damaged; FileError where this version of picktree no
    longer takes a file in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
            self.run = _ADAPTER.validate_json(self._archive.read(CARD))
        except OSError as error:
            raise PicktreeError(f"{path}: the recipe cannot be read: {error.strerror}") from None
        except (zipfile.BadZipFile, KeyError, ValidationError):
            raise PicktreeError(f"{path}: no recipe of a batch, or a damaged one") from None
        self.attachments = tuple(name for name in self._archive.namelist() if name != CARD)
        self._folder = tempfile.TemporaryDirectory(prefix="picktree-")

    def close(self) -> None:
        self._archive.close()
        self._folder.cleanup()

    def __enter__(self) -> RecipeFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def attachment(self, name: str) -> bytes:
        """Raises PicktreeError when it is not there, or is not what was put there."""
        try:
            data = self._archive.read(name)
        except (KeyError, zipfile.BadZipFile, OSError):
            raise PicktreeError(f"{self.path}: {name!r} is missing in it, or damaged") from None
        if hashlib.sha256(data).hexdigest() != self.run.files.get(name, "").partition(" ")[0]:
            raise PicktreeError(f"{self.path}: {name!r} in it was changed since it was written")
        return data

    def recipe(self, seed: int) -> Recipe:
        """With that seed."""
        unpacking, card = Unpacking(self, Path(self._folder.name)), self.run
        made = Recipe(
            unpacking.mission(),
            unpacking.scene(),
            unpacking.robot(),
            seed,
            unpacking.faults(),
            dict(card.parameters),
            card.backend,
            card.verify,
            card.limit,
            card.own_scene,
        )
        return replace(made, paths={name: words.partition(" ")[2] for name, words in card.files.items()})
