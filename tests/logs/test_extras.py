"""The command that adds an extra: it can be typed as it stands, wherever that is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from picktree.logs import install_command, optional_libraries

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv" / "bin" / "python"
PIP = "-m pip install"


@pytest.mark.parametrize(
    ("here", "installed", "command"),
    [
        (ROOT, False, f".venv/bin/python {PIP} -c constraints.txt 'picktree[ray]'"),
        ("/usr", False, f"{PYTHON} {PIP} -c {ROOT / 'constraints.txt'} 'picktree[ray]'"),
        ("/usr", True, f"{PYTHON} {PIP} 'picktree[ray]'"),
    ],
    ids=["in the checkout", "elsewhere", "an installed package"],
)
def test_command_that_can_be_typed(
    here: Path | str, installed: bool, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(PYTHON))
    monkeypatch.chdir(here)
    if installed:
        module = tmp_path / "picktree" / "logs" / "optional_libraries.py"
        monkeypatch.setattr(optional_libraries, "__file__", str(module))
    assert install_command("ray") == command


def test_it_takes_the_picktree_that_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """pip needs no place to look for it, and the pins are no fault to it."""
    monkeypatch.chdir(tmp_path)
    done = subprocess.run(
        ["sh", "-c", f"{install_command('analysis')} --no-index"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Requirement already satisfied: picktree[analysis]" in done.stdout
