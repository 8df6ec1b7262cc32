"""The moments of a run that are worth a look, and what to look for."""

from __future__ import annotations

from collections.abc import Sequence

from .investigation.explanation import FailureStory, LookAt, Outcome, RootCause

MOST = 8
CLOSE = 0.6
"""Moments nearer than this are one, s."""

WATCH = {
    "item.gone": "the item vanishes from the truth, and the belief keeps it",
    "item.moved": "truth and belief of the item part",
    "item.pushed_by_arm": "the hand touches the item on its way",
    "item.left_bin": "the item leaves the bin",
    "item.slippery": "the wrist's load, the opening: the item slides out of the fingers",
    "item.heavy": "the wrist's force while the hand lifts",
    "item.out_of_reach": "how far the item lies from the arm's base",
    "item.crowded": "the neighbours around the item",
    "item.beside_bin": "the bin's wall beside the item",
    "item.never_seen": "the camera's picture, and where the item truly lies",
    "camera.off": "truth beside belief of any item: all are off the same way",
    "grasp.weak": "the fingers' force and the wrist's load while the hand lifts",
    "scene.blocked": "what stands between hand and item",
    "bin.full": "how much lies in the bin",
    "bin.crowded": "what lies in the bin below the hand",
    "planner.budget": "the way that had to be found",
    "tree.timeout": "what was still running",
    "run.limit": "what was still running",
    "run.killed": "the last that the log holds",
    "run.crashed": "the last that the log holds",
    "mission.wrong_bin": "into which bin the item goes",
    "place.beside": "where the item comes down",
}


def moments(
    causes: Sequence[RootCause], failures: Sequence[FailureStory], outcome: Outcome
) -> tuple[LookAt, ...]:
    """For each root cause when it happened and when it first showed; then what ended the run."""
    found: list[LookAt] = []

    def add(look: LookAt) -> None:
        if len(found) < MOST and all(abs(look.time - other.time) > CLOSE for other in found):
            found.append(look)

    for cause in causes:
        first = failures[cause.failures[0]] if cause.failures else None
        watch = WATCH.get(cause.cause, "")
        told = f"{cause.item}: {watch}" if watch and cause.item else watch
        if cause.time is not None and cause.time > 0.0:
            add(LookAt(cause.time, told or cause.title, first.number if first else None))
        if first is not None:
            name = first.node.rsplit("/", 1)[-1]
            about = f" of {first.item}" if first.item else ""
            add(LookAt(first.time, f"{name}{about} fails: {first.cause}", first.number))
    for failure in failures:
        if failure.fate == "ended":
            add(LookAt(failure.time, f"the failure that ended the mission: {failure.cause}", failure.number))
    if outcome.status != "success" and causes:
        add(LookAt(outcome.end, "the end: truth beside belief of everything"))
    return tuple(found)
