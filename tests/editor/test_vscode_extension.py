"""The extension for VS Code: its manifest and its lock file belong together, and to this version."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "editors" / "vscode"


def test_manifest_lock_file_and_project_have_one_version() -> None:
    manifest = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
    locked = json.loads((FOLDER / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert manifest["version"] == locked[""]["version"] == project["version"]
    for kind in ("dependencies", "devDependencies"):
        assert manifest[kind] == locked[""][kind]
        assert manifest[kind] == {name: locked[f"node_modules/{name}"]["version"] for name in manifest[kind]}
    assert [name for name, each in locked.items() if "resolved" in each] == []
    assert (FOLDER / manifest["main"]).is_file()
