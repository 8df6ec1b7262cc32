"""Who follows a batch in tests: it remembers what it is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from picktree.apps.batch import Job, JobRow, RecordedJob


@dataclass
class Remembering:
    """`at_begin` is called when it begins, `at_end` after each job that was recorded, `at_again` after each
    try that was lost and is made again."""

    at_end: Callable[[], None] = lambda: None
    at_begin: Callable[[], None] = lambda: None
    at_again: Callable[[], None] = lambda: None
    done: tuple[JobRow, ...] = ()
    ends: list[RecordedJob] = field(default_factory=list[RecordedJob])
    again: list[str] = field(default_factory=list[str])

    def started(self, total: int, done: Sequence[JobRow], workers: int) -> None:
        self.done = tuple(done)
        self.at_begin()

    def ended(self, ended: RecordedJob) -> None:
        self.ends.append(ended)
        self.at_end()

    def tried_again(self, job: Job, reason: str) -> None:
        self.again.append(reason)
        self.at_again()

    def stopping(self, under_way: int) -> None: ...

    def waiting(self) -> None: ...
