"""The committed bundle of the page: what the recipe makes of its sources, which have sound types."""

from __future__ import annotations

import subprocess
from pathlib import Path

from picktree.apps.studio.server import PAGE_FOLDER
from picktree.logs.run_index import STATUSES

from ..needs import needs, packages

HERE = Path(__file__).parent / "node"
MADE = ("studio.js", "studio.css", "licences.txt")


@needs(packages("studio"))
def test_bundle_is_as_new_as_its_sources(tmp_path: Path) -> None:
    done = subprocess.run(
        ["sh", "-c", f"OUT={tmp_path} npm run --silent build"], cwd=HERE, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    for name in MADE:
        assert (tmp_path / name).read_bytes() == (PAGE_FOLDER / name).read_bytes(), (
            f"{PAGE_FOLDER / name} is older than its sources: run `make page`"
        )


@needs(packages("studio"))
def test_types_of_the_page_are_sound() -> None:
    done = subprocess.run(["npm", "run", "--silent", "test"], cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_each_status_of_a_run_has_a_sign() -> None:
    signs = (PAGE_FOLDER / "src" / "ui" / "Status.tsx").read_text(encoding="utf-8")
    assert {status for status in STATUSES if f"  {status}: [" not in signs} == set()


def test_nothing_of_the_page_makes_markup_of_text() -> None:
    sources = [*(PAGE_FOLDER / "src").rglob("*.ts"), *(PAGE_FOLDER / "src").rglob("*.tsx")]
    assert len(sources) > 20
    for word in (
        "innerHTML",
        "dangerouslySetInnerHTML",
        "insertAdjacentHTML",
        "document.write",
        "srcdoc",
        "eval(",
    ):
        assert [str(file) for file in sources if word in file.read_text(encoding="utf-8")] == []
