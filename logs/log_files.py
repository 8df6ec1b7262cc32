"""Files of a log: the one that a LOG argument names, further ones by rotation, and their joined reader."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from typing import Final

import orjson

from picktree.files import PicktreeError, file_system
from picktree.logs.mcap import ChannelInfo, McapReader, RawMessage

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


@dataclass(frozen=True, slots=True)
class _Part:
    """File of a log. In a further file only messages later than `since` (ns) are new."""

    reading: McapReader
    metadata: dict[str, dict[str, str]]
    info: PartInfo | None
    since: int | None

    def after(self, start: int | None) -> int | None:
        if self.since is None:
            return start
        return self.since + 1 if start is None else max(start, self.since + 1)


class JoinedLog:
    """Log in the file at `path` and in the files beside it that continue it; a file that continues another is
    read alone.

    The constructor and all methods raise PicktreeError. `recovered` is a sentence when something is missing
    or damaged, else empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts: list[_Part] = []
        try:
            first = self._open(path)
            self._parts.append(first)
            self.continued_part = first.info
            """Part information of a log that begins with a later file; None for the beginning of a log."""
            gaps = self._join(path, first) if first.info is None else []
        except PicktreeError:
            self.close()
            raise
        losses = [part.reading.recovered for part in self._parts if part.reading.recovered]
        self.recovered = "; ".join((*losses, *gaps))

    def close(self) -> None:
        for part in self._parts:
            part.reading.close()

    @property
    def paths(self) -> tuple[Path, ...]:
        return tuple(part.reading.path for part in self._parts)

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata with the values of the log's beginning, and new names of later files; without the links
        between files."""
        merged: dict[str, dict[str, str]] = {}
        for part in reversed(self._parts):
            merged.update(part.metadata)
        if len(self._parts) > 1:
            for name in (PART_METADATA, NEXT_METADATA):
                merged.pop(name, None)
        return merged

    @property
    def channels(self) -> tuple[ChannelInfo, ...]:
        found: dict[str, ChannelInfo] = {}
        counts: Counter[str] = Counter()
        for part in self._parts:
            for channel in part.reading.channels:
                found.setdefault(channel.topic, channel)
                counts[channel.topic] += channel.messages
            if part.since is not None and part.info is not None:
                counts.subtract(part.info.repeated)
        return tuple(replace(c, messages=max(counts[c.topic], 0)) for c in found.values())

    @property
    def is_rewritten(self) -> bool:
        """Whether a file is damaged, missing, or written by another program than picktree."""
        return bool(self.recovered) or any(part.reading.is_rewritten for part in self._parts)

    @property
    def writers(self) -> str:
        """Programs that wrote the files, in their own words."""
        return ", ".join(dict.fromkeys(filter(None, (part.reading.writer for part in self._parts))))

    @property
    def start(self) -> int:
        """Time of the first message, ns."""
        return self._parts[0].reading.start

    @property
    def end(self) -> int:
        """Time of the last message, ns."""
        return max(part.reading.end for part in self._parts)

    @property
    def attachments(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for part in self._parts for name in part.reading.attachments))

    def attachment(self, name: str) -> bytes | None:
        """Return the attachment's content; None without an attachment of that name."""
        for part in self._parts:
            found = part.reading.attachment(name)
            if found is not None:
                return found.data
        return None

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield messages of these topics with start ≤ time ≤ end (ns), in order of time."""
        for part in reversed(self._parts) if newest_first else self._parts:
            yield from part.reading.messages(topics, part.after(start), end, newest_first=newest_first)

    def times(self, topic: str) -> list[int]:
        """Return the times of a topic's messages, ns."""
        return [time for part in self._parts for time in part.reading.times(topic, part.after(None))]

    def _open(self, path: Path) -> _Part:
        reading = McapReader(path)
        try:
            metadata = reading.metadata()
            words = metadata.get(PART_METADATA)
            try:
                info = PartInfo.from_words(words) if words is not None else None
            except (KeyError, ValueError) as error:
                raise PicktreeError(f"{path}: the metadata {PART_METADATA} are damaged: {error}") from None
            continued = float(metadata.get("picktree.continues", {}).get("time", "0"))
            begin = info.start if info else round(continued * 1e9)
            if reading.is_rewritten or reading.start != begin:
                from .simulated_clock import restore_simulated_times  # protobuf is slow to load

                restore_simulated_times(reading, begin)
        except PicktreeError:
            reading.close()
            raise
        return _Part(reading, metadata, info, None)

    def _join(self, path: Path, first: _Part) -> list[str]:
        """Add the files that continue the first. Return sentences about missing ones."""
        beside = part_paths(path)
        gaps: list[str] = []
        lost = ""  # reason for a gap before the next part
        last = max(beside, default=1)
        for number in range(2, last + 1):
            file = part_path(path, number)
            try:
                if number not in beside:
                    raise PicktreeError(f"{file} is missing")
                part = self._open(beside[number])
                if not self._continues(part, number, adjacent=not lost):
                    part.reading.close()
                    raise PicktreeError(f"{file} belongs to another log")
            except PicktreeError as error:
                lost = f"{lost} and {error}" if lost else str(error)
                continue
            since = part.info.start if part.info is not None else self.end
            if lost:
                gaps.append(f"{lost}: {self.end / 1e9:.2f} s to {since / 1e9:.2f} s lost")
                lost = ""
            self._parts.append(_Part(part.reading, part.metadata, part.info, since))
        following = self._parts[-1].metadata.get(NEXT_METADATA, {}).get("part")
        if following is not None and not lost:
            lost = f"{path.with_name(following)} is missing"
        if lost:
            gaps.append(f"{lost}: everything after {self.end / 1e9:.2f} s lost")
        return gaps

    def _continues(self, part: _Part, number: int, *, adjacent: bool) -> bool:
        """Whether this part continues the log, according to the metadata of the files; without any, by its
        times."""
        before = self._parts[-1]
        if not part.metadata and not before.metadata:
            return part.reading.end > before.reading.end
        if part.info is None or part.info.number != number:
            return False
        if part.metadata.get("picktree") != self._parts[0].metadata.get("picktree"):
            return False
        link = before.metadata.get(NEXT_METADATA)
        return not adjacent or link is None or link.get("digest") == part.info.digest


