"""Logs of runs that never happened, written tick by tick: which node begins and ends, what is believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from picktree.logs import RunResult
from picktree.logs.log_records import RunInfo
from picktree.logs.recording import Recorder
from picktree.world import (
    BeliefObject,
    BlackboardWrite,
    Box,
    Candidates,
    JournalEvent,
    NodeState,
    ObjectId,
    Plan,
    PlanningScene,
    Pose,
    Tick,
    Transition,
    Tree,
    TreeNode,
)

TICK = 0.05
Said: TypeAlias = Transition | BlackboardWrite | JournalEvent | Plan | Candidates
"""What may be told of a tick."""


@dataclass(frozen=True)
class Seen:
    """An object that is seen for the first time in tick `tick`."""

    id: str
    x: float
    tick: int = 0
    colour: str = "red"


def begins(path: str, subject: str = "", **inputs: object) -> Transition:
    return Transition(path, "RUNNING", {**({"object": subject} if subject else {}), **inputs}, subject)


def ends(
    path: str, status: str = "SUCCESS", cause: str = "", origin: str = "", **evidence: object
) -> Transition:
    """`origin`: the node that the failure comes from; by default this one."""
    message = f"{path} failed" if cause else ""
    came = (origin or path) if cause else ""
    return Transition(path, status, cause=cause, origin=came, message=message, evidence=evidence)


def tree(*nodes: str, **ports: str) -> Tree:
    """Nodes as `Main/Sequence:Sequence`, path and type; without a type it is the last part of the path. The
    ports are those of the last node."""
    typed = [node.partition(":") for node in nodes]
    paths = [path for path, _, _ in typed]
    return Tree(
        tuple(
            TreeNode(
                path,
                kind or path.rsplit("/", 1)[-1],
                path.rsplit("/", 1)[-1],
                path.rpartition("/")[0],
                tuple(p for p in paths if p.rpartition("/")[0] == path),
                ports if path == paths[-1] else {},
            )
            for path, _, kind in typed
        )
    )


def record(
    path: Path,
    nodes: Tree,
    ticks: int,
    script: Mapping[int, Sequence[Said]],
    *,
    seen: Sequence[Seen] = (),
    seed: int = 0,
    first: int = 0,
    running: Sequence[str] = (),
    files: Mapping[str, str] | None = None,
    result: RunResult | None = None,
) -> Path:
    """Write a log of `ticks` ticks from number `first` on. `running` are nodes that run when it begins."""
    info = RunInfo("made up", "nowhere", "none", seed, "kinematic", TICK)
    scene = PlanningScene([], [])
    state = {node.path: "RUNNING" if node.path in running else "IDLE" for node in nodes.nodes}
    with Recorder(path, info) as recorder:
        for name, text in (files or {}).items():
            recorder.attach(name, text)
        recorder.tree(nodes)
        for k in range(first, ticks):
            for one in seen:
                if max(one.tick, first) == k:
                    scene.put(_object(one), "seen for the first time")
            said = script.get(k, ())
            moves = tuple(one for one in said if isinstance(one, Transition))
            state.update({move.path: move.status for move in moves})
            for one in said:
                if isinstance(one, Plan | Candidates):
                    recorder.entry(k * TICK, one)
                if isinstance(one, JournalEvent):
                    recorder.entry(k * TICK, one)
                    if one.kind == "item_done":
                        placed = next(o for o in scene.objects if o.id == one.data["object"])
                        scene.put(replace(placed, place=str(one.data["into"])), "placed")
            recorder.belief(k * TICK, scene.objects, scene.take_changes())
            recorder.tick(
                k * TICK,
                Tick(
                    state[nodes.nodes[0].path],
                    next((p for p in reversed(state) if state[p] == "RUNNING"), ""),
                    tuple(NodeState(n.path, n.id, state[n.path], True) for n in nodes.nodes),
                    tuple(one for one in said if isinstance(one, BlackboardWrite)),
                    moves,
                ),
            )
        if result is not None:
            recorder.finish({"status": result.status, "json": result.to_json_text()})
    return path


def _object(one: Seen) -> BeliefObject:
    return BeliefObject(
        id=ObjectId(one.id),
        role="item",
        kind="block",
        form="box",
        shape=Box((0.04, 0.04, 0.04)),
        colour=one.colour,
        pose=Pose((one.x, 0.0, 0.02)),
        sigma_position=0.001,
        sigma_angle=0.01,
        confidence=0.9,
        last_seen=0.0,
    )
