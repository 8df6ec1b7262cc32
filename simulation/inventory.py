"""Inventory of a run: the present items, and the origin of those that left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias, cast

from pydantic import BeforeValidator

from picktree.world import ConvexMesh, ObjectId, Pose, Shape, scaled
from picktree.world.scene import CatalogueEntry, SceneDescription

from .heap_spawning import Stickers, mesh_files, read_thing
from .spawn import SpawnedItem, item_id, item_number
from .truth import TrueBody


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemOrigin:
    """Kind, colour and origin of an item, in a checkpoint."""

    kind: str
    colour: str
    brought_by: int | None
    """Index of the feed entry that brought the item; None: the scene spawned it."""
    mesh: int | None = None
    """Number of its file in the assortment; None: it is of the catalogue."""
    tag: int | None = None
    """Number of the tag on it; None: it has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BroughtItem(ItemOrigin):
    """An item that the scene did not spawn."""

    id: ObjectId


@dataclass(frozen=True, slots=True, kw_only=True)
class DepartedItem(ItemOrigin):
    """Items that left with a bin. Equal ones have one record: there are thousands."""

    taken_with: ObjectId


@dataclass(frozen=True, slots=True)
class InventoryState:
    """Items that came after the start, and items that left."""

    brought: tuple[BroughtItem, ...]
    """Items that came later, in the order of their numbers."""
    departed: tuple[tuple[int, int], ...]
    """Number of each item that left and index of it in `kinds`, in the order in which they left."""
    kinds: tuple[DepartedItem, ...] = ()
    """Different items that left."""

    def since(self, departed: int) -> InventoryState:
        """Return the state without the first so many items that left."""
        return replace(self, departed=self.departed[departed:]) if departed else self


def _of_older_log(plain: Any) -> Any:
    """Return the plain values of a state; in older logs each item that left is a mapping of its own."""
    if not isinstance(plain, Mapping) or "kinds" in plain:
        return cast("Any", plain)
    state = cast("Mapping[str, Any]", plain)
    left = cast("list[Mapping[str, Any]]", state["departed"])
    kinds = [{field.name: each.get(field.name) for field in fields(DepartedItem)} for each in left]
    departed = [(item_number(each["id"]), index) for index, each in enumerate(left)]
    return {**state, "departed": departed, "kinds": kinds}


SavedInventory: TypeAlias = Annotated[InventoryState | None, BeforeValidator(_of_older_log)]
"""State in a checkpoint; None when nothing came and nothing left."""


