from .control_flow import ChildFlow as ChildFlow, LeafFlow as LeafFlow, NEXT as NEXT, NodeStatus as NodeStatus
from .decorators import Decorator as Decorator
from .description import TreeDefinition as TreeDefinition
from .leaves import ConditionNode as ConditionNode
from .mission import Mission as Mission
from .node import ControlNode as ControlNode, Node as Node
from .ports import (
    In as In,
    Out as Out,
    child as child,
    children as children,
    optional_child as optional_child,
    port as port,
    table as table,
)
from .runner import BehaviourTree as BehaviourTree, build as build
from .skill import (
    ARM as ARM,
    CAMERA as CAMERA,
    Doing as Doing,
    GRIPPER as GRIPPER,
    Skill as Skill,
    Steps as Steps,
)

# for other rooms
from . import (
    control_flow as control_flow,
    data_flow as data_flow,
    mission as mission,
    references as references,
    runner as runner,
)
from .blackboard import Namespace as Namespace
from .control_nodes import (
    NODES as NODES,
    Parallel as Parallel,
    ParallelAll as ParallelAll,
    ParallelNode as ParallelNode,
    PipelineSequence as PipelineSequence,
    ReactiveFallback as ReactiveFallback,
    ReactiveSequence as ReactiveSequence,
    Sequence as Sequence,
    Switch as Switch,
    TryCatch as TryCatch,
    counted as counted,
    is_case as is_case,
)
from .declaration import (
    AUTOREMAP as AUTOREMAP,
    BREAKPOINT as BREAKPOINT,
    COMMON_KEYS as COMMON_KEYS,
    IDENTIFIER as IDENTIFIER,
    Kind as Kind,
    NodeDeclaration as NodeDeclaration,
    POSTCONDITIONS as POSTCONDITIONS,
    PRECONDITIONS as PRECONDITIONS,
    Resource as Resource,
    reserved_names as reserved_names,
)
from .decorators import (
    ForEach as ForEach,
    KeepRunningUntilFailure as KeepRunningUntilFailure,
    RateController as RateController,
    Repeat as Repeat,
    RetryUntilSuccessful as RetryUntilSuccessful,
    Timeout as Timeout,
)
from .description import (
    FILE_MODULE as FILE_MODULE,
    MissionSource as MissionSource,
    documented as documented,
    python_faults as python_faults,
    signature_of as signature_of,
)
from .failure_reports import with_attached as with_attached
from .leaves import AlwaysSuccess as AlwaysSuccess
from .mission import (
    MAIN as MAIN,
    NodeSpec as NodeSpec,
    Plugin as Plugin,
    TreeSpec as TreeSpec,
    bottom_up as bottom_up,
    called_by as called_by,
    check_calls as check_calls,
    reachable as reachable,
)
from .mission_files import (
    FilesOnDisk as FilesOnDisk,
    IN_LIBRARY as IN_LIBRARY,
    LIBRARY as LIBRARY,
    MissionFiles as MissionFiles,
    RecordedFiles as RecordedFiles,
    library_names as library_names,
    library_trees as library_trees,
    name_of as name_of,
    path_of as path_of,
)
from .mission_diagnostics import MissionDiagnostics as MissionDiagnostics
from .port_types import (
    NAMES_IN_FILES as NAMES_IN_FILES,
    Name as Name,
    PortProblem as PortProblem,
    PortType as PortType,
    PortValues as PortValues,
    Range as Range,
    convert_literal as convert_literal,
    show as show,
)
from .ports import (
    NameKind as NameKind,
    PortDeclaration as PortDeclaration,
    REQUIRED as REQUIRED,
    Required as Required,
    SlotDeclaration as SlotDeclaration,
    Takes as Takes,
)
from .run_settings import parameter_value as parameter_value, read_settings as read_settings
from .runtime import Runtime as Runtime, TreeWorld as TreeWorld, Wiring as Wiring, evaluate as evaluate
from .wiring_faults import (
    expression_fault as expression_fault,
    expression_faults as expression_faults,
    unlike_comparisons as unlike_comparisons,
    wiring_faults as wiring_faults,
)
