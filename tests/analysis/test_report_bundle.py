"""The committed bundle: what the recipe makes of its sources, with the licences of what is in it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from picktree.analysis.report.report import PAGE_FOLDER

from ..needs import needs, packages

HERE = Path(__file__).parents[1] / "logs" / "node"


@needs(packages("logs"))
def test_bundle_is_as_new_as_its_sources(tmp_path: Path) -> None:
    made = tmp_path / "report.js"
    done = subprocess.run(
        ["sh", "-c", f"OUT={made} npm run --silent build"], cwd=HERE, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    for name in ("report.js", "report.css"):
        assert (tmp_path / name).read_bytes() == (PAGE_FOLDER / name).read_bytes(), (
            f"{PAGE_FOLDER / name} is older than its sources: run `make page`"
        )


def test_bundle_carries_the_licences() -> None:
    banner = (HERE / "banner.txt").read_text(encoding="utf-8").strip()
    assert (PAGE_FOLDER / "report.js").read_text(encoding="utf-8").startswith(banner)
    assert (PAGE_FOLDER / "report.css").read_text(encoding="utf-8").startswith(banner)
    lock = (HERE / "package.json").read_text(encoding="utf-8")
    for words in ('"three": "0.187.0"', '"uplot": "1.6.32"'):
        assert words in lock
    assert "three 0.187.0 and uPlot 1.6.32" in banner
