"""Settings of two runs: differences of parameters, versions and files."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from ...logs.schema.arithmetic_record import arithmetic_difference
from ...logs.schema.records import RunInfo
from ...session.environment import SOURCES_ATTACHMENT, source_changes, sources_from_text
from ..run import Run

CONTEXT_LINES = 2
"""Number of unchanged lines around a change of a file."""
_RUN_FILE_PREFIXES = ("checkpoint-", "refused-")
"""Prefixes of attachments that a run makes itself."""


@dataclass(frozen=True, slots=True)
class ValueChange:
    """Value with a name in two runs; None where there is none."""

    name: str
    a: object
    b: object


@dataclass(frozen=True, slots=True)
class FileChange:
    """File that differs between the two logs.

    `diff` are the lines of a unified diff without its head; for picktree's sources, sentences. It is empty
    for a file that is no text, or that only one run has.
    """

    name: str
    how: Literal["changed", "only_a", "only_b"]
    diff: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SetupDiff:
    settings: tuple[ValueChange, ...]
    """Settings that differ: mission, scene, robot, seed, versions and others."""
    files: tuple[FileChange, ...]
    arithmetic: str = ""
    """Sentence when the runs were computed with different arithmetic, or it was not recorded; else empty."""


def compare_settings(a: Run, b: Run) -> SetupDiff:
    ours, theirs = _settings(a.info), _settings(b.info)
    settings = tuple(
        ValueChange(name, ours.get(name), theirs.get(name))
        for name in dict.fromkeys((*ours, *theirs))
        if ours.get(name) != theirs.get(name)
    )
    return SetupDiff(
        settings, tuple(_files(a, b)), arithmetic_difference(a.info.arithmetic, b.info.arithmetic, "in B")
    )


def value_changes(a: Mapping[str, object], b: Mapping[str, object]) -> tuple[ValueChange, ...]:
    """Return the values that differ, in the order of A."""
    return tuple(
        ValueChange(name, a.get(name), b.get(name))
        for name in dict.fromkeys((*a, *b))
        if a.get(name) != b.get(name)
    )


def _settings(info: RunInfo) -> dict[str, object]:
    """Return the settings by user-visible names; the version of picktree has no prefix."""
    named: dict[str, object] = {
        "mission": info.mission,
        "scene": info.scene,
        "robot": info.robot,
        "seed": info.seed,
        "backend": info.backend,
        "tick": info.tick,
        "revision": info.revision,
    }
    for prefix, values in (("set ", info.parameters), ("", info.physics), ("", info.versions)):
        named.update({f"{prefix}{name}": value for name, value in values.items()})
    return named


def _files(a: Run, b: Run) -> Iterator[FileChange]:
    in_a, in_b = _contents(a), _contents(b)
    for name in dict.fromkeys((*in_a, *in_b)):
        ours, theirs = in_a.get(name), in_b.get(name)
        if theirs is None:
            yield FileChange(name, "only_a", ())
        elif ours is None:
            yield FileChange(name, "only_b", ())
        elif name == SOURCES_ATTACHMENT:
            changes = source_changes(sources_from_text(ours.decode()), sources_from_text(theirs.decode()))
            if changes:
                yield FileChange(name, "changed", changes)
        elif ours != theirs:
            yield FileChange(name, "changed", _unified(ours, theirs))


def _contents(run: Run) -> dict[str, bytes]:
    names = [name for name in run.log.attachments if not name.startswith(_RUN_FILE_PREFIXES)]
    return {name: run.log.attachment(name) for name in names}


def _unified(a: bytes, b: bytes) -> tuple[str, ...]:
    try:
        ours, theirs = a.decode().splitlines(), b.decode().splitlines()
    except UnicodeDecodeError:
        return ()
    lines = difflib.unified_diff(ours, theirs, n=CONTEXT_LINES, lineterm="")
    return tuple(line for n, line in enumerate(lines) if n >= 2)
