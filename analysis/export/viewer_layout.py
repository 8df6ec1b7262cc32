"""Layout for Lichtblick and Foxglove: one shipped file for every log."""

from __future__ import annotations

from pathlib import Path
from typing import Final

LAYOUT_FILE: Final = Path(__file__).with_suffix(".json")
"""File that the viewers import."""
