"""Checking several files of any kind: all that is wrong with all of them, in one report, also as SARIF
2.1.0.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias
from urllib.parse import quote

from picktree.files.yaml import KINDS, Document, YamlNode, file_text, read_document

from .errors import SPOILING_CODES, Diagnostic, FileError, Mark
from .fault_codes import apply_suppressions, page, pages, title
from .fault_rendering import Paint, SourceLines, as_github, as_text, plain
from .file_system import is_file, is_folder

Check: TypeAlias = Callable[[Document], Iterable[Diagnostic]]
"""All that is wrong with a document of one kind, with the files that it names; never raises for its text."""
SUFFIXES = (".yaml", ".yml")
_PICKTREE_DOCUMENT = re.compile(
    rf"^[\s{{]*[\"']?(?:picktree[\"']?\s*:|kind[\"']?\s*:\s*(?:{'|'.join(KINDS)})\b)", re.MULTILINE
)


@dataclass(frozen=True, slots=True)
class UnsavedText:
    """Unsaved text to be checked; `path` gives its name and its folder."""

    path: Path
    raw: bytes


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Result of `picktree check`."""

    files: tuple[str, ...]
    """The files that were checked."""
    left_out: tuple[str, ...]
    """Files of folders that are YAML, but not ours."""
    faults: tuple[Diagnostic, ...]
    """Faults in the order of the files, then of their lines."""
    texts: Mapping[str, str] = field(default_factory=dict[str, str], repr=False)
    """Text of each file with faults, unless it could not be read."""

    @property
    def errors(self) -> int:
        return sum(fault.severity == "error" for fault in self.faults)

    @property
    def warnings(self) -> int:
        return len(self.faults) - self.errors

    def exit_code(self, *, strict: bool = False) -> int:
        """Return 2 for errors, 1 for warnings if these count, else 0."""
        return 2 if self.errors else 1 if strict and self.warnings else 0

    def to_text(self, paint: Paint = plain) -> str:
        """Return every fault with its line, and a line with the counts."""
        sources = SourceLines(self.texts)
        return "\n".join([*(as_text(fault, sources, paint) for fault in self.faults), self.summary()])

    def to_github(self) -> str:
        """Return annotations, and a line with the counts."""
        return "\n".join([*map(as_github, self.faults), self.summary()])

    def to_json_text(self) -> str:
        """Return one JSON object; `docs/check.md` describes its content."""
        faults = [
            {
                "file": fault.mark.file,
                "line": fault.mark.line,
                "column": fault.mark.column,
                "severity": fault.severity,
                "code": fault.code,
                "title": title(fault.code),
                "where": fault.where,
                "message": fault.message,
                "hint": fault.hint,
                "detail": fault.detail,
            }
            for fault in self.faults
        ]
        report = {
            "files": list(self.files),
            "left_out": list(self.left_out),
            "errors": self.errors,
            "warnings": self.warnings,
            "faults": faults,
        }
        return json.dumps(report, indent=2) + "\n"

    def summary(self) -> str:
        """Return the counts in one line.

        >>> CheckReport(("a.yaml", "b.yaml"), (), ()).summary()
        '2 files, no errors or warnings'
        """
        text = _count(len(self.files), "file")
        found = [_count(n, what) for n, what in ((self.errors, "error"), (self.warnings, "warning")) if n]
        text = f"{' and '.join(found)} in {text}" if found else f"{text}, no errors or warnings"
        if self.left_out:
            text += f"; {_count(len(self.left_out), 'YAML file')} without 'picktree:' left out"
        if found:
            which = "it" if len(self.faults) == 1 else "the first"
            first = min(self.faults, key=lambda fault: fault.severity != "error")
            text += f"; `picktree explain-code {first.code}` explains {which}"
        return text


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("s" if number != 1 else "")


def is_ours(text: str) -> bool:
    """Whether a YAML text is, or is to become, one of picktree's files."""
    return _PICKTREE_DOCUMENT.search(text) is not None


def check_files(
    paths: Iterable[Path | UnsavedText], checks: Mapping[str, Check], *, ours_only: bool = False
) -> CheckReport:
    """Check files, folders (all YAML files in them that are ours) and given texts, each once.

    `ours_only`: files that are not ours are left out also where they are named.
    """
    return _Round(checks, ours_only=ours_only).of(paths)


