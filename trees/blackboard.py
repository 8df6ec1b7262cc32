"""Blackboard of one tree: plain values by key, a namespace for each sub-tree instance, a log of writes.

Each tree has its own, so that two missions in a process share nothing; py_trees' blackboard is global.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from picktree.world import BlackboardWrite, Plain, PlanningScene

from .port_types import plain_copy
from .references import ROOT_KEY, Reference, resolve


class Blackboard:
    """All values of a tree by their full keys. Values are copied when written and when read."""

    def __init__(self) -> None:
        self._values: dict[str, Plain] = {}
        self._writes: list[BlackboardWrite] = []
        self._watchers: dict[str, list[Callable[[], None]]] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def read(self, key: str) -> Plain:
        """Return a copy of the value. Raises KeyError when nothing was written under the key."""
        return plain_copy(self._values[key])

    def write(self, key: str, value: object, node: str, *, update: bool = True) -> None:
        """Write a copy of the value. Raises TypeError or ValueError for a value that is not plain.

        `update`: whether the write counts for those who watch the key.
        """
        self._values[key] = plain_copy(value)
        self._writes.append(BlackboardWrite(key, plain_copy(value), node))
        for written in self._watchers.get(key, ()) if update else ():
            written()

    def watch(self, key: str, written: Callable[[], None]) -> None:
        """Call `written` after each write to the key that is an update. Restored values are no writes."""
        self._watchers.setdefault(key, []).append(written)

    @property
    def written(self) -> bool:
        """Whether there are writes that `take_writes` has not returned yet."""
        return bool(self._writes)

    def take_writes(self) -> tuple[BlackboardWrite, ...]:
        """Return the writes since the last call, in order."""
        writes = tuple(self._writes)
        self._writes.clear()
        return writes

    def save(self) -> dict[str, Plain]:
        return {key: plain_copy(value) for key, value in self._values.items()}

    def restore(self, values: Mapping[str, Plain]) -> None:
        self._values = {key: plain_copy(value) for key, value in values.items()}
        self._writes.clear()


class Namespace:
    """Keys of one sub-tree instance: its own, and those that are wired to keys of the caller."""

    def __init__(self, board: Blackboard, prefix: str) -> None:
        self._board = board
        self._prefix = prefix
        self._wired: dict[str, tuple[Namespace, Reference]] = {}

    def _alias(self, key: str) -> tuple[Namespace, Reference] | None:
        """Return namespace and reference of an alias key; None for a key of its own."""
        if key.startswith(ROOT_KEY):
            return Namespace(self._board, self._prefix.partition("/")[0]), Reference(key[1:])
        return self._wired.get(key)

    def wire(self, key: str, outer: Namespace, reference: Reference) -> None:
        """Make `key` an alias of the caller's `reference`."""
        self._wired[key] = (outer, reference)

    def full_key(self, key: str) -> str:
        """Return the key's full name on the blackboard."""
        wired = self._alias(key)
        return wired[0].full_key(wired[1].key) if wired else f"{self._prefix}/{key}"

    def has(self, key: str) -> bool:
        wired = self._alias(key)
        return wired[0].has(wired[1].key) if wired else f"{self._prefix}/{key}" in self._board

    def read(self, reference: Reference, scene: PlanningScene) -> Plain:
        """Read a reference. Raises KeyError for an unwritten key, Failure for an unknown object or
        attribute."""
        wired = self._alias(reference.key)
        if wired is None:
            value = self._board.read(f"{self._prefix}/{reference.key}")
        else:
            value = wired[0].read(wired[1], scene)
        return resolve(scene, reference, value)

    def write(self, key: str, value: object, node: str, *, update: bool = True) -> None:
        """Write a key; `update`: whether it counts for those who watch it.

        Raises TypeError or ValueError for a value that is not plain, or a key that is read-only here.
        """
        wired = self._alias(key)
        if wired is None:
            self._board.write(f"{self._prefix}/{key}", value, node, update=update)
        elif wired[1].attributes:
            raise ValueError(f"{key!r} stands for {wired[1]}, which cannot be written")
        else:
            wired[0].write(wired[1].key, value, node, update=update)

    def names(self) -> list[str]:
        """Return the keys that can be read now, sorted."""
        own = f"{self._prefix}/"
        local = [key[len(own) :] for key in self._board if key.startswith(own) and "/" not in key[len(own) :]]
        return sorted({*local, *(key for key in self._wired if self.has(key))})
