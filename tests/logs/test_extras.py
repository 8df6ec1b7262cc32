"""The command that adds an extra: it can be typed as it stands, wherever that is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from picktree.logs import install_command, optional_libraries

ROOT = Path(__file__).parents[2]
PIP = "-m pip install"


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch) -> Path:
    python = ROOT / ".venv" / "bin" / "python"
    monkeypatch.setattr(sys, "executable", str(python))
    return python


def test_in_the_checkout(python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert install_command("ray") == f".venv/bin/python {PIP} -c constraints.txt 'picktree[ray]'"


def test_from_elsewhere(python: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert install_command("ray") == f"{python} {PIP} -c {ROOT / 'constraints.txt'} 'picktree[ray]'"


def test_of_an_installed_package(python: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        optional_libraries, "__file__", str(tmp_path / "picktree" / "logs" / "optional_libraries.py")
    )
    assert install_command("ray") == f"{python} {PIP} 'picktree[ray]'"


def test_it_takes_the_picktree_that_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """pip needs no place to look for it, and the pins are no fault to it."""
    monkeypatch.chdir(tmp_path)
    done = subprocess.run(
        ["sh", "-c", f"{install_command('analysis')} --no-index"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Requirement already satisfied: picktree[analysis]" in done.stdout
