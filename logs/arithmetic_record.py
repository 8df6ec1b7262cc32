"""Arithmetic of a run: properties that determine the last bit of its numbers, and their comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    Final,
)

if TYPE_CHECKING:
    pass


PREFIXES: Final = ("version of ", "kernels of ", "probe of ", "departure of ")
"""Prefixes of a flat table's entries, in the order of the fields."""


@dataclass(frozen=True)
class Arithmetic:
    """Properties that determine the last bit of a floating-point number; empty where they were not
    recorded."""

    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    """Versions of the numerical libraries, of glibc and of Python."""
    kernels: Mapping[str, str] = field(default_factory=dict[str, str])
    """Kernels in use by library."""
    probe: Mapping[str, str] = field(default_factory=dict[str, str])
    """Fingerprint of a small computation with each library."""
    departures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Reason why a library computed with other kernels than in every other process, by library."""

    def __bool__(self) -> bool:
        return bool(self.versions)

    def words(self) -> dict[str, str]:
        """Return the record as a flat table, for metadata and tables of results."""
        return {
            prefix + name: value
            for prefix, part in zip(PREFIXES, self._parts, strict=True)
            for name, value in part.items()
        }

    @property
    def _parts(self) -> tuple[Mapping[str, str], ...]:
        return self.versions, self.kernels, self.probe, self.departures

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> Arithmetic:
        """Parse a flat table made by `words`; other entries of the table are ignored."""
        return cls(*({k.removeprefix(p): v for k, v in words.items() if k.startswith(p)} for p in PREFIXES))


def arithmetic_difference(recorded: Arithmetic, now: Arithmetic, where: str = "here") -> str:
    """Return a sentence that names what differs between two arithmetics, empty when nothing does.

    `where` says where the second one computes. Other kernels count only where the probe differs, too. A known
    reason for other kernels comes first.
    """
    if not recorded or not now:
        return "arithmetic not recorded: the log is of an older version"
    known = recorded.departures.items() ^ now.departures.items()
    differing = [
        f"{name} {reason}{'' if recorded.departures.get(name) == reason else f' {where}'}"
        for name, reason in sorted(known)
    ]
    differing += _pairs(recorded.versions, now.versions, where)
    # A computation that only another version of picktree probes with says nothing.
    probes = [name for name, digest in recorded.probe.items() if now.probe.get(name, digest) != digest]
    if probes:
        differing += _pairs(recorded.kernels, now.kernels, where)
        if not differing:
            differing = [f"other results of {' and '.join(probes)} {where}"]
    return (
        f"recorded with other arithmetic ({'; '.join(differing)}): the runs may diverge" if differing else ""
    )


def _pairs(recorded: Mapping[str, str], now: Mapping[str, str], where: str) -> list[str]:
    return [
        f"{name} {value}, {where} {now.get(name, 'none')}"
        for name, value in recorded.items()
        if now.get(name) != value
    ]
