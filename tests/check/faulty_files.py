"""The files of `faulty/`, checked once for all tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from picktree.apps.cli.file_schemas import CHECKS
from picktree.files.file_checks import CheckReport, check_files

FAULTY = Path(__file__).parent / "faulty"


@cache
def faulty_report() -> CheckReport:
    return check_files([FAULTY, FAULTY / "form_empty.yaml"], CHECKS)  # which a folder leaves out
