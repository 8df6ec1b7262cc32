"""Reader of `include:`: the files that belong to a mission, each once, and the checks on them."""

from __future__ import annotations

import posixpath
from typing import Final

from ...errors import PicktreeError
from ...files.yaml.document import Document, FileError, Location, Value, where
from ..mission import IN_LIBRARY, MissionFiles
from ..values.fault_collector import MissionDiagnostics

MAX_INCLUDED_FILES: Final = 50
MAX_INCLUDED_CHARACTERS: Final = 1_000_000
"""Limit of the total size of all included files, characters."""
_SUFFIXES = (".yaml", ".yml")


class IncludeReader:
    """Reader that follows `include:` from the mission through all its files."""

    def __init__(self, files: MissionFiles, faults: MissionDiagnostics) -> None:
        self._files = files
        self._faults = faults
        self._found: dict[str, Document | None] = {}
        self._characters = 0

    def of(self, document: Document) -> tuple[Document, ...]:
        """Return the files that the mission includes, each once, in the order of their first mention."""
        self._follow(document, "", (document.path.name,))
        return tuple(found for found in self._found.values() if found is not None)

    def _follow(self, document: Document, folder: str, trail: tuple[str, ...]) -> None:
        """Follow the entries of one document. `folder`: the document's folder below the mission's; `trail`:
        names of the including files."""
        entries = document.data.get("include")
        if entries is None:
            return
        if not isinstance(entries, list):
            message = "'include' is a list of files beside the mission and of the library"
            self._fault(document, (), message, "as '[common.yaml, library/recovery]'", code="P242")
            return
        for index, entry in enumerate(entries):
            name = self._name(document, entry, folder, index)
            if name is not None:
                self._include(document, index, name, trail)

    def _include(self, document: Document, index: int, name: str, trail: tuple[str, ...]) -> None:
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            message = f"the files include each other in a circle: {circle}"
            self._fault(document, (index,), message, code="P243")
            return
        if name in self._found:
            return
        if len(self._found) >= MAX_INCLUDED_FILES:
            if len(self._found) == MAX_INCLUDED_FILES:
                self._found[""] = None
                message = f"a mission includes at most {MAX_INCLUDED_FILES} files"
                self._fault(document, (index,), message, code="P243")
            return
        included = self._found[name] = self._read(document, index, name)
        if included is not None:
            self._follow(included, posixpath.dirname(name), (*trail, name))

    def _read(self, document: Document, index: int, name: str) -> Document | None:
        try:
            included = self._files.document(name)
        except FileError as error:
            for fault in error.faults:
                self._faults.add(fault)
            return None
        except PicktreeError as error:
            self._fault(document, (index,), str(error), code="P243")
            return None
        for fault in included.faults:
            self._faults.add(fault)
        self._characters += len(included.text)
        if self._characters > MAX_INCLUDED_CHARACTERS:
            message = f"the included files are larger than {MAX_INCLUDED_CHARACTERS // 1_000_000} MB together"
            self._fault(document, (index,), message, code="P243")
            return None
        if included.data.get("library") is not True:
            message = f"{name!r} is not meant for inclusion"
            hint = "a file with sub-trees only says 'library: true' at the top"
            self._fault(document, (index,), message, hint, code="P243")
            return None
        return included

    def _name(self, document: Document, entry: Value, folder: str, index: int) -> str | None:
        """Return an entry's name relative to the mission's folder; None when it may not be included."""
        if not isinstance(entry, str) or not entry:
            message = "an included file is named by a text"
            self._fault(document, (index,), message, "as 'common.yaml' or 'library/recovery'", code="P242")
            return None
        if entry.startswith(IN_LIBRARY) and not entry.endswith(_SUFFIXES):
            if "/" in entry.removeprefix(IN_LIBRARY):
                self._fault(document, (index,), f"the library has no {entry!r}", code="P243")
                return None
            return entry
        if posixpath.isabs(entry) or "\\" in entry or ":" in entry or "\x00" in entry:
            message = f"{entry!r} is no path below the mission's folder"
            self._fault(document, (index,), message, "as 'common.yaml' or 'parts/bins.yaml'", code="P243")
            return None
        name = posixpath.normpath(posixpath.join(folder, entry))
        if name.startswith("../") or name == "..":
            message = f"{entry!r} lies outside of the mission's folder"
            self._fault(document, (index,), message, code="P243")
            return None
        if not name.endswith(_SUFFIXES):
            message = f"{entry!r} is no YAML file"
            hint = f"'{entry}.yaml', or 'library/{entry}' for one of the library"
            self._fault(document, (index,), message, hint, code="P242")
            return None
        return name

    def _fault(self, document: Document, loc: Location, message: str, hint: str = "", *, code: str) -> None:
        at: Location = ("include", *loc)
        self._faults.at(document, at, where(at), message, hint, code=code)
