"""Guides hold no campaign figures: rates with N and intervals belong to the pages of figures."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ..pages import pages, prose

MEASURED = {"bin-to-bin.md", "figures.md", "measurements.md", "fault-campaign.md", "failure-atlas.md"}
"""Pages of figures."""
RATES = (
    r"\d+ of \d+ \(",  # 143 of 150 (95.3 %, …)
    r"\(\d+(\.\d+)? … \d+(\.\d+)? ?%?\)",  # (92.6 … 100 %)
    r"\|\s*\d+ of \d+\s*\|",  # a column of rates
    r"95 % interval \d",
)


def rates(text: str) -> list[str]:
    """Return the lines with a rate, without code in the line."""
    lines = (re.sub(r"`[^`]*`", "", line) for line in text.splitlines())
    return [line for line in lines if any(re.search(rate, line) for rate in RATES)]


@pytest.mark.parametrize(
    "page", [page for page in pages() if page.name not in MEASURED], ids=lambda page: page.name
)
def test_a_guide_holds_no_rates(page: Path) -> None:
    assert rates(prose(page)) == []


def test_a_rate_would_be_found() -> None:
    assert rates("| held | 143 of 150 |\nheld in `1 of 2 (x)`\nsorted: 48 of 48 (92.6 … 100 %)") == [
        "| held | 143 of 150 |",
        "sorted: 48 of 48 (92.6 … 100 %)",
    ]
