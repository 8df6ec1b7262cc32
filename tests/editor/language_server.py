"""A small client of the language server protocol: enough to open a file and ask what an editor asks."""

from __future__ import annotations

import json
import queue
import subprocess
import threading
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

SECONDS = 120.0
"""How long an answer may take, on a machine that does much else."""
SETTINGS: Mapping[str, object] = {
    "validate": True,
    "completion": True,
    "hover": True,
    "yamlVersion": "1.2",
    "schemaStore": {"enable": False, "url": ""},
    "kubernetesCRDStore": {"enable": False},
    "schemas": {},
}
"""What editors have by default, except that no schema is fetched from elsewhere."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """A squiggle. Line and column count from 1, as in our own messages."""

    line: int
    column: int
    message: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """What completion offers; `text` is what it would write."""

    label: str
    text: str
    documentation: str


class LanguageServer:
    """One server process, spoken to over its pipes."""

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        self._process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._input: IO[bytes] = self._process.stdin
        self._answers: dict[int, queue.Queue[Any]] = {}
        self._published: queue.Queue[dict[str, Any]] = queue.Queue()
        self._next = 0
        self._version = 0
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, args=(self._process.stdout,), daemon=True).start()
        self._initialize(folder)

    def _initialize(self, folder: Path) -> None:
        markdown = ["markdown", "plaintext"]
        self._request(
            "initialize",
            {
                "processId": None,
                "rootUri": folder.as_uri(),
                "workspaceFolders": [{"uri": folder.as_uri(), "name": folder.name}],
                "capabilities": {
                    "textDocument": {
                        "completion": {
                            "completionItem": {"snippetSupport": True, "documentationFormat": markdown}
                        },
                        "hover": {"contentFormat": markdown},
                        "publishDiagnostics": {},
                    },
                    "workspace": {"configuration": True, "didChangeConfiguration": {}},
                },
            },
        )
        self._notify("initialized", {})
        self._notify("workspace/didChangeConfiguration", {"settings": {"yaml": SETTINGS}})

    def close(self) -> None:
        self._request("shutdown", None)
        self._notify("exit", None)
        self._process.wait(SECONDS)

    def diagnostics(self, files: Mapping[Path, str]) -> dict[Path, list[Diagnostic]]:
        """Open the files with these texts and return what is underlined in each."""
        for path, text in files.items():
            self.open(path, text)
        found = self._next_published(files)
        for path in files:
            self._notify("textDocument/didClose", {"textDocument": {"uri": path.as_uri()}})
        self._next_published(files)  # the server wipes what it has underlined
        return found

    def _next_published(self, files: Collection[Path]) -> dict[Path, list[Diagnostic]]:
        waiting = {path.as_uri(): path for path in files}
        found: dict[Path, list[Diagnostic]] = {}
        while waiting:
            published = self._published.get(timeout=SECONDS)
            path = waiting.pop(published["uri"], None)
            if path is not None:
                found[path] = [_diagnostic(item) for item in published["diagnostics"]]
        return found

    def open(self, path: Path, text: str) -> None:
        """Open a file, to ask about places in it."""
        self._version += 1
        document = {"uri": path.as_uri(), "languageId": "yaml", "version": self._version, "text": text}
        self._notify("textDocument/didOpen", {"textDocument": document})

    def complete(self, path: Path, line: int, column: int) -> dict[str, Proposal]:
        """What is offered there, by label."""
        answer = self._request("textDocument/completion", _at(path, line, column))
        found = [_proposal(item) for item in answer["items"]]
        return {proposal.label: proposal for proposal in found}

    def hover(self, path: Path, line: int, column: int) -> str:
        """What is shown there, as Markdown."""
        answer = self._request("textDocument/hover", _at(path, line, column))
        return answer["contents"]["value"] if answer else ""

    def ask(self, method: str, path: Path, line: int, column: int, **more: object) -> Any:
        """The plain answer about a place: a result, or an error object."""
        return self._request(method, _at(path, line, column) | more)

    def request(self, method: str, path: Path) -> Any:
        """The plain answer about a whole file."""
        return self._request(method, {"textDocument": {"uri": path.as_uri()}})

    def change(self, path: Path, text: str) -> None:
        """Replace the text of an open file."""
        self._version += 1
        document = {"uri": path.as_uri(), "version": self._version}
        self._notify("textDocument/didChange", {"textDocument": document, "contentChanges": [{"text": text}]})

    def underlined(self) -> list[dict[str, Any]]:
        """What is underlined after the last change, as the protocol has it."""
        while True:
            published = self._published.get(timeout=SECONDS)
            if published.get("version") == self._version:
                return published["diagnostics"]

    def fixes(self, path: Path, diagnostic: dict[str, Any]) -> list[dict[str, Any]]:
        """The quick fixes of one fault."""
        context = {"diagnostics": [diagnostic]}
        place = {"textDocument": {"uri": path.as_uri()}, "range": diagnostic["range"], "context": context}
        return self._request("textDocument/codeAction", place)

    # The protocol: JSON-RPC with a header of its own.

    def _request(self, method: str, params: object) -> Any:
        self._next += 1
        self._answers[self._next] = queue.Queue()
        self._send({"id": self._next, "method": method, "params": params})
        return self._answers[self._next].get(timeout=SECONDS)

    def _notify(self, method: str, params: object) -> None:
        self._send({"method": method, "params": params})

    def _send(self, message: dict[str, object]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        with self._lock:
            self._input.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
            self._input.flush()

    def _listen(self, output: IO[bytes]) -> None:
        while header := output.readline():
            length = int(header.split(b":")[1]) if header.lower().startswith(b"content-length") else 0
            while (rest := output.readline()) not in (b"\r\n", b""):
                if rest.lower().startswith(b"content-length"):
                    length = int(rest.split(b":")[1])
            self._receive(json.loads(output.read(length)))

    def _receive(self, message: dict[str, Any]) -> None:
        if "method" not in message:
            self._answers[message["id"]].put(message.get("result", message.get("error")))
        elif "id" in message:
            self._send({"id": message["id"], "result": self._answer(message)})
        elif message["method"] == "textDocument/publishDiagnostics":
            self._published.put(message["params"])

    def _answer(self, request: dict[str, Any]) -> object:
        if request["method"] != "workspace/configuration":
            return None
        return [SETTINGS if item.get("section") == "yaml" else None for item in request["params"]["items"]]


def _at(path: Path, line: int, column: int) -> dict[str, object]:
    return {
        "textDocument": {"uri": path.as_uri()},
        "position": {"line": line - 1, "character": column - 1},
    }


def _diagnostic(item: dict[str, Any]) -> Diagnostic:
    start = item["range"]["start"]
    return Diagnostic(start["line"] + 1, start["character"] + 1, item["message"])


def _proposal(item: Any) -> Proposal:
    said: str | dict[str, str] = item.get("documentation", "")
    edit: dict[str, str] = item.get("textEdit", {})
    text: str = edit.get("newText") or item.get("insertText") or item["label"]
    return Proposal(item["label"], text, said if isinstance(said, str) else said["value"])
