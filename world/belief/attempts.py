"""Memory of what was tried, so that a retry does not do the same again. Part of the checkpoint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol, TypeVar


class NamedCandidate(Protocol):
    @property
    def name(self) -> str: ...


C = TypeVar("C", bound=NamedCandidate)


class AttemptMemory:
    """Names of the candidates that were tried and failed, for each (node path, object)."""

    def __init__(self) -> None:
        self._tried: dict[str, list[str]] = {}

    def remaining(self, node: str, subject: str, candidates: Iterable[C]) -> list[C]:
        """Candidates not tried before by this node on this subject, in their order.

        When all were tried the memory is cleared and all are offered again: the scene may have changed.
        """
        ranked = list(candidates)
        tried = self._tried.get(f"{node}|{subject}", [])
        fresh = [c for c in ranked if c.name not in tried]
        if not fresh and ranked:
            self._tried.pop(f"{node}|{subject}", None)
            return ranked
        return fresh

    def count(self, node: str, subject: str) -> int:
        """How many candidates were tried since the memory was last cleared."""
        return len(self._tried.get(f"{node}|{subject}", ()))

    def failed(self, node: str, subject: str, candidate: str) -> None:
        self._tried.setdefault(f"{node}|{subject}", []).append(candidate)

    def clear(self, node: str, subject: str) -> None:
        self._tried.pop(f"{node}|{subject}", None)

    def forget(self, subject: str) -> None:
        """An object is gone for good: nothing that was tried on it is of use any more."""
        for key in [key for key in self._tried if key.rpartition("|")[2] == subject]:
            del self._tried[key]

    def state(self) -> dict[str, list[str]]:
        return {key: list(names) for key, names in self._tried.items()}

    def restore(self, state: Mapping[str, Iterable[str]]) -> None:
        self._tried = {key: list(names) for key, names in state.items()}
