"""Language servers for all tests of the editor: the one for any YAML, and ours."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..needs import packages
from .language_server import LanguageServer

HERE = Path(__file__).parent
PROGRAM = HERE / "node/node_modules/yaml-language-server/bin/yaml-language-server"


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LanguageServer]:
    """yaml-language-server, the one inside VS Code's YAML extension and of most other editors."""
    packages("editor").require()
    running = LanguageServer(["node", str(PROGRAM), "--stdio"], tmp_path_factory.mktemp("editor"))
    yield running
    running.close()


@pytest.fixture(scope="session")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LanguageServer]:
    """`picktree lsp`."""
    running = LanguageServer([sys.executable, "-m", "picktree", "lsp"], tmp_path_factory.mktemp("ours"))
    yield running
    running.close()
