from .run_log import RunLog as RunLog
from .run_result import RunResult as RunResult

# for other rooms
from . import (
    arithmetic_record as arithmetic_record,
    binary_gltf as binary_gltf,
    episode_counts as episode_counts,
    item_episodes as item_episodes,
    log_files as log_files,
    log_records as log_records,
    node_visits as node_visits,
    run_index as run_index,
    series as series,
    topics as topics,
    triangle_meshes as triangle_meshes,
)
from .event_records import BeliefEvent as BeliefEvent, ImageEvent as ImageEvent, event_record as event_record
from .log_records import encode as encode
from .operator_figures import (
    ACTIVITIES as ACTIVITIES,
    ACTIVITY_TEXTS as ACTIVITY_TEXTS,
    Activity as Activity,
    Assist as Assist,
    CellMotion as CellMotion,
    ESTIMATES as ESTIMATES,
    Estimate as Estimate,
    FigureCounter as FigureCounter,
    FigureCounts as FigureCounts,
    OperatorFigures as OperatorFigures,
    TimeToDone as TimeToDone,
    duration_text as duration_text,
)
from .optional_libraries import (
    PandasTable as PandasTable,
    install_command as install_command,
    optional_import as optional_import,
)
from .rates import (
    CONFIDENCE as CONFIDENCE,
    Interval as Interval,
    Rate as Rate,
    poisson_interval as poisson_interval,
    rate as rate,
)
from .run_account import (
    CureAttempt as CureAttempt,
    Episodes as Episodes,
    Failure as Failure,
    FailureLink as FailureLink,
    RunAccount as RunAccount,
    account_of as account_of,
    fixed_of as fixed_of,
    motions_of as motions_of,
)
from .run_index import line as line
from .run_log import (
    CameraImage as CameraImage,
    Gap as Gap,
    Stamped as Stamped,
    lacking_topics as lacking_topics,
)
from .run_record import RunRecord as RunRecord
from .run_result import (
    CrushedItem as CrushedItem,
    FeedCount as FeedCount,
    HoleItem as HoleItem,
    PickCount as PickCount,
    RunStatus as RunStatus,
    WallSeconds as WallSeconds,
)
from .topics import (
    Digest as Digest,
    FIXED as FIXED,
    Topic as Topic,
    is_simulated as is_simulated,
    message_class as message_class,
)
