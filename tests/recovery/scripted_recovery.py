"""Missions of scripted leaves and nodes that recover, in a world without hardware."""

from __future__ import annotations

from textwrap import indent
from typing import cast

from picktree.files import Diagnostic
from picktree.files.yaml import read_document
from picktree.recovery import NODES as RECOVERY
from picktree.robot import World
from picktree.trees import Node, build
from picktree.trees.loading import NodeRegistry, examine, parse_mission

from ..trees.scripted import FILE, NODES, FakeWorld, Run


def start(body: str, world: FakeWorld | None = None, *nodes: type[Node]) -> Run:
    """A mission whose tree is the given text, still to be ticked."""
    world = world or FakeWorld()
    registry = NodeRegistry((*NODES, *RECOVERY, *nodes), installed=False)
    return Run(build(parse_mission(_text(body), FILE, registry), cast("World", world), {}), world)


def faults(body: str) -> tuple[Diagnostic, ...]:
    """What is wrong with such a mission before it runs."""
    registry = NodeRegistry((*NODES, *RECOVERY), installed=False)
    return examine(read_document(FILE, "mission", _text(body)), registry).faults


def _text(body: str) -> str:
    return "picktree: 1\nkind: mission\ntrees:\n  Main:\n" + indent(body, "    ")
