"""The documentation site: every page in a group, links that lead somewhere, nothing from elsewhere."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
_LOADED = re.compile(r"<(?:script|link|img)[^>]*(?:src|href)=\"?(https?:[^\">\s]+)")


def test_the_site_is_built_without_warnings_and_is_searched(tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    entries = json.loads((tmp_path / "search" / "search_index.json").read_text(encoding="utf-8"))["docs"]
    places = {entry["location"].partition("#")[0] for entry in entries}
    for page in [*ROOT.glob("docs/*.md"), *ROOT.glob("files/pages/P*.md")]:
        folder = "" if page.parent.name == "docs" else "codes/"
        assert f"{folder}{page.stem}.html" in places
    for word in ("singulate", "force_limit", "P325"):
        assert any(word in entry["text"] or word in entry["title"] for entry in entries), word
    boosts = {entry["location"].partition("#")[0]: entry.get("boost", 1) for entry in entries}
    assert boosts["recovery.html"] == boosts["index.html"] == boosts["cookbook.html"] == 1
    assert max(boosts[name] for name in ("codes/P325.html", "codes.html", "nodes.html", "figures.html")) < 0.5
    for page in (tmp_path / "index.html", tmp_path / "language.html"):
        assert _LOADED.findall(page.read_text(encoding="utf-8")) == []
