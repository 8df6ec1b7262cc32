"""Seeds as people write them: `0:100` is half open, `3,7,20:30` a list of both."""

from __future__ import annotations

from ...errors import PicktreeError

MOST_SEEDS = 100_000
LARGEST_SEED = 2**31 - 1
_EXAMPLE = "write 0:100 (half open), 3,7 or both"


def parse_seeds(text: str) -> tuple[int, ...]:
    """In the order of the text, each once. Raises PicktreeError.

    >>> parse_seeds("0:3,7")
    (0, 1, 2, 7)
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        first, colon, last = part.strip().partition(":")
        try:
            start = int(first)
            stop = int(last) if colon else start + 1
        except ValueError:
            raise PicktreeError(f"seeds {text!r}: {part.strip()!r} is no seed; {_EXAMPLE}") from None
        if start < 0 or stop - 1 > LARGEST_SEED:
            raise PicktreeError(f"seeds {text!r}: a seed is 0 or more, and at most {LARGEST_SEED}")
        if stop <= start:
            raise PicktreeError(f"seeds {text!r}: {part.strip()!r} holds no seed: {_EXAMPLE}")
        if len(seeds) + stop - start > MOST_SEEDS:
            raise PicktreeError(f"seeds {text!r}: more than {MOST_SEEDS} seeds")
        seeds.update(dict.fromkeys(range(start, stop)))
    return tuple(seeds)