class _Round:
    """Faults found in one call, by file."""

    def __init__(self, checks: Mapping[str, Check], *, ours_only: bool) -> None:
        self._checks = checks
        self._ours_only = ours_only
        self._codes = tuple(page.code for page in pages())
        self._texts: dict[str, str] = {}
        self._left_out: list[str] = []
        self._found: dict[str, dict[Diagnostic, None]] = {}
        self._complete = set[str]()
        """Files that were looked at to their end: nothing keeps a warning in them from being found."""

    def of(self, paths: Iterable[Path | UnsavedText]) -> CheckReport:
        given: dict[Path, Path | UnsavedText] = {}
        for path in self._written_out(paths):
            given.setdefault(_real(path), path)
        files = tuple(_name(path) for path in given.values())
        order: dict[str, None] = dict.fromkeys(self._found)  # folders without files
        for path in given.values():
            found = list(dict.fromkeys(self._check(path)))
            for fault in found:
                self._found.setdefault(fault.mark.file, {})[fault] = None
            # Files that are only named by this one come behind it.
            order |= dict.fromkeys([_name(path), *(f.mark.file for f in found if f.mark.file not in files)])
        faults = [fault for file in order for fault in self._judged(file)]
        texts = {fault.mark.file: self._text(fault.mark.file) for fault in faults}
        return CheckReport(files, tuple(self._left_out), tuple(faults), texts)

    def _check(self, given: Path | UnsavedText) -> Iterable[Diagnostic]:
        path, name = given.path if isinstance(given, UnsavedText) else given, _name(given)
        try:
            text = (
                file_text.decoded(given.raw, name)
                if isinstance(given, UnsavedText)
                else file_text.read_text(path)
            )
            self._texts[name] = text
            document = xml_document(path, text) if is_xml(path, text) else read_document(path, text=text)
            found = list(self._checks[document.kind](document))
        except FileError as error:
            return error.faults
        if not any(fault.severity == "error" for fault in (*document.faults, *found)):
            self._complete.add(name)
        spoilt = {fault.mark for fault in document.faults if fault.code in SPOILING_CODES}
        return (*document.faults, *(fault for fault in found if fault.mark not in spoilt))

    def _judged(self, file: str) -> list[Diagnostic]:
        """Return the faults of one file in its order, without suppressed warnings."""
        found = tuple(self._found.get(file, ()))
        text = self._text(file)
        kept = apply_suppressions(found, text, file, self._codes, complete=file in self._complete)
        return sorted(kept, key=lambda fault: fault.mark)

    def _text(self, file: str) -> str:
        if file not in self._texts:
            try:
                self._texts[file] = file_text.read_text(Path(file))
            except FileError:
                self._texts[file] = ""
        return self._texts[file]

    # Folders.

    def _written_out(self, paths: Iterable[Path | UnsavedText]) -> Iterator[Path | UnsavedText]:
        for path in paths:
            if isinstance(path, UnsavedText) or not is_folder(path):
                if isinstance(path, UnsavedText) or not self._ours_only or self._is_ours(path):
                    yield path
                continue
            ours = [file for file in _yaml_files(path) if self._is_ours(file)]
            if not ours:
                message, hint = (
                    "there is no file of picktree's in this folder",
                    "a file begins with 'picktree: 1'",
                )
                fault = Diagnostic(Mark(str(path), 1, 1), "", message, hint, "P124")
                self._found.setdefault(str(path), {})[fault] = None
            yield from ours

    def _is_ours(self, file: Path) -> bool:
        """Whether a YAML file of a folder is one of picktree's; one that cannot be read might be."""
        try:
            text = file_text.read_text(file)
        except FileError:
            return True
        if is_ours(text):
            return True
        self._left_out.append(str(file))
        return False


def _yaml_files(folder: Path) -> Iterator[Path]:
    """Return all YAML files below a folder, sorted, without hidden files and targets of links."""
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(parent, name)
            if name.endswith(SUFFIXES) and not name.startswith(".") and is_file(path):
                yield path


def is_xml(path: Path, text: str) -> bool:
    """Whether a file holds XML, as behaviour trees of BehaviorTree.CPP do."""
    return text.lstrip().startswith("<") or (path.suffix == ".xml" and not text.strip())


def xml_document(path: Path, text: str) -> Document:
    """Return a document of the kind `xml`, whose text is left to its check."""
    return Document(path, text, "xml", {}, YamlNode({}, Mark(str(path), 1, 1)))


def _name(given: Path | UnsavedText) -> str:
    return str(given.path if isinstance(given, UnsavedText) else given)


def _real(given: Path | UnsavedText) -> Path:
    """Return the resolved path, which is the same for two names of one file."""
    path = given.path if isinstance(given, UnsavedText) else given
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path


SCHEMA: Final = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
ROOT: Final = "SRCROOT"
"""Base of the paths of files below the working directory."""
Json: TypeAlias = "dict[str, Json] | list[Json] | str | int | bool"


def to_sarif(report: CheckReport, version: str, folder: Path) -> str:
    """Return the log of one run as JSON; `folder` is the root of the files, an absolute path.

    Columns count code points. Files outside of the folder have absolute addresses.
    """
    known = {each.code for each in pages()}
    codes = sorted({fault.code for fault in report.faults} & known)
    driver: Json = {"name": "picktree", "version": version, "rules": [_rule(code) for code in codes]}
    run: dict[str, Json] = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "originalUriBaseIds": {ROOT: {"uri": f"{folder.as_uri()}/"}},
        "artifacts": [{"location": _location(name, folder)} for name in report.files],
        "results": [_result(fault, codes, folder) for fault in report.faults],
    }
    log: Json = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2) + "\n"


def _rule(code: str) -> Json:
    explained = page(code)
    return {
        "id": code,
        "shortDescription": {"text": explained.title},
        "fullDescription": {"text": explained.explanation},
        "help": {"text": f"picktree explain-code {code}", "markdown": explained.text},
    }


def _result(fault: Diagnostic, codes: list[str], folder: Path) -> Json:
    text = fault.message + (f" ({fault.hint})" if fault.hint else "")
    text += f"\n{fault.detail}" if fault.detail else ""
    place: dict[str, Json] = {"artifactLocation": _location(fault.mark.file, folder)}
    if fault.mark.line:
        place["region"] = {"startLine": fault.mark.line, "startColumn": max(fault.mark.column, 1)}
    location: dict[str, Json] = {"physicalLocation": place}
    if fault.where:
        location["logicalLocations"] = [{"fullyQualifiedName": fault.where}]
    result: dict[str, Json] = {
        "ruleId": fault.code,
        "level": fault.severity,
        "message": {"text": text},
        "locations": [location],
    }
    return result | ({"ruleIndex": codes.index(fault.code)} if fault.code in codes else {})


def _location(name: str, folder: Path) -> Json:
    """Return the address of a file: relative to the folder where the file lies in it."""
    if name.startswith("<"):
        return {"uri": quote(name)}  # stdin
    try:
        below = (folder / name).resolve().relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        return {"uri": Path(folder, name).as_uri()}
    return {"uri": quote(below.as_posix()), "uriBaseId": ROOT}
