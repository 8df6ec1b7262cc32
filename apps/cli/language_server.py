"""Language server: the protocol around what `authoring/editor` answers, on pygls."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path
from pygls.workspace import TextDocument

from picktree.authoring import check_mission, mission_faults
from picktree.authoring.editor import (
    DocumentFault,
    DocumentSymbol,
    Edit,
    FileSpan,
    OpenFile,
    Place,
    Proposal,
    ProposalKind,
    Span,
    SymbolKind,
    document_faults,
)
from picktree.authoring.schema import Schema
from picktree.files import Diagnostic, Mark, PicktreeError, fault_codes, file_checks
from picktree.files.yaml import Document, file_text
from picktree.trees import FilesOnDisk
from picktree.trees.loading import NodeRegistry

from .file_schemas import CHECKS, file_schema

CHECK_DELAY: Final = 0.1
"""Time without a further edit after which a text is checked, s."""
IDLE: Final = 0.3
"""Time after the errors of a large text until it is checked with the linter, s."""
LARGE: Final = 15_000
"""Number of characters from which the errors of a mission are shown before the linter has looked at it."""
_SUFFIXES: Final = (".yaml", ".yml")
_MAX_SEARCHED_FILES: Final = 500
"""Number of files of a folder in which uses of a sub-tree are looked for."""
_SOURCE: Final = "picktree"
_KINDS: Mapping[ProposalKind, types.CompletionItemKind] = {
    "node": types.CompletionItemKind.Class,
    "tree": types.CompletionItemKind.Function,
    "key": types.CompletionItemKind.Property,
    "value": types.CompletionItemKind.Value,
    "blackboard": types.CompletionItemKind.Variable,
    "skeleton": types.CompletionItemKind.Snippet,
}
_SYMBOLS: Mapping[SymbolKind, types.SymbolKind] = {
    "tree": types.SymbolKind.Function,
    "node": types.SymbolKind.Class,
    "key": types.SymbolKind.Property,
}
_Severity = types.DiagnosticSeverity


def schema_of(kind: str) -> Schema:
    """Return the JSON Schema of a kind of file other than missions."""
    match kind:
        case "scene" | "robot" | "faults" | "cases" | "plan":
            return file_schema(kind)
        case _:
            return {}


class Session:
    """Session with one editor: its open files, and the checks that are due."""

    def __init__(self, server: LanguageServer) -> None:
        self._server = server
        self._registry = NodeRegistry()
        self._due: dict[str, asyncio.TimerHandle] = {}
        self._warnings: dict[str, list[types.Diagnostic]] = {}
        """Warnings of the last whole check, by file."""

    def document(self, uri: str) -> TextDocument:
        return self._server.workspace.get_text_document(uri)

    def file(self, uri: str) -> OpenFile:
        return OpenFile(_path(uri), self.document(uri).source, self._registry, schema_of, self._unsaved())

    def missions_with(self, word: str, folder: Path) -> list[OpenFile]:
        """Return the open missions, and those in a folder, whose texts contain a word."""
        texts = {path: text for path, text in self._unsaved().items() if path.suffix in _SUFFIXES}
        for path in sorted(folder.glob("*.y*ml"))[:_MAX_SEARCHED_FILES]:
            if path not in texts and path.suffix in _SUFFIXES:
                with suppress(PicktreeError):
                    texts[path] = file_text.read_text(path)
        return [
            OpenFile(path, text, self._registry, schema_of, self._unsaved())
            for path, text in texts.items()
            if word in text
        ]

    def _unsaved(self) -> dict[Path, str]:
        """Return the texts of all open files."""
        return {_path(uri): each.source for uri, each in self._server.workspace.text_documents.items()}

    # Places of the protocol count in units of the client, ours in code points.

    def place(self, uri: str, position: types.Position) -> Place:
        document = self.document(uri)
        if position.line >= len(document.lines):  # the empty line behind the last line's end is none of them
            return Place(position.line, position.character)
        found = document.position_codec.position_from_client_units(document.lines, position)
        return Place(found.line, found.character)

    def range(self, uri: str, span: Span, lines: Sequence[str] | None = None) -> types.Range:
        """Return a span for the client. `lines`: those of the document, where they were split already."""
        document = self.document(uri)
        split = document.lines if lines is None else lines

        def position(place: Place) -> types.Position:
            before = split[place.line][: place.character] if place.line < len(split) else ""
            return types.Position(place.line, document.position_codec.client_num_units(before))

        return types.Range(position(span.start), position(span.end))

    def range_in(self, part: FileSpan) -> types.Range:
        """Return a span of any file for the client; a file that is not open is read."""
        return self.range(_uri(str(part.path)), part.span)

    def edit(self, uri: str, edit: Edit) -> types.TextEdit:
        return types.TextEdit(self.range(uri, edit.span), edit.text)

    # Diagnostics.

    def changed(self, uri: str) -> None:
        """Schedule a check of a file and of the open files that name it: it may be a part of them."""
        self.check_soon(uri)
        name = _path(uri).name
        for other, document in self._server.workspace.text_documents.items():
            if other != uri and name in document.source:
                self.check_soon(other)

    def check_soon(self, uri: str) -> None:
        large = len(self.document(uri).source) > LARGE
        self._later(CHECK_DELAY, self._check_for_errors if large else self.check, uri)

    def _later(self, pause: float, action: Callable[[str], None], uri: str) -> None:
        self._forget(uri)
        self._due[uri] = asyncio.get_running_loop().call_later(pause, action, uri)

    def _check_for_errors(self, uri: str) -> None:
        """Show the errors with the former warnings, and run the linter after a pause in the edits."""
        found = [each for each in self._found(uri, linted=False) if each.severity == _Severity.Error]
        self._publish(uri, found if found else self._warnings.get(uri, []))
        self._later(IDLE, self.check, uri)

    def check(self, uri: str) -> None:
        self._forget(uri)
        found = self._found(uri)
        self._warnings[uri] = [each for each in found if each.severity == _Severity.Warning]
        self._publish(uri, found)

    def _found(self, uri: str, *, linted: bool = True) -> list[types.Diagnostic]:
        text = self.document(uri).source

        def mission(document: Document) -> Iterable[Diagnostic]:
            files = FilesOnDisk(document.path.parent, self._unsaved())
            if linted:
                return mission_faults(document, files)
            return check_mission(document, linted=False, files=files).faults

        checks: Mapping[str, file_checks.Check] = {**CHECKS, "mission": mission}
        lines = text.split("\n")
        return [self._diagnostic(uri, each, lines) for each in document_faults(_path(uri), text, checks)]

    def close(self, uri: str) -> None:
        self._forget(uri)
        self._warnings.pop(uri, None)
        self._publish(uri, [])

    def _publish(self, uri: str, found: list[types.Diagnostic]) -> None:
        version = self.document(uri).version
        self._server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, found, version))

    def _forget(self, uri: str) -> None:
        due = self._due.pop(uri, None)
        if due is not None:
            due.cancel()

    def _diagnostic(self, uri: str, found: DocumentFault, lines: list[str]) -> types.Diagnostic:
        fault = found.fault
        shown = types.Diagnostic(
            self.range(uri, found.span, lines),
            found.message,
            _Severity.Error if fault.severity == "error" else _Severity.Warning,
            fault.code,
            source=_SOURCE,
        )
        if fault.code:
            shown.code_description = types.CodeDescription(_uri(str(fault_codes.page_file(fault.code))))
        if found.elsewhere:
            at = types.Location(_uri(fault.mark.file), _start(fault.mark))
            message = found.message.removeprefix(f"{fault.mark}: ")
            shown.related_information = [types.DiagnosticRelatedInformation(at, message)]
        if found.fix is not None:
            place = self.range(uri, found.fix.span, lines)
            shown.data = {
                "text": found.fix.text,
                "range": [place.start.line, place.start.character, place.end.line, place.end.character],
            }
        return shown


def _path(uri: str) -> Path:
    return Path(to_fs_path(uri) or uri.rpartition("/")[2] or "untitled")


def _uri(file: str) -> str:
    return from_fs_path(str(Path(file).absolute())) or file


def _start(mark: Mark) -> types.Range:
    at = types.Position(max(mark.line, 1) - 1, max(mark.column, 1) - 1)
    return types.Range(at, at)


def serve(source: BinaryIO, target: BinaryIO, version: str) -> None:
    """Serve one editor until it ends the session."""
    server = LanguageServer(_SOURCE, version)
    session = Session(server)
    _offer_checks(server, session)
    _offer_completion(server, session)
    _offer_names(server, session)
    # What the imports made stays: the collector need not look at it after every edit.
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    server.start_io(source, target)


def _offer_checks(server: LanguageServer, session: Session) -> None:
    """Register the checks of edited documents, and their quick fixes."""

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(params: types.DidOpenTextDocumentParams) -> None:
        session.check(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(params: types.DidChangeTextDocumentParams) -> None:
        session.changed(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: types.DidSaveTextDocumentParams) -> None:
        # A saved file may be part of another one.
        for uri in server.workspace.text_documents:
            session.check_soon(uri)

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        session.close(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions([types.CodeActionKind.QuickFix]))
    def fixes(params: types.CodeActionParams) -> list[types.CodeAction]:
        uri = params.text_document.uri
        return [action for each in params.context.diagnostics if (action := _action(uri, each))]

    del opened, changed, saved, closed, fixes


def _offer_completion(server: LanguageServer, session: Session) -> None:
    """Register completion and hover."""

    @server.feature(
        types.TEXT_DOCUMENT_COMPLETION,
        types.CompletionOptions(trigger_characters=["{", "[", '"', " ", ":", "."], resolve_provider=False),
    )
    def complete(params: types.CompletionParams) -> types.CompletionList:
        uri = params.text_document.uri
        file = session.file(uri)
        answer = file.complete(session.place(uri, params.position))
        if answer is None:
            return types.CompletionList(False, [])
        span, found = answer
        place = session.range(uri, span)
        includes = {each.include: file.include_edit(each.include) for each in found if each.include}
        items = [_item(each, place, rank) for rank, each in enumerate(found)]
        for item, each in zip(items, found, strict=True):
            edit = includes.get(each.include)
            if edit is not None:
                item.additional_text_edits = [session.edit(uri, edit)]
        return types.CompletionList(False, items)

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def hover(params: types.HoverParams) -> types.Hover | None:
        uri = params.text_document.uri
        found = session.file(uri).hover(session.place(uri, params.position))
        if found is None:
            return None
        span, text = found
        return types.Hover(types.MarkupContent(types.MarkupKind.Markdown, text), session.range(uri, span))

    del complete, hover


def _offer_names(server: LanguageServer, session: Session) -> None:
    """Register definition, references, symbols and rename."""

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    def definition(params: types.DefinitionParams) -> types.Location | None:
        uri = params.text_document.uri
        mark = session.file(uri).definition(session.place(uri, params.position))
        return None if mark is None else types.Location(_uri(mark.file), _start(mark))

    @server.feature(types.TEXT_DOCUMENT_REFERENCES)
    def references(params: types.ReferenceParams) -> list[types.Location]:
        uri = params.text_document.uri
        file, place = session.file(uri), session.place(uri, params.position)
        word = file.word_at(place)
        others = session.missions_with(word, _path(uri).parent) if word.isidentifier() else []
        declaration = params.context.include_declaration
        found = file.references(place, declaration=declaration, others=others)
        return [types.Location(_uri(str(each.path)), session.range_in(each)) for each in found]

    @server.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare(params: types.PrepareRenameParams) -> types.Range | None:
        uri = params.text_document.uri
        span = session.file(uri).renamed_span(session.place(uri, params.position))
        return None if span is None else session.range(uri, span)

    @server.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def rename(params: types.RenameParams) -> types.WorkspaceEdit:
        uri = params.text_document.uri
        try:
            edits = session.file(uri).rename(session.place(uri, params.position), params.new_name)
        except PicktreeError as error:
            raise JsonRpcInvalidParams(str(error)) from None
        return types.WorkspaceEdit({uri: [session.edit(uri, edit) for edit in edits]})

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def outline(params: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        uri = params.text_document.uri
        lines = session.document(uri).source.split("\n")

        def shown(symbol: DocumentSymbol) -> types.DocumentSymbol:
            return types.DocumentSymbol(
                symbol.name,
                _SYMBOLS[symbol.kind],
                session.range(uri, symbol.whole, lines),
                session.range(uri, symbol.word, lines),
                detail=symbol.detail or None,
                children=[shown(each) for each in symbol.children],
            )

        return [shown(each) for each in session.file(uri).symbols()]

    del definition, references, prepare, rename, outline


def _action(uri: str, found: types.Diagnostic) -> types.CodeAction | None:
    match found.data:
        case {"text": str(text), "range": [int(a), int(b), int(c), int(d)]}:
            edit = types.TextEdit(types.Range(types.Position(a, b), types.Position(c, d)), text)
        case _:
            return None
    return types.CodeAction(
        f"Write {text}",
        types.CodeActionKind.QuickFix,
        [found],
        is_preferred=True,
        edit=types.WorkspaceEdit({uri: [edit]}),
    )


def _item(proposal: Proposal, place: types.Range, rank: int) -> types.CompletionItem:
    return types.CompletionItem(
        proposal.label,
        kind=_KINDS[proposal.kind],
        detail=proposal.include or None,
        documentation=types.MarkupContent(types.MarkupKind.Markdown, proposal.doc) if proposal.doc else None,
        filter_text=proposal.label,
        sort_text=f"{rank:04}",
        insert_text_format=types.InsertTextFormat.Snippet,
        insert_text_mode=types.InsertTextMode.AdjustIndentation,
        text_edit=types.TextEdit(place, proposal.snippet),
    )
