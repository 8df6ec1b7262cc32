"""The report of a run: what is packed, the one file, and the page in a browser."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.logs.report.report import write_report
from picktree.logs.run import Run

from .browser import NEEDED, Chromium


@pytest.fixture(scope="module")
def sample_page(log_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "sample.html"
    with Run(log_path) as run:
        write_report(run, file)
    return file


@NEEDED
def test_page_opens_without_a_word_or_a_request(sample_page: Path, chromium: Chromium) -> None:
    with chromium.page(sample_page) as (page, told):
        assert page.title() == "sort by colour, three_bins, seed 7"
        assert (told.problems, told.requests) == ([], [])
