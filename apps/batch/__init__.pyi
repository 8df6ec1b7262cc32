from .batch import Batch as Batch
from .executor import Executor as Executor
from .local_executor import LocalExecutor as LocalExecutor
from .plan import BatchPlan as BatchPlan
from .ray_executor import RayExecutor as RayExecutor
from .store import Store as Store

# for other rooms
from .batch import RecordedJob as RecordedJob
from .comparison import (
    RecipeComparison as RecipeComparison,
    compare_recipes as compare_recipes,
    json_text_of as json_text_of,
    read_recipe as read_recipe,
    text_of as text_of,
    with_divergences as with_divergences,
)
from .cost_forecast import forecast as forecast, recorded_batches as recorded_batches
from .job_process import die_with_parent as die_with_parent, exit_code_words as exit_code_words
from .local_executor import without_main as without_main
from .plan import (
    Job as Job,
    Keep as Keep,
    check_plan as check_plan,
    load_plan as load_plan,
    plan_of as plan_of,
    plan_schema as plan_schema,
)
from .report import to_junit as to_junit, write_report as write_report
from .rerun import rerun_job as rerun_job
from .store import (
    QueryResult as QueryResult,
    RESULTS_FILE as RESULTS_FILE,
    dropped_logs as dropped_logs,
    export as export,
    find_run as find_run,
)
from .summary import BatchSummary as BatchSummary, summarise as summarise
from .tables import JobRow as JobRow
