"""State of the studio for one folder, outside of the folder: token, trust of its plug-ins, drafts.

It stands in `picktree/studio` in `XDG_STATE_HOME` or `~/.local/state`, readable by its user only. A folder
that came from elsewhere can therefore not say of itself that it is trusted.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, cast

from ...files.errors import PicktreeError

MAX_DRAFTS: Final = 200
"""Number of drafts that are kept; beyond it the oldest is deleted."""


def state_base() -> Path:
    """Return the folder of all states. Raises PicktreeError when the user has no home."""
    base = os.environ.get("XDG_STATE_HOME", "")
    if os.path.isabs(base):
        return Path(base) / "picktree" / "studio"
    try:
        return Path.home() / ".local" / "state" / "picktree" / "studio"
    except RuntimeError:
        raise PicktreeError("no home folder: set XDG_STATE_HOME to a folder for the studio's state") from None


class FolderState:
    """State of one folder. It may be deleted; then the link changes and plug-ins are no longer trusted."""

    def __init__(self, folder: Path) -> None:
        """Read the state of a folder, by its resolved path. Raises PicktreeError when it cannot be kept."""
        name = hashlib.sha256(os.fsencode(folder)).hexdigest()[:24]
        self.place = state_base() / name
        self._file = self.place / "state.json"
        try:
            self.place.mkdir(parents=True, exist_ok=True, mode=0o700)
            os.chmod(self.place, 0o700)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise PicktreeError(f"{self.place}: the studio's state cannot be kept: {reason}") from None
        self._values = self._read()
        if not isinstance(self._values.get("token"), str):
            self._set(folder=str(folder), token=secrets.token_urlsafe(32))

    @property
    def token(self) -> str:
        """Secret of the link. It stays the same, so that a page finds a server that was started again."""
        return str(self._values["token"])

    @property
    def trusted(self) -> bool:
        """Whether plug-ins of missions in this folder may run."""
        return self._values.get("trusted") is True

    def trust(self, trusted: bool) -> None:
        """Allow or forbid plug-ins of this folder. Raises PicktreeError when the disk refuses."""
        self._set(trusted=trusted)

    def draft(self, path: str) -> str | None:
        """Return the text that was typed for a file and not written into it."""
        with suppress(OSError, UnicodeDecodeError):
            return self._draft_file(path).read_text(encoding="utf-8")
        return None

    def keep_draft(self, path: str, text: str | None) -> None:
        """Keep a text that was typed; None: forget it. Raises PicktreeError when the disk refuses."""
        file = self._draft_file(path)
        if text is None:
            file.unlink(missing_ok=True)
            return
        _write(file, text)
        drafts = sorted(file.parent.iterdir(), key=lambda each: each.stat().st_mtime)
        for old in drafts[:-MAX_DRAFTS]:
            old.unlink(missing_ok=True)

    def _draft_file(self, path: str) -> Path:
        return self.place / "drafts" / hashlib.sha256(path.encode()).hexdigest()[:32]

    def _read(self) -> dict[str, Any]:
        with suppress(OSError, ValueError):
            values: object = json.loads(self._file.read_text(encoding="utf-8"))
            if isinstance(values, dict):
                return cast("dict[str, Any]", values)
        return {}

    def _set(self, **values: object) -> None:
        self._values.update(values)
        _write(self._file, json.dumps(self._values, indent=1))


def _write(file: Path, text: str) -> None:
    beside = file.with_name(f".{file.name}-{os.getpid()}")
    try:
        file.parent.mkdir(exist_ok=True, mode=0o700)
        with open(
            os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8"
        ) as out:
            out.write(text)
        beside.replace(file)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{file} cannot be written: {reason}") from None
