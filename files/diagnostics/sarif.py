"""SARIF 2.1.0: faults as code scanning services read them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final, TypeAlias
from urllib.parse import quote

from ..marks import Diagnostic, Mark
from .fault_codes import page, pages
from .file_checks import CheckReport

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
    told = page(code)
    return {
        "id": code,
        "shortDescription": {"text": told.title},
        "fullDescription": {"text": told.explanation},
        "help": {"text": f"picktree explain-code {code}", "markdown": told.text},
    }


def _result(fault: Diagnostic, codes: list[str], folder: Path) -> Json:
    text = fault.message + (f" ({fault.hint})" if fault.hint else "")
    text += f"\n{fault.detail}" if fault.detail else ""
    place: dict[str, Json] = {"artifactLocation": _location(fault.mark.file, folder)}
    if fault.mark.line:
        place["region"] = _region(fault.mark)
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


def _region(mark: Mark) -> Json:
    return {"startLine": mark.line, "startColumn": max(mark.column, 1)}


def _location(name: str, folder: Path) -> Json:
    """Return the address of a file: relative to the folder where the file lies in it."""
    if name.startswith("<"):
        return {"uri": quote(name)}  # stdin
    try:
        below = (folder / name).resolve().relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        return {"uri": Path(folder, name).as_uri()}
    return {"uri": quote(below.as_posix()), "uriBaseId": ROOT}
