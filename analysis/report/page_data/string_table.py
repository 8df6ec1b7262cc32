"""Texts that occur many times, each kept once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Words:
    """Numbers texts in the order in which they come; the empty text is 0."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {"": 0}

    def number(self, text: str) -> int:
        return self._numbers.setdefault(text, len(self._numbers))

    def numbers(self, texts: Sequence[str]) -> NDArray[np.uint32]:
        return np.array([self.number(text) for text in texts], dtype=np.uint32)

    @property
    def texts(self) -> tuple[str, ...]:
        """By their numbers."""
        return tuple(self._numbers)
