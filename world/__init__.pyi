from .causes import (
    Cause as Cause,
    Failure as Failure,
    FailureReport as FailureReport,
    all_causes as all_causes,
    control as control,
    feed as feed,
    grasp as grasp,
    insert as insert,
    internal as internal,
    matches as matches,
    perception as perception,
    place as place,
    planning as planning,
    push as push,
    register_cause as register_cause,
    safety as safety,
    tree as tree,
    world as world,
)
from .journal import Journal as Journal
from .planning_scene import BeliefObject as BeliefObject, PlanningScene as PlanningScene
from .protocols import Intrinsics as Intrinsics, RgbdImage as RgbdImage
from .random_streams import RandomStreams as RandomStreams, StreamVariant as StreamVariant
from .shapes import (
    Box as Box,
    ConvexMesh as ConvexMesh,
    Cylinder as Cylinder,
    Shape as Shape,
    Sphere as Sphere,
)
from .values import (
    Array as Array,
    Bounds as Bounds,
    JointState as JointState,
    ObjectId as ObjectId,
    Pose as Pose,
    Quaternion as Quaternion,
    Trajectory as Trajectory,
    Vector3 as Vector3,
    Wrench as Wrench,
)

# for other rooms
from . import (
    causes as causes,
    convex_decomposition as convex_decomposition,
    event_types as event_types,
    heap_geometry as heap_geometry,
    hole_geometry as hole_geometry,
    mesh_reader as mesh_reader,
    planar_geometry as planar_geometry,
    planner_names as planner_names,
    shapes as shapes,
    values as values,
    world_facts as world_facts,
)
from .causes import (
    CauseError as CauseError,
    Evidence as Evidence,
    EvidenceValue as EvidenceValue,
    Family as Family,
    OUR_PREFIXES as OUR_PREFIXES,
    PLUGIN_LINE as PLUGIN_LINE,
    cause_named as cause_named,
    known_causes as known_causes,
    remedy_of as remedy_of,
    restore_causes as restore_causes,
)
from .colours import (
    COLOURS as COLOURS,
    ITEM_COLOURS as ITEM_COLOURS,
    PLAIN_COLOURS as PLAIN_COLOURS,
    Rgb as Rgb,
    TRUTH_COLOUR as TRUTH_COLOUR,
)
from .computing_time import ComputeTimeAccount as ComputeTimeAccount, Stopwatch as Stopwatch
from .journal import (
    Candidate as Candidate,
    Candidates as Candidates,
    EVENT_KINDS as EVENT_KINDS,
    Entry as Entry,
    RecordField as RecordField,
    ImageEntry as ImageEntry,
    JournalEvent as JournalEvent,
    OtherEvent as OtherEvent,
    Plain as Plain,
    Plan as Plan,
    StageCount as StageCount,
    event_fields as event_fields,
    record_fields as record_fields,
)
from .pad_contacts import PadContacts as PadContacts, pad_contacts as pad_contacts, top_heights as top_heights
from .planar_geometry import outline as outline
from .planning_scene import (
    BeliefChange as BeliefChange,
    FALLEN_SIGMA as FALLEN_SIGMA,
    ObstacleBlock as ObstacleBlock,
    SceneSnapshot as SceneSnapshot,
)
from .protocols import (
    GripperCommand as GripperCommand,
    Camera as Camera,
    Clock as Clock,
    Feed as Feed,
    FeedSignals as FeedSignals,
    Gripper as Gripper,
    Hardware as Hardware,
    NoFeed as NoFeed,
    NoImage as NoImage,
    NotRecognised as NotRecognised,
    RecognisedItem as RecognisedItem,
    Recogniser as Recogniser,
    RobotStopped as RobotStopped,
    SensorStamps as SensorStamps,
    WrenchSensor as WrenchSensor,
)
from .quasi_static_pushing import PlanarPushModel as PlanarPushModel
from .record import (
    BlackboardWrite as BlackboardWrite,
    Body as Body,
    FormCount as FormCount,
    ItemCount as ItemCount,
    NodeState as NodeState,
    Tick as Tick,
    Transition as Transition,
    Tree as Tree,
    TreeNode as TreeNode,
    Values as Values,
)
from .shapes import (
    CompoundMesh as CompoundMesh,
    MIN_DIRECTION as MIN_DIRECTION,
    OBSTACLE_VOLUME as OBSTACLE_VOLUME,
    bottom as bottom,
    convex_hull as convex_hull,
    convex_parts as convex_parts,
    corners as corners,
    extents as extents,
    greatest_length as greatest_length,
    half_spaces as half_spaces,
    inside as inside,
    ray_hits as ray_hits,
    ray_span as ray_span,
    scaled as scaled,
    top as top,
)
from .values import (
    GRAVITY as GRAVITY,
    GripperState as GripperState,
    WorkspaceExcess as WorkspaceExcess,
    cross as cross,
    quaternion_product as quaternion_product,
    quintic as quintic,
    rotated as rotated,
    vector3 as vector3,
    workspace_excess as workspace_excess,
)
from .world_facts import facts as facts
