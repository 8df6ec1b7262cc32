"""A node that is read from XML, before it is written as a mission writes it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from ....files.marks import Mark
from ....trees.declaration import POSTCONDITIONS, PRECONDITIONS
from ..format.marked_values import Marked, Scalar

CONDITIONS = (*PRECONDITIONS, *POSTCONDITIONS)


@dataclass(slots=True)
class Draft:
    """`keys` are those that the node's class knows: a child of such an ID must stand under `do:`."""

    id: str
    mark: Mark
    body: Marked
    keys: Collection[str] = ()
    comments: tuple[str, ...] = field(default=())

    @classmethod
    def of(cls, identity: str, mark: Mark, keys: Collection[str] = ()) -> Draft:
        return cls(identity, mark, Marked.mapping(mark), keys)

    def put(self, key: str, value: Marked | Scalar, mark: Mark | None = None) -> None:
        self.body.put(key, value, mark)

    def guarded(self, key: str, condition: str, mark: Mark) -> Draft:
        """The node with one more condition, asked before its own."""
        if any(self.body.get(known) for known in CONDITIONS):
            outer = Draft.of("Sequence", self.mark)
            outer.put(key, condition, mark)
            outer.put("do", Marked(self.mark, items=[self.written()]))
            return outer
        entries = self.body.entries or []
        self.body.entries = [entry for entry in entries if entry.key == "name"]
        self.put(key, condition, mark)
        self.body.entries += [entry for entry in entries if entry.key != "name"]
        return self

    def written(self) -> Marked:
        """In the shortest of the ways in which a mission may write it."""
        entries = self.body.entries or []
        if not entries:
            return Marked(self.mark, self.id, comments=self.comments)
        body = self.body
        if len(entries) == 1 and entries[0].key == "do":
            child = entries[0].value
            named = child.entries[0].key if child.entries is not None and len(child.entries) == 1 else ""
            if named not in (*self.keys, "do"):
                body = child
        whole = Marked.mapping(self.mark)
        whole.comments = self.comments
        whole.put(self.id, body, self.mark)
        return whole
