"""Interrupts: SIGINT and SIGTERM raise KeyboardInterrupt, but never within a write."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Handler that lets both signals raise KeyboardInterrupt after the present held section; a context
    manager.

    A library that calls back from C++ may swallow the exception. It is raised again at the end of each held
    section, until `settle` is called. Outside the main thread, where Python delivers no signals, nothing
    changes.
    """

    def __init__(self) -> None:
        self._held = 0
        self._pending = False
        self._before: dict[signal.Signals, Any] = {}
        self._section = _Held(self)

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._arrived) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def held(self) -> _Held:
        """Return a section that is finished before a signal that arrives during it takes effect."""
        return self._section

    def hold(self) -> None:
        self._held += 1

    def release(self, *, failing: bool) -> None:
        """End a held section. `failing`: another exception is being raised, which has priority."""
        self._held -= 1
        if self._pending and not self._held and not failing:
            raise KeyboardInterrupt

    def settle(self) -> None:
        """Acknowledge the interrupt, so that it is not raised again."""
        self._pending = False

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        self._pending = True
        if not self._held:
            raise KeyboardInterrupt


class _Held:
    """Held section, a class because a generator is too slow for each message of a log."""

    def __init__(self, interrupts: Interrupts) -> None:
        self._interrupts = interrupts

    def __enter__(self) -> None:
        self._interrupts.hold()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._interrupts.release(failing=kind is not None)
