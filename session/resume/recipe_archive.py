"""Recipe archive: a ZIP file of a recipe's files, from which it can be run on any machine at any time."""

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
from ..recipe import DEFAULT_TIME_LIMIT, Recipe, fingerprints, recipe_files
from .unpacking import Unpacking

HEADER_NAME = "recipe.json"
_FILE_TIME = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all files in an archive, so that equal recipes give equal archives."""


@dataclass(frozen=True, slots=True)
class RecipeHeader:
    """Settings of a recipe besides its files and the seed."""

    mission: str
    scene: str
    robot: str
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    backend: Backend = "physics"
    verify: bool = False
    limit: float = DEFAULT_TIME_LIMIT
    own_scene: bool = True
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """SHA-256 in hex and path of the original file, by name in the archive."""


_HEADER_ADAPTER = TypeAdapter(RecipeHeader)


def write_recipe(recipe: Recipe, path: Path) -> None:
    """Write a recipe without its seed. Raises PicktreeError when the file cannot be written."""
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
        archive.writestr(zipfile.ZipInfo(HEADER_NAME, _FILE_TIME), _HEADER_ADAPTER.dump_json(card, indent=1))
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name, _FILE_TIME), file.data, zipfile.ZIP_DEFLATED)
    with whole([path], path) as (beside,):
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(data.getvalue())


class RecipeFile:
    """Recipe archive that is open for reading. Its files are unpacked into a folder that exists until
    `close`.

    Raises PicktreeError for a file that is no archive of a recipe, or damaged. Raises FileError where this
    version of picktree no longer accepts a file in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
            self.run = _HEADER_ADAPTER.validate_json(self._archive.read(HEADER_NAME))
        except OSError as error:
            raise PicktreeError(f"{path}: the recipe cannot be read: {error.strerror}") from None
        except (zipfile.BadZipFile, KeyError, ValidationError):
            raise PicktreeError(f"{path}: no recipe of a batch, or a damaged one") from None
        self.attachments = tuple(name for name in self._archive.namelist() if name != HEADER_NAME)
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
        """Return a file's content. Raises PicktreeError when it is missing or was changed since it was
        written."""
        try:
            data = self._archive.read(name)
        except (KeyError, zipfile.BadZipFile, OSError):
            raise PicktreeError(f"{self.path}: {name!r} is missing in it, or damaged") from None
        if hashlib.sha256(data).hexdigest() != self.run.files.get(name, "").partition(" ")[0]:
            raise PicktreeError(f"{self.path}: {name!r} in it was changed since it was written")
        return data

    def recipe(self, seed: int) -> Recipe:
        """Return the recipe with that seed."""
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
