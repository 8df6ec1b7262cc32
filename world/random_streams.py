"""Keyed randomness: each purpose has a stream of its own, so that a change in one place shifts no other."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class StreamVariant:
    """Change of a run's sensor noise and planner seeds, to other draws from the same distributions."""

    number: int
    """Number of the variant, from 1: equal numbers give equal draws."""
    since: float
    """Simulated time from which the draws differ, s; before it the run is that of the seed."""

    def words(self) -> str:
        return f"{self.number} {self.since!r}"

    @classmethod
    def from_words(cls, words: str) -> StreamVariant:
        """Parse the text made by `words`. Raises ValueError."""
        number, since = words.split(" ")
        return cls(int(number), float(since))


class RandomStreams:
    """Random generators by (seed, stream name, count).

    `take` counts the generators of each stream; the count is state and belongs into a checkpoint.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.variant = 0
        """Number of a `StreamVariant`; 0: the generators of the seed itself."""
        self._counts: dict[str, int] = {}

    def at(self, stream: str, n: int) -> np.random.Generator:
        """Return the n-th generator of `stream`; it depends only on (seed, stream, n) and the variant."""
        variant = [self.variant] if self.variant else []
        return np.random.default_rng([self.seed, zlib.crc32(stream.encode()), n, *variant])

    def take(self, stream: str) -> np.random.Generator:
        """Return the next generator of `stream`."""
        n = self._counts.get(stream, 0)
        self._counts[stream] = n + 1
        return self.at(stream, n)

    def number(self, stream: str) -> int:
        """Return a positive 31-bit seed from the next generator of `stream`, for libraries that want a
        number."""
        return int(self.take(stream).integers(1, 2**31 - 1))

    def state(self) -> dict[str, int]:
        return dict(self._counts)

    def restore(self, counts: Mapping[str, int]) -> None:
        self._counts = dict(counts)
