"""Keyed randomness: each purpose has a stream of its own, so that a change in one place shifts no other."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np


class RandomStreams:
    """Random generators by (seed, stream name, count).

    `take` counts the generators of each stream; the count is state and belongs into a checkpoint.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._counts: dict[str, int] = {}

    def at(self, stream: str, n: int) -> np.random.Generator:
        """Return the n-th generator of `stream`; it depends only on (seed, stream, n)."""
        return np.random.default_rng([self.seed, zlib.crc32(stream.encode()), n])

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
