# for other rooms
from . import mission_outline as mission_outline, node_edits as node_edits
from .completion import Proposal as Proposal, ProposalKind as ProposalKind
from .cursor import Place as Place, Span as Span, read_repaired as read_repaired
from .diagnostics import DocumentFault as DocumentFault, document_faults as document_faults
from .mission_outline import outline as outline
from .navigation import Edit as Edit
from .open_file import FileSpan as FileSpan, OpenFile as OpenFile
from .symbols import DocumentSymbol as DocumentSymbol, SymbolKind as SymbolKind
from .syntax import NotEditable as NotEditable, Source as Source, Syntax as Syntax, source_of as source_of
from .text_edits import (
    TextChange as TextChange,
    changes as changes,
    replace_value as replace_value,
    scalar as scalar,
)
