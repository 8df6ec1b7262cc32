"""One language server for all tests of the editor."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from .language_server import LanguageServer

HERE = Path(__file__).parent
PROGRAM = HERE / "node/node_modules/yaml-language-server/bin/yaml-language-server"


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LanguageServer]:
    """yaml-language-server, the one inside VS Code's YAML extension and of most other editors."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    if not PROGRAM.is_file():
        pytest.skip(f"npm packages are missing: run `npm ci` in {PROGRAM.parents[3]}")
    running = LanguageServer([node, str(PROGRAM), "--stdio"], tmp_path_factory.mktemp("editor"))
    yield running
    running.close()
