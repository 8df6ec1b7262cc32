from .explanation import FailureStory as FailureStory
from .run_explanation import explain as explain

# for other rooms
from .case import scene_of as scene_of
from .explained_runs import (
    explain_runs as explain_runs,
    holds_runs as holds_runs,
    runs_json_text as runs_json_text,
    runs_text as runs_text,
)
from .explanation import (
    ExplainedOutcome as ExplainedOutcome,
    Explanation as Explanation,
    ItemStory as ItemStory,
    RootCause as RootCause,
)
from .explanation_text import (
    cause_account as cause_account,
    to_json_text as to_json_text,
    to_text as to_text,
)
from .removals import (
    Experiment as Experiment,
    Fact as Fact,
    GOAL as GOAL,
    Removal as Removal,
    experiment as experiment,
    failure_fact as failure_fact,
)
from .true_world import true_scenes as true_scenes, true_states as true_states
