from .errors import (
    Diagnostic as Diagnostic,
    FileError as FileError,
    Mark as Mark,
    PicktreeError as PicktreeError,
)
from .expressions import Expression as Expression

# for other rooms
from . import (
    arithmetic as arithmetic,
    disk_cache as disk_cache,
    expression_syntax as expression_syntax,
    fault_codes as fault_codes,
    file_checks as file_checks,
    file_system as file_system,
    library_parts as library_parts,
    quantities as quantities,
)
from .arithmetic import (
    blas_kernels as blas_kernels,
    departures as departures,
    numpy_kernels as numpy_kernels,
    pin as pin,
    restart as restart,
)
from .errors import (
    CheckedFile as CheckedFile,
    Location as Location,
    MAX_FAULTS as MAX_FAULTS,
    SPOILING_CODES as SPOILING_CODES,
    Severity as Severity,
    too_many as too_many,
    where as where,
)
from .expressions import (
    ANY as ANY,
    Attributes as Attributes,
    BOOL as BOOL,
    FLOAT as FLOAT,
    INT as INT,
    OBJECT as OBJECT,
    PLACE as PLACE,
    TEXT as TEXT,
    UnknownName as UnknownName,
    ValueType as ValueType,
    WORD as WORD,
    check_types as check_types,
    join as join,
    list_of as list_of,
    type_of_value as type_of_value,
    unlike_sides as unlike_sides,
)
from .fault_codes import index as index
from .fault_rendering import Paint as Paint, fault_lines as fault_lines, plain as plain
from .junit import JunitCase as JunitCase, Outcome as Outcome, junit_text as junit_text
from .node_patterns import (
    find_node as find_node,
    find_nodes as find_nodes,
    node_matches as node_matches,
    short_names as short_names,
)
from .quantities import example as example
from .value_wording import (
    MAX_NEAR_NAMES as MAX_NEAR_NAMES,
    describe as describe,
    listed as listed,
    suggest_boolean as suggest_boolean,
    suggest_name as suggest_name,
    suggest_number as suggest_number,
)
from .xml_text import XmlError as XmlError, decode_xml as decode_xml, parse_xml as parse_xml
from .quantity_hints import suggested as suggested