class Inventory:
    """Inventory of a run.

    `here` contains all items that did not leave with a bin, in the order of their numbers. For each item that
    left, number and origin are kept.
    """

    def __init__(self, scene: SceneDescription, spawned: Iterable[SpawnedItem]) -> None:
        self._scene = scene
        self._spawned = {item.id: item for item in spawned}
        self.here: dict[ObjectId, SpawnedItem] = dict(self._spawned)
        self._departed: list[tuple[int, int]] = []
        self._kinds: dict[DepartedItem, int] = {}
        """Index of each different item that left."""
        self._latest: dict[ObjectId, tuple[TrueBody, ...]] = {}
        """Last truth of the items that left with the latest exchange of each bin."""
        self.count = len(self.here)
        """Number of items that ever came."""

    @property
    def spawned(self) -> Iterable[ObjectId]:
        """Names of the items at the start."""
        return self._spawned

    def next_id(self) -> ObjectId:
        """Return the name of the next item; no number is given twice."""
        return item_id(self.count)

    def add(self, item: SpawnedItem) -> None:
        """Add an item that was brought under the `next_id`."""
        self.here[item.id] = item
        self.count += 1

    def enlarge(self, name: ObjectId, factor: float) -> SpawnedItem:
        """Scale an item by `factor` from now on; checkpoints record the factor elsewhere."""
        item = self.here[name]
        entry = replace(item.entry, shape=scaled(item.entry.shape, factor))
        self.here[name] = replace(item, entry=entry)
        return self.here[name]

    def depart(self, bodies: Iterable[TrueBody], bin_id: ObjectId) -> None:
        """Move items, of which `bodies` is the last truth, to the departed ones: they leave with a bin."""
        left = [_departed(body, bin_id, body.brought_by) for body in bodies]
        for body in left:
            del self.here[body.id]
            kind = DepartedItem(
                kind=body.kind,
                colour=body.colour,
                brought_by=body.brought_by,
                mesh=self._file(body.shape),
                tag=body.tag,
                taken_with=bin_id,
            )
            self._departed.append((item_number(body.id), self._kinds.setdefault(kind, len(self._kinds))))
        self._latest[bin_id] = tuple(left)

    def has_left(self, item: str) -> bool:
        return any(item_id(number) == item for number, _ in self._departed)

    def recent_truth(self, true: Callable[[ObjectId], TrueBody]) -> tuple[TrueBody, ...]:
        """Return the ground truth of the items that did not leave, and of those that left with the latest
        exchange of each bin.

        `true` is called for the former. All are in the order of the numbers.
        """
        left = (body for bodies in self._latest.values() for body in bodies)
        return tuple(sorted((*left, *map(true, self.here)), key=lambda body: item_number(body.id)))

    def truth(self, true: Callable[[ObjectId], TrueBody]) -> tuple[TrueBody, ...]:
        """Return the ground truth of every item that ever came, in the order of the numbers.

        `true` is called for those that did not leave. Of the others no pose is kept.
        """
        kinds = [(kind, self._kind(kind)[0]) for kind in self._kinds]
        bodies = {item_number(name): true(name) for name in self.here}
        for number, index in self._departed:
            kind, entry = kinds[index]
            body = replace(TrueBody.of(item_id(number), entry, kind.colour, Pose()), tag=kind.tag)
            bodies[number] = _departed(body, kind.taken_with, kind.brought_by)
        return tuple(bodies[number] for number in range(self.count))

    def state(self) -> InventoryState | None:
        """Return the state for a checkpoint; None when nothing came and nothing left."""
        brought = tuple(
            BroughtItem(
                kind=item.entry.kind,
                colour=item.colour,
                brought_by=item.brought_by,
                mesh=self._file(item.entry.shape),
                tag=item.tag,
                id=item.id,
            )
            for item in self.here.values()
            if item.brought_by is not None
        )
        if not brought and not self._departed:
            return None
        return InventoryState(brought, tuple(self._departed), tuple(self._kinds))

    def restore(self, state: InventoryState | None) -> None:
        state = state or InventoryState((), ())
        left = {item_id(number) for number, _ in state.departed}
        self.here = {name: item for name, item in self._spawned.items() if name not in left}
        for each in state.brought:
            entry, stickers = self._kind(each)
            # The pose is in the backend's own part of the checkpoint.
            self.here[each.id] = SpawnedItem(
                each.id, entry, each.colour, Pose(), False, each.brought_by, stickers,
                tag=each.tag, rolls=stickers is not None,
            )  # fmt: skip
        self._kinds = {}
        indices = [self._kinds.setdefault(kind, len(self._kinds)) for kind in state.kinds]
        self._departed = [(number, indices[index]) for number, index in state.departed]
        self._latest = {}
        self.count = len(self.here) + len(left)

    def _file(self, shape: Shape) -> int | None:
        """Return the number of a thing's file in the assortment; None: the shape is of the catalogue."""
        assortment = self._scene.assortment
        if assortment is None or not isinstance(shape, ConvexMesh):
            return None
        files = mesh_files(assortment.meshes)
        return files.index(Path(shape.source)) if Path(shape.source) in files else None

    def _kind(self, item: ItemOrigin) -> tuple[CatalogueEntry, Stickers | None]:
        """Return the entry of the catalogue, or the thing of the assortment with its stickers."""
        assortment = self._scene.assortment
        if item.mesh is None or assortment is None:
            return self._scene.entry(item.kind), None
        thing = read_thing(mesh_files(assortment.meshes)[item.mesh], assortment)
        return thing.entry, thing.stickers


def _departed(body: TrueBody, taken_with: ObjectId, brought_by: int | None) -> TrueBody:
    """Return the truth of an item that leaves with a bin."""
    still = TrueBody(body.kind, body.form, body.shape, body.colour, body.pose, id=body.id, present=False)
    return replace(still, taken_with=taken_with, brought_by=brought_by, mass=body.mass, tag=body.tag)
