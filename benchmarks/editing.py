"""CPU time of `picktree lsp` for one edit in a large mission: errors, linter, completion, hover.

The server is driven over stdio as an editor drives it. The CPU time is that of its whole process, divided by
the number of edits.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import statistics
import sys
from pathlib import Path

from lsprotocol import types
from pygls.lsp.client import LanguageClient

GROUP = """\
      - Sequence:
          - Observe: {camera: overhead, objects: "{items}"}
          - Fallback: [{Condition: {if: time > 3}}, GoTo]
          - ForEach:
              in: "{items}"
              out: "{item}"
              do: {Sequence: [Grasp: {object: "{item}"}, PutAway: {item: "{item}"}]}
"""
"""Nine nodes: a look, a test, and a loop."""
HEAD = """\
picktree: 1
kind: mission
scene: three_bins
trees:
  PutAway:
    ports: {item: object}
    Place: {object: "{item}", into: "{item.destination}"}
  Main:
    Sequence:
"""


class Editor:
    """Editor with one open mission."""

    def __init__(self, nodes: int) -> None:
        self.text = HEAD + GROUP * -(-nodes // 9)
        self.uri = Path("/nowhere/mission.yaml").as_uri()
        self._client = LanguageClient("bench", "1")
        self._checked = asyncio.Event()
        self._version = 1

        @self._client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def published(params: types.PublishDiagnosticsParams) -> None:
            self.faults = len(params.diagnostics)
            self._checked.set()

        del published

    async def start(self) -> None:
        await self._client.start_io(sys.executable, "-m", "picktree", "lsp")
        await self._client.initialize_async(types.InitializeParams(capabilities=types.ClientCapabilities()))
        self._client.initialized(types.InitializedParams())
        item = types.TextDocumentItem(self.uri, "yaml", self._version, self.text)
        self._client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        await self._checked.wait()

    def cpu(self) -> float:
        """Return the CPU time of the server so far, s."""
        fields = Path(f"/proc/{self._client._server.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    async def edit(self) -> None:
        """Change the number in the last condition, and await the check."""
        self._version += 1
        line = self.text.count("\n") - 5
        column = self.text.split("\n")[line].index("> ") + 2
        at = types.Range(types.Position(line, column), types.Position(line, column + 1))
        change = types.TextDocumentContentChangePartial(range=at, text=str(self._version % 10))
        document = types.VersionedTextDocumentIdentifier(self._version, self.uri)
        self._checked.clear()
        self._client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))
        await self._checked.wait()

    async def lint(self) -> None:
        """Await also the linter, which looks at the mission when no further edit comes."""
        await self.edit()
        self._checked.clear()
        await self._checked.wait()

    async def complete(self) -> None:
        line = self.text.count("\n") - 1
        column = self.text.split("\n")[line].index("{object: ") + 1
        place = types.TextDocumentIdentifier(self.uri), types.Position(line, column)
        found = await self._client.text_document_completion_async(types.CompletionParams(*place))
        assert isinstance(found, types.CompletionList) and found.items

    async def hover(self) -> None:
        line = self.text.count("\n") - 1
        column = self.text.split("\n")[line].index("Grasp") + 1
        place = types.TextDocumentIdentifier(self.uri), types.Position(line, column)
        assert await self._client.text_document_hover_async(types.HoverParams(*place))

    async def stop(self) -> None:
        await self._client.shutdown_async(None)
        self._client.exit(None)
        await self._client.stop()


async def measure(nodes: int, edits: int, rounds: int) -> None:
    editor = Editor(nodes)
    await editor.start()
    print(f"{nodes} nodes, {len(editor.text)} characters, {editor.faults} faults; median of {rounds} rounds")
    actions = {
        "errors": editor.edit,
        "and linter": editor.lint,
        "completion": editor.complete,
        "hover": editor.hover,
    }
    for name, action in actions.items():
        await action()
        taken: list[float] = []
        for _ in range(rounds):
            before = editor.cpu()
            for _ in range(edits):
                await action()
            taken.append((editor.cpu() - before) / edits * 1000)
        print(f"{name:<12} {statistics.median(taken):6.0f} ms CPU  ({min(taken):.0f} … {max(taken):.0f})")
    await editor.stop()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--edits", type=int, default=10, help="edits in each round")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    asyncio.run(measure(given.nodes, given.edits, given.rounds))
