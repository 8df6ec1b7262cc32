"""Logs in several files: when one goes on in the next, and what the files are called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Final

import orjson

PART = "picktree.part"
"""Metadata of each file after the first: what it goes on from."""
NEXT = "picktree.next"
"""Metadata of each file before the last: what it goes on in."""


@dataclass(frozen=True, slots=True)
class Rotation:
    """A log goes on in a further file when one has `size` bytes or spans `seconds` (simulated); 0 for no
    limit."""

    size: int = 0
    seconds: float = 0.0

    def __bool__(self) -> bool:
        return self.size > 0 or self.seconds > 0.0


NEVER: Final = Rotation()
FOR_FEEDS: Final = Rotation(size=32_000_000)
"""Of a run with a feed, which may go on for days, unless another is asked for."""


@dataclass(frozen=True, slots=True)
class PartInfo:
    """What a file that goes on with a log says of itself."""

    number: int
    """2 for the second file."""
    start: int
    """Simulated ns: what stands at this time or before repeats the file before."""
    digest: str
    """Of everything simulated in the files before, in hex."""
    repeated: Mapping[str, int]
    """By topic, how many messages repeat the file before."""

    def words(self) -> dict[str, str]:
        return {
            "number": str(self.number),
            "start": str(self.start),
            "digest": self.digest,
            "repeated": orjson.dumps(self.repeated).decode(),
        }

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> PartInfo:
        """Raises ValueError or KeyError when these are not the words of a part."""
        return cls(
            int(words["number"]), int(words["start"]), words["digest"], orjson.loads(words["repeated"])
        )


def part_path(first: Path, number: int) -> Path:
    """
    >>> part_path(Path("runs/a/log.mcap"), 2).name
    'log-0002.mcap'
    """
    return first if number == 1 else first.with_name(f"{first.stem}-{number:04d}{first.suffix}")


def part_paths(first: Path) -> dict[int, Path]:
    """Files beside the first that by their names go on with its log, by number."""
    found = first.parent.glob(f"{escape(first.stem)}-[0-9][0-9][0-9][0-9]*{first.suffix}")
    numbers = {path: path.stem.removeprefix(f"{first.stem}-") for path in found}
    return {int(n): path for path, n in sorted(numbers.items()) if n.isdigit() and int(n) > 1}
