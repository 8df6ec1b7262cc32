"""Log rotation: limits of a file, names of the further files, and metadata that connects them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Final

import orjson

PART_METADATA = "picktree.part"
"""Name of the metadata in each file after the first: the state that it continues from."""
NEXT_METADATA = "picktree.next"
"""Name of the metadata in each file before the last: the file that continues it."""


@dataclass(frozen=True, slots=True)
class Rotation:
    """Limits at which a log continues in a further file: `size` in bytes, `seconds` simulated; 0: no
    limit."""

    size: int = 0
    seconds: float = 0.0

    def __bool__(self) -> bool:
        return self.size > 0 or self.seconds > 0.0


NO_ROTATION: Final = Rotation()
FEED_ROTATION: Final = Rotation(size=32_000_000)
"""Default for a run with a feed, which may last for days."""


@dataclass(frozen=True, slots=True)
class PartInfo:
    """Description of a further file of a log."""

    number: int
    """Number of the file, 2 for the second."""
    start: int
    """Time of the last repeated message, simulated ns: messages at this time or before repeat the file
    before."""
    digest: str
    """Digest of everything simulated in the files before, in hex."""
    repeated: Mapping[str, int]
    """Number of messages that repeat the file before, by topic."""

    def words(self) -> dict[str, str]:
        return {
            "number": str(self.number),
            "start": str(self.start),
            "digest": self.digest,
            "repeated": orjson.dumps(self.repeated).decode(),
        }

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> PartInfo:
        """Parse the metadata. Raises ValueError or KeyError when it does not describe a part."""
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
    """Return the files beside the first that continue its log according to their names, by number."""
    found = first.parent.glob(f"{escape(first.stem)}-[0-9][0-9][0-9][0-9]*{first.suffix}")
    numbers = {path: path.stem.removeprefix(f"{first.stem}-") for path in found}
    return {int(n): path for path, n in sorted(numbers.items()) if n.isdigit() and int(n) > 1}
