"""Values of a mission file that is not written yet, with the places in the XML file that they come from."""

from __future__ import annotations

from dataclasses import dataclass, field

from ....files.marks import Mark
from ....files.yaml.reader import Node, Value

Scalar = str | int | float | bool | None


@dataclass(slots=True)
class Entry:
    """A key and its value."""

    key: str
    mark: Mark
    value: Marked


@dataclass(slots=True)
class Marked:
    """A scalar, or with `entries` a mapping, or with `items` a list; `comments` stand above it."""

    mark: Mark
    scalar: Scalar = None
    items: list[Marked] | None = None
    entries: list[Entry] | None = None
    comments: tuple[str, ...] = field(default=())

    @classmethod
    def mapping(cls, mark: Mark) -> Marked:
        return cls(mark, entries=[])

    def put(self, key: str, value: Marked | Scalar, mark: Mark | None = None) -> None:
        """Add to a mapping; a bare scalar gets the place of its key."""
        assert self.entries is not None
        at = mark or (value.mark if isinstance(value, Marked) else self.mark)
        given = value if isinstance(value, Marked) else Marked(at, value)
        self.entries.append(Entry(key, at, given))

    def get(self, key: str) -> Marked | None:
        return next((entry.value for entry in self.entries or () if entry.key == key), None)

    def node(self) -> Node:
        """As the reader of YAML would have it."""
        if self.items is not None:
            items = [item.node() for item in self.items]
            return Node([item.value for item in items], self.mark, items=items)
        if self.entries is not None:
            entries = {entry.key: entry.value.node() for entry in self.entries}
            value: Value = {key: node.value for key, node in entries.items()}
            return Node(value, self.mark, entries=entries, keys={e.key: e.mark for e in self.entries})
        return Node(_plain(self.scalar), self.mark)


def from_value(value: Value, mark: Mark) -> Marked:
    """A plain value, all of it at one place."""
    match value:
        case list():
            return Marked(mark, items=[from_value(item, mark) for item in value])
        case dict():
            return Marked(mark, entries=[Entry(str(k), mark, from_value(v, mark)) for k, v in value.items()])
        case _:
            return Marked(mark, value)


def _plain(value: Scalar) -> Value:
    return value
