"""Nodes that react to writes to a key: SkipUnlessUpdated, WaitValueUpdate, WasEntryUpdated."""

from __future__ import annotations

from typing import cast

from ..flow import IDLE, RUNNING, SKIPPED, ChildFlow, LeafFlow
from ..node import Node
from ..ports import In, port
from ..references import Reference
from ..runtime import Runtime, Wiring
from ..status import NodeStatus
from .decorator import Decorator


class EntryNode(Node, abstract=True):
    """Node that asks whether a key was written since it asked before. A write of an equal value counts."""

    remembers = ("_updated",)
    _updated: bool | None = None
    """Whether the key was written since the last question; None: it was never asked."""

    def bind(self, wiring: Wiring, runtime: Runtime) -> None:
        super().bind(wiring, runtime)
        entry = wiring.ports.get("entry")
        if isinstance(entry, Reference):
            runtime.blackboard.watch(wiring.namespace.full_key(entry.key), self._note_write)

    def was_updated(self) -> bool:
        """Whether the key was written since the last call; at first, whether it was written at all."""
        updated, self._updated = self._updated, False
        entry = self.wiring.ports["entry"]
        written = isinstance(entry, Reference) and self.wiring.namespace.has(entry.key)
        return written if updated is None else updated

    def _note_write(self) -> None:
        self._updated = True


class EntryDecorator(EntryNode, Decorator, abstract=True):
    """Decorator that starts its child when the key was written; else its own end in `flow` is its status."""

    def on_tick(self) -> NodeStatus:
        if self.body.state is NodeStatus.RUNNING or self.was_updated():
            return self.relay()
        return cast("ChildFlow", self.flow).own[IDLE]


class SkipUnlessUpdated(EntryDecorator):
    """Ticks its child when the key was written since the last time; otherwise it is SKIPPED.

    A child that runs is ticked until it ends. A write of an equal value counts, too.
    """

    flow = ChildFlow(own={IDLE: SKIPPED})
    example = """
    SkipUnlessUpdated:
      entry: "{items}"
      do: {Log: {message: there are new items, value: "{items}"}}
    """

    entry: In[object] = port("the key whose writes count", takes="key")


class WaitValueUpdate(EntryDecorator):
    """Ticks its child when the key was written since the last time; until then it is RUNNING.

    A child that runs is ticked until it ends. A write of an equal value counts, too.
    """

    flow = ChildFlow(own={IDLE: RUNNING})
    example = """
    WaitValueUpdate:
      entry: "{items}"
      do: {Log: {message: there are new items, value: "{items}"}}
    """

    entry: In[object] = port("the key whose writes count", takes="key")


class WasEntryUpdated(EntryNode):
    """Whether the key was written since the node was ticked last. A write of an equal value counts, too."""

    flow = LeafFlow(instant=True)
    kind = "condition"
    example = """
    Fallback:
      - WasEntryUpdated: {entry: "{items}"}
      - Observe: {camera: overhead, objects: "{items}"}
    """

    entry: In[object] = port("the key whose writes count", takes="key")

    def on_tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS if self.was_updated() else NodeStatus.FAILURE
