"""What is to be run: a matrix of missions, scenes, faults and settings, each with many seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Literal, TypeAlias

from ...simulation.backends import Backend

Keep: TypeAlias = Literal["all", "failures", "none"]
"""Which logs stay on the disk."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Of one job."""

    simulated: float = 3600.0
    """Simulated s, after which the run ends as `timeout`."""
    wall: float = 3600.0
    """Wall s, after which it is ended."""
    memory: int = 4 << 30
    """Bytes of resident memory, from which on it is ended."""
    disk: int = 10 * 10**9
    """Bytes that it may write, from which on it is ended."""


@dataclass(frozen=True, slots=True)
class Variant:
    """One cell of the matrix, still without a seed."""

    mission: Path
    scene: str | None
    """Instead of the mission's own; the path of a file is absolute."""
    faults: Path | None
    settings: Mapping[str, str]
    label: str
    """What sets it apart from the other variants of its plan."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A batch as it was asked for. Paths are absolute."""

    name: str
    missions: tuple[Path, ...]
    seeds: tuple[int, ...]
    scenes: tuple[str | None, ...] = (None,)
    faults: tuple[Path | None, ...] = (None,)
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, "tuple[str, ...]"])
    """Values to be tried, by parameter of the mission or port of its nodes."""
    backend: Backend = "physics"
    verify: bool = False
    limits: Limits = Limits()
    keep: Keep = "failures"

    def variants(self) -> Iterator[Variant]:
        """Every combination, the last list changing fastest."""
        names = list(self.settings)
        for mission, scene, faults in product(self.missions, self.scenes, self.faults):
            for values in product(*self.settings.values()):
                settings = dict(zip(names, values, strict=True))
                yield Variant(mission, scene, faults, settings, self._label(mission, scene, faults, settings))

    def _label(
        self, mission: Path, scene: str | None, faults: Path | None, settings: Mapping[str, str]
    ) -> str:
        words: list[str] = []
        if len(self.missions) > 1:
            words.append(mission.stem)
        if len(self.scenes) > 1:
            words.append(Path(scene).stem if scene else "own scene")
        if len(self.faults) > 1:
            words.append(faults.stem if faults else "no faults")
        words += [f"{name}={value}" for name, value in settings.items() if len(self.settings[name]) > 1]
        return ", ".join(words) or mission.stem