LOG_NAME = "log.mcap"
RUNS_FOLDER = Path("runs")
BATCH_RESULTS = "results.sqlite"
"""File that identifies the folder of a batch."""


def find_log(where: str | Path) -> Path:
    """Return the log file that LOG names: a file, a run's folder, also by its name in ./runs, or `last`.

    Raises PicktreeError.
    """
    if str(where) == "last":
        logs = sorted(RUNS_FOLDER.glob(f"*/{LOG_NAME}"), key=lambda p: (_last_write_time(p), str(p)))
        if not logs:
            raise PicktreeError(
                f"there is no run in {RUNS_FOLDER.absolute()} yet; `picktree run MISSION` makes one"
            )
        return logs[-1]
    path = Path(where)
    file_system.require_utf8(path.absolute())
    if not path.exists() and (RUNS_FOLDER / path).is_dir():
        path = RUNS_FOLDER / path
    if path.is_dir():
        inside = path / LOG_NAME
        if inside.is_file():
            return inside
        others = sorted(path.glob("*.mcap"))
        if len(others) == 1:
            return others[0]
        parts = [part.name for part in part_paths(inside).values()]
        there = f"; it holds {', '.join(parts)}, which open by their own names" if parts else ""
        if any(path.glob(f"*/{LOG_NAME}")):
            there = f"; there are runs in it: name one, or run `picktree explain {path}` for all of them"
        if (path / BATCH_RESULTS).is_file():
            there = (
                f"; it is a batch: name one of its jobs, as {path}@seed=0; "
                f"`picktree batch report {path}` describes all jobs, "
                f"`picktree resim {path}@seed=0` makes a log that was not kept"
            )
        raise PicktreeError(f"{path}: there is no {LOG_NAME} in this folder{there}")
    if not path.exists():
        raise PicktreeError(f"{path}: there is no such log")
    return path


def _last_write_time(log: Path) -> int:
    """Return the time of the last write to a log's last file, ns."""
    return max(path.stat().st_mtime_ns for path in (log, *part_paths(log).values()))
