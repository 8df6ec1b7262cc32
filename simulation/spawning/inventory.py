"""Inventory of a run: the present items, and a short record of each that left."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from ...world.scene.description import CatalogueEntry, SceneDescription
from ...world.shapes import ConvexMesh, Shape, scaled
from ...world.values import ObjectId, Pose
from ..scoring.truth import TrueBody
from .heap_spawning import PartsMesh, mesh_files, read_thing
from .spawn import SpawnedItem, item_id


@dataclass(frozen=True, slots=True)
class BroughtItem:
    """Record in a checkpoint of an item that the scene did not spawn."""

    id: ObjectId
    kind: str
    colour: str
    brought_by: int
    """Index of the feed entry that brought the item."""
    mesh: int | None = None
    """Number of its file in the assortment; None: it is of the catalogue."""
    tag: int | None = None
    """Number of the tag on it; None: it has none."""


@dataclass(frozen=True, slots=True)
class DepartedItem:
    """Record of an item that left with its bin."""

    id: ObjectId
    kind: str
    colour: str
    brought_by: int | None
    pose: Pose
    """Last pose of the item in the world."""
    taken_with: ObjectId
    mesh: int | None = None
    """Number of its file in the assortment; None: it is of the catalogue."""
    tag: int | None = None
    """Number of the tag on it; None: it has none."""


@dataclass(frozen=True, slots=True)
class InventoryState:
    """Items that came after the start, and items that left."""

    brought: tuple[BroughtItem, ...]
    """Items that came later, in the order of their numbers."""
    departed: tuple[DepartedItem, ...]
    """Items that left, in the order in which they left."""

    def since(self, departed: int) -> InventoryState:
        """Return the state without the first so many items that left."""
        return InventoryState(self.brought, self.departed[departed:]) if departed else self


class Inventory:
    """Inventory of a run.

    `here` contains all items that did not leave with a bin, in the order of their numbers. Of each item that
    left only one record is kept.
    """

    def __init__(self, scene: SceneDescription, spawned: Iterable[SpawnedItem]) -> None:
        self._scene = scene
        self._spawned = {item.id: item for item in spawned}
        self.here: dict[ObjectId, SpawnedItem] = dict(self._spawned)
        self._departed: dict[ObjectId, TrueBody] = {}
        self._records: list[DepartedItem] = []
        """Records of the departed; made once each, for states are asked for several times a second."""
        self._known = list(self.here)

    @property
    def spawned(self) -> Iterable[ObjectId]:
        """Names of the items at the start."""
        return self._spawned

    def next_id(self) -> ObjectId:
        """Return the name of the next item; no number is given twice."""
        return item_id(len(self._known))

    def add(self, item: SpawnedItem) -> None:
        """Add an item that was brought under the `next_id`."""
        self.here[item.id] = item
        self._known.append(item.id)

    def enlarge(self, name: ObjectId, factor: float) -> SpawnedItem:
        """Scale an item by `factor` from now on; checkpoints record the factor elsewhere."""
        item = self.here[name]
        entry = replace(item.entry, shape=scaled(item.entry.shape, factor))
        self.here[name] = replace(item, entry=entry)
        return self.here[name]

    def depart(self, body: TrueBody) -> None:
        """Move an item to the departed ones, with its last truth `body`."""
        del self.here[body.id]
        self._departed[body.id] = body
        if body.taken_with is not None:
            self._records.append(
                DepartedItem(
                    body.id,
                    body.kind,
                    body.colour,
                    body.brought_by,
                    body.pose,
                    body.taken_with,
                    self._file(body.shape),
                    body.tag,
                )
            )

    def has_left(self, item: str) -> bool:
        return item in self._departed

    def truth(self, true: Callable[[ObjectId], TrueBody]) -> tuple[TrueBody, ...]:
        """Return the ground truth of every item in the order of the numbers; `true` is called for those that
        did not leave."""
        departed = self._departed
        return tuple(departed[name] if name in departed else true(name) for name in self._known)

    def state(self) -> InventoryState | None:
        """Return the state for a checkpoint; None when nothing came and nothing left."""
        brought = tuple(
            BroughtItem(
                item.id, item.entry.kind, item.colour, item.brought_by, self._file(item.entry.shape), item.tag
            )
            for item in self.here.values()
            if item.brought_by is not None
        )
        return InventoryState(brought, tuple(self._records)) if brought or self._records else None

    def restore(self, state: InventoryState | None) -> None:
        state = state or InventoryState((), ())
        left = {item.id for item in state.departed}
        self.here = {name: item for name, item in self._spawned.items() if name not in left}
        for each in state.brought:
            entry, mesh = self._kind(each)
            # The pose is in the backend's own part of the checkpoint.
            self.here[each.id] = SpawnedItem(
                each.id, entry, each.colour, Pose(), False, each.brought_by, mesh,
                tag=each.tag, rolls=mesh is not None,
            )  # fmt: skip
        self._departed = {item.id: self._body(item) for item in state.departed}
        self._records = list(state.departed)
        self._known = [item_id(n) for n in range(len(self.here) + len(left))]

    def _body(self, item: DepartedItem) -> TrueBody:
        body = TrueBody.of(item.id, self._kind(item)[0], item.colour, item.pose)
        return departed(replace(body, tag=item.tag), item.taken_with, item.brought_by)

    def _file(self, shape: Shape) -> int | None:
        """Return the number of a thing's file in the assortment; None: the shape is of the catalogue."""
        assortment = self._scene.assortment
        if assortment is None or not isinstance(shape, ConvexMesh):
            return None
        files = mesh_files(assortment.meshes)
        return files.index(Path(shape.source)) if Path(shape.source) in files else None

    def _kind(self, item: BroughtItem | DepartedItem) -> tuple[CatalogueEntry, PartsMesh | None]:
        """Return the entry of the catalogue, or the thing of the assortment with its mesh."""
        assortment = self._scene.assortment
        if item.mesh is None or assortment is None:
            return self._scene.entry(item.kind), None
        thing = read_thing(mesh_files(assortment.meshes)[item.mesh], assortment)
        return thing.entry, thing.mesh


def departed(body: TrueBody, taken_with: ObjectId, brought_by: int | None) -> TrueBody:
    """Return the truth of an item that leaves with a bin."""
    return TrueBody(
        body.id,
        body.kind,
        body.form,
        body.shape,
        body.colour,
        body.pose,
        present=False,
        taken_with=taken_with,
        brought_by=brought_by,
        mass=body.mass,
        tag=body.tag,
    )
