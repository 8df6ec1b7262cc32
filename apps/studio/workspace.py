"""Workspace: the one folder that the studio reads and writes, symbolic links included, and its state: token,
trust, drafts.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from picktree.files import PicktreeError
from picktree.trees.loading import PLUGINS_VARIABLE

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
        """Return the unsaved text of a file."""
        with suppress(OSError, UnicodeDecodeError):
            return self._draft_file(path).read_text(encoding="utf-8")
        return None

    def keep_draft(self, path: str, text: str | None) -> None:
        """Keep an unsaved text; None: forget it. Raises PicktreeError when the disk refuses."""
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


MAX_FILE: Final = 2_000_000
"""Largest text file that is read or written, bytes."""
MAX_LISTED: Final = 5_000
"""Maximum number of YAML files that a listing reads."""
_KIND: Final = re.compile(rb"^kind:[ \t]*[\"']?([a-z]+)", re.MULTILINE)
_NAME: Final = re.compile(rb"^name:[ \t]*(.+)$", re.MULTILINE)
_SKIPPED: Final = frozenset({"__pycache__", "node_modules", "runs"})


@dataclass(frozen=True, slots=True)
class TextFile:
    """Text of a file with its version, which a later write names to notice changes of others."""

    path: str
    """Path below the folder."""
    text: str
    version: str
    """Hash of the content."""


@dataclass(frozen=True, slots=True)
class ListedFile:
    """YAML file of picktree below the folder."""

    path: str
    kind: str
    """Kind stated in the file: mission, scene, robot, faults, cases, plan, library."""
    name: str
    """Name stated in the file; empty without one."""


class Workspace:
    """Folder of the studio. Every path that a client names goes through `resolve`."""

    def __init__(self, folder: Path) -> None:
        """Take a folder. Raises PicktreeError for a path that is no folder."""
        if not folder.is_dir():
            raise PicktreeError(f"{folder}: no such folder; `picktree studio FOLDER` opens one that exists")
        self.root = folder.resolve()
        self.state = FolderState(self.root)

    def resolve(self, path: str) -> Path:
        """Return the place of a path below the folder, links followed; the file need not exist.

        Raises PicktreeError for a path that is absolute, or leads out of the folder.
        """
        outside = PicktreeError(f"{path!r} is not below the folder of the studio; write a path below it")
        if not path or "\0" in path or len(path) > 1000:
            raise PicktreeError(f"{path[:80]!r} is not the path of a file")
        if path.startswith(("/", "~")) or ".." in Path(path).parts:
            raise outside
        try:
            place = (self.root / path).resolve()
        except (OSError, RuntimeError):  # a circle of links
            raise outside from None
        if not place.is_relative_to(self.root):
            raise outside
        return place

    def relative(self, place: Path) -> str:
        """Return the path of a place below the folder, with slashes."""
        return place.relative_to(self.root).as_posix()

    def read(self, path: str) -> TextFile:
        """Read a text file. Raises PicktreeError when it is missing, too large, or not UTF-8."""
        place = self.resolve(path)
        try:
            if not stat.S_ISREG(place.stat().st_mode):
                raise PicktreeError(f"{path} is no file")
            if place.stat().st_size > MAX_FILE:
                raise PicktreeError(f"{path} is larger than {MAX_FILE / 1e6:g} MB")
            data = place.read_bytes()
            return TextFile(path, data.decode("utf-8"), _version(data))
        except UnicodeDecodeError:
            raise PicktreeError(f"{path} is not a UTF-8 text") from None
        except OSError as error:
            raise PicktreeError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}") from None

    def write(self, path: str, text: str, version: str | None = None) -> TextFile:
        """Write a text file, whole or not at all; `version`: its version at the read, None: a new file.

        Raises PicktreeError when the file has changed since, is too large, or the disk refuses.
        """
        place, data = self.resolve(path), text.encode("utf-8")
        if len(data) > MAX_FILE:
            raise PicktreeError(f"{path} would be larger than {MAX_FILE / 1e6:g} MB")
        if place.exists():
            if version is None:
                raise PicktreeError(f"{path} exists; choose another name")
            if self.read(path).version != version:
                raise PicktreeError(f"{path} has been changed by another program since it was opened")
        self._write_whole(place, path, data)
        return TextFile(path, text, _version(data))

    def _write_whole(self, place: Path, path: str, data: bytes) -> None:
        beside: str | None = None
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            mode = stat.S_IMODE(place.stat().st_mode) if place.exists() else 0o644
            handle, beside = tempfile.mkstemp(prefix=f".{place.name}-", dir=place.parent)
            with os.fdopen(handle, "wb") as out:
                out.write(data)
            os.chmod(beside, mode)
            os.replace(beside, place)
        except OSError as error:
            if beside is not None:
                Path(beside).unlink(missing_ok=True)
            raise PicktreeError(
                f"{path} cannot be written: {(error.strerror or str(error)).lower()}"
            ) from None

    def files(self, kind: str = "") -> list[ListedFile]:
        """Return the YAML files of picktree below the folder, of one kind or of all, sorted by path."""
        found = list[ListedFile]()
        for number, place in enumerate(self._yaml_files()):
            if number >= MAX_LISTED:
                break
            with suppress(OSError), place.open("rb") as opened:
                head = opened.read(4000)
                kind_match = _KIND.search(head)
                if (
                    kind_match is None
                    or b"picktree:" not in head
                    or (kind and kind_match[1].decode() != kind)
                ):
                    continue
                name = _NAME.search(head)
                text = name[1].decode("utf-8", "replace").split(" #")[0].strip().strip("\"'") if name else ""
                found.append(ListedFile(self.relative(place), kind_match[1].decode(), text))
        return sorted(found, key=lambda each: each.path)

    def _yaml_files(self) -> Iterator[Path]:
        """Yield regular YAML files. Links, hidden folders and folders of runs are left out."""
        todo = [self.root]
        while todo:
            with suppress(OSError), os.scandir(todo.pop()) as entries:
                for entry in sorted(entries, key=lambda each: each.name):
                    if entry.is_dir(follow_symlinks=False):
                        if entry.name not in _SKIPPED and not entry.name.startswith("."):
                            todo.append(Path(entry.path))
                    elif entry.name.endswith((".yaml", ".yml")) and entry.is_file(follow_symlinks=False):
                        yield Path(entry.path)

    def apply_trust(self) -> None:
        """Tell this process and its children by the environment whether plug-ins may be run."""
        if self.state.trusted:
            os.environ.pop(PLUGINS_VARIABLE, None)
        else:
            os.environ[PLUGINS_VARIABLE] = "refuse"


def _version(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:24]
