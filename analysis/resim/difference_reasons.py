"""Reasons why a run may differ from its record: files, sources, libraries and machine that have changed."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...errors import PicktreeError
from ...logs.schema.arithmetic_record import Arithmetic, arithmetic_difference
from ...session import environment
from ...session.recipe import ROBOT_MESHES
from ...world.scene.loading.scene_loading import load_scene
from ..run import Run


@dataclass(frozen=True, slots=True)
class Reason:
    """One changed thing, with its values; empty where there is no value."""

    what: str
    recorded: str
    now: str

    def __str__(self) -> str:
        if not (self.recorded or self.now):
            return self.what
        return f"{self.what}: {self.recorded or 'none'} then, {self.now or 'none'} now"


def reasons(run: Run, now: Arithmetic) -> tuple[Reason, ...]:
    """Return the differences, the likeliest first; empty when everything is as in the log.

    `now` is the arithmetic of the process that has run it again.
    """
    recorded = run.info.arithmetic
    departed = arithmetic_difference(recorded, now)
    return (
        *_changed_attachments(run),
        *_sources(run),
        *([Reason(departed, "", "")] if departed else []),
        *_differing_values(run.info.versions, environment.versions(run.info.versions)),
        *_modules(run),
        *_meshes(run),
        *(() if recorded else _differing_values(run.info.machine, environment.machine())),
    )


def notes(run: Run) -> tuple[str, ...]:
    """Return sentences about files that were edited on the disk. The run is made from those of the log."""
    found: list[str] = []
    for name, (digest, path) in _files(run).items():
        now = _present_hash(name, Path(path)) if path and name in run.log.attachments else None
        if now is not None and now != digest:
            found.append(f"{path} was edited since; what the log holds was run")
    return tuple(found)


def moved_sources(run: Run) -> tuple[str, ...]:
    """Return a sentence when picktree's files have other places than in the version that recorded the run."""
    try:
        before = environment.sources_from_text(run.log.attachment(environment.SOURCES_ATTACHMENT).decode())
    except PicktreeError:
        return ()
    moved = environment.moved_sources(before, environment.sources())
    return (moved,) if moved else ()


def _present_hash(name: str, path: Path) -> str | None:
    """Return the hash of today's file; None when there is no such file."""
    if name != "scene.yaml":
        return _hash(path)
    try:  # with the content of its base files
        return hashlib.sha256(load_scene(str(path)).text.encode()).hexdigest()
    except PicktreeError:
        return _hash(path)


def _changed_attachments(run: Run) -> Iterator[Reason]:
    """Yield files that have changed within the log."""
    for name, (digest, _) in _files(run).items():
        if name in run.log.attachments:
            held = hashlib.sha256(run.log.attachment(name)).hexdigest()
            if held != digest:
                yield Reason(f"{name} in the log is not what was run", "", "")


def _sources(run: Run) -> Iterator[Reason]:
    """Yield differences of picktree's sources, or of its revision when the log has no sources."""
    now = environment.sources()
    try:
        before = environment.sources_from_text(run.log.attachment(environment.SOURCES_ATTACHMENT).decode())
    except PicktreeError:
        if run.info.revision != environment.revision():
            yield Reason("revision of picktree", run.info.revision, environment.revision())
        return
    changes = environment.source_changes(before, now)
    yield from (Reason(change, "", "") for change in changes)
    if changes and run.info.revision != environment.revision():
        yield Reason("revision of picktree", run.info.revision, environment.revision())


def _modules(run: Run) -> Iterator[Reason]:
    """Yield differences of installed plug-ins, whose sources the log holds."""
    for name in run.log.attachments:
        if name.startswith("module/") and name.endswith(".py"):
            module = name.removeprefix("module/").removesuffix(".py")
            try:
                spec = importlib.util.find_spec(module)
            except (ImportError, ValueError):
                spec = None
            source = Path(spec.origin) if spec and spec.origin else None
            now = _hash(source) if source else None
            if now != hashlib.sha256(run.log.attachment(name)).hexdigest():
                yield Reason(f"the plug-in {module} is another now", "", "")


def _meshes(run: Run) -> Iterator[Reason]:
    """Yield differences of meshes of a robot from an installed package: their content is not in the log."""
    for name, (digest, path) in _files(run).items():
        if name.startswith(ROBOT_MESHES) and name not in run.log.attachments:
            now = _hash(Path(path))
            if now is not None and now != digest:
                yield Reason(f"the robot's mesh {path} is another now", "", "")


def _differing_values(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[Reason]:
    """Yield values that differ. A value that an older log lacks is no reason."""
    for name, value in before.items():
        if now.get(name, "") != value:
            yield Reason(name, value, now.get(name, ""))


def _files(run: Run) -> dict[str, tuple[str, str]]:
    """Return hash and path by the name in the log."""
    pairs = {name: words.partition(" ") for name, words in run.info.files.items()}
    return {name: (digest, path) for name, (digest, _, path) in pairs.items()}


def _hash(path: Path) -> str | None:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return None
