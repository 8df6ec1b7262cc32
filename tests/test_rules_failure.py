"""Fifth rule: every failure is typed, with a sentence and evidence, and all of it is in the log."""

from __future__ import annotations

import json
from functools import cache

import pytest

from picktree.logs import RunLog, RunResult
from picktree.session import RunRequest, Session
from picktree.simulation import Backend
from picktree.trees.loading import NodeRegistry
from picktree.world import JournalEvent, NodeState, all_causes, cause_named, matches
from picktree.world.event_types import InternalErrorEvent, RecoveryEvent

from .skills.cell import EXAMPLES

FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 1, delay: 500 ms}, target: {nearest_to: object}}
  - {fault: friction, when: {node: Grasp, start: 4}, target: {nearest_to: object}, friction: 0.02, mass: 0.5}
  - fault: bump
    when: {node: Grasp, start: 8, delay: 300 ms}
    target: {nearest_to: object}
    velocity: [0.3, 0.2, 0]
  - {fault: remove, when: {node: Place, start: 1, delay: 400 ms}, target: {nearest_to: tool}}
"""
ALWAYS_POSSIBLE = ("tree.missing_input", "world.unknown_object", "internal.error")
"""What any node may fail with, without declaring it."""


class Told:
    """A run that much happened to, as its log tells it."""

    def __init__(self, result: RunResult) -> None:
        self.result = result
        with RunLog(result.log) as log:
            self.events: list[JournalEvent] = [at.record for at in log.events()]
            self.failures: list[NodeState] = [
                node
                for at in log.ticks()
                for node in at.record.nodes
                if node.status == "FAILURE" and node.ticked
            ]
            self.errors = [at.record for at in log.lines() if at.record.level == "ERROR"]
            self.leaves = {node.path for node in log.tree().nodes if not node.children}


@pytest.fixture(scope="module", params=["kinematic", "physics"])
def told(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Told:
    folder = tmp_path_factory.mktemp("faults")
    faults = folder / "faults.yaml"
    faults.write_text(FAULTS)
    backend: Backend = request.param
    return Told(
        Session(
            RunRequest(
                EXAMPLES / "sort_by_colour.yaml",
                scene="sort_small",
                seed=3,
                parameters={"rounds": "2"},
                faults=faults,
                out=folder,
                backend=backend,
            )
        ).run()
    )


@cache
def declared(identity: str) -> tuple[str, ...]:
    node = NodeRegistry().find(identity)
    assert node is not None
    return (*(str(cause) for cause in node.causes), *ALWAYS_POSSIBLE)


def test_the_faults_happened_and_the_mission_went_on(told: Told) -> None:
    assert sum(event.kind == "fault" for event in told.events) >= 3
    assert len(told.result.failures) >= 2
    assert told.result.status == "incomplete"
    assert told.result.message == ""


def test_every_failure_has_a_known_cause_and_a_sentence(told: Told) -> None:
    """There is no condition in this mission, so there is no failure without a cause."""
    known = {cause.name for cause in all_causes()}
    assert {node.cause for node in told.failures} <= known
    assert [node for node in told.failures if len(node.message) < 10] == []


def test_every_leaf_fails_with_what_it_has_declared(told: Told) -> None:
    leaves = [node for node in told.failures if node.path in told.leaves]
    undeclared = [
        f"{node.path}: {node.cause}: {node.message}"
        for node in leaves
        if not any(matches(pattern, cause_named(node.cause)) for pattern in declared(node.id))
    ]
    assert leaves
    assert undeclared == []
    assert "undeclared_cause" not in {event.kind for event in told.events}


def test_there_is_no_fault_of_the_program(told: Told) -> None:
    internal = [event for event in told.events if isinstance(event, InternalErrorEvent)]
    assert [(event.message, event.traceback) for event in internal] == []
    assert [node for node in told.failures if node.cause.startswith("internal.")] == []


def test_every_leafs_failure_is_counted_and_logged_as_an_error(told: Told) -> None:
    leaves = [node for node in told.failures if node.path in told.leaves]
    counted = sum(told.result.failures.values())
    assert counted == len(leaves)
    lines = [(line.name, line.message) for line in told.errors]
    assert [n for n in leaves if (n.path, f"{n.cause}: {n.message}") not in lines] == []


def test_evidence_survives_json(told: Told) -> None:
    leaves = [node for node in told.failures if node.path in told.leaves]
    assert all(json.loads(json.dumps(node.evidence)) == node.evidence for node in leaves)
    assert any(node.evidence for node in leaves)


def test_recovery_answers_the_cause_of_the_leaf_that_failed(told: Told) -> None:
    failed = {(node.path, node.cause) for node in told.failures}
    recoveries = [event for event in told.events if isinstance(event, RecoveryEvent)]
    assert recoveries
    assert {(e.failed, e.cause) for e in recoveries} <= failed
    assert sum(told.result.recoveries.values()) == len(recoveries)
