from .document import Document as Document, read_document as read_document

# for other rooms
from . import file_models as file_models, file_text as file_text, syntax_faults as syntax_faults
from .document import FORMAT as FORMAT, KINDS as KINDS, merge_patch as merge_patch
from .document_checker import DocumentChecker as DocumentChecker
from .reader import (
    Value as Value,
    YamlNode as YamlNode,
    YamlReadResult as YamlReadResult,
    read as read,
    resolve as resolve,
)
from .writer import (
    MAX_LINE_LENGTH as MAX_LINE_LENGTH,
    MarkedValue as MarkedValue,
    Scalar as Scalar,
    from_value as from_value,
    mission_text as mission_text,
    scalar_text as scalar_text,
    value_text as value_text,
)
