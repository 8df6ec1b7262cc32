"""SIGINT and SIGTERM as one orderly way out that never cuts a write in two."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """While it is entered, both signals raise KeyboardInterrupt, but not before a held section is over.

    A library that calls back from C++ may swallow the exception; it comes again at the end of each held
    section, until somebody who caught it says `settle`. Outside the main thread, where Python delivers no
    signals, it changes nothing.
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def held(self) -> _Held:
        """A section that is finished before a signal that arrives meanwhile takes effect."""
        return self._section

    def hold(self) -> None:
        self._held += 1

    def release(self, *, failing: bool) -> None:
        """`failing`: another exception is on its way, which goes first."""
        self._held -= 1
        if self._pending and not self._held and not failing:
            raise KeyboardInterrupt

    def settle(self) -> None:
        """The interrupt was heard, and what is done now is done about it."""
        self._pending = False

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        self._pending = True
        if not self._held:
            raise KeyboardInterrupt


class _Held:
    """Entered for each message of a log, for which a generator would be slow."""

    def __init__(self, interrupts: Interrupts) -> None:
        self._interrupts = interrupts

    def __enter__(self) -> None:
        self._interrupts.hold()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._interrupts.release(failing=kind is not None)
