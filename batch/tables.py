"""The tables and views of a batch's results, as SQL."""

VERSION = 2
"""Of the tables, in `PRAGMA user_version`."""

TABLES = """
CREATE TABLE jobs (
    job TEXT PRIMARY KEY,         -- hash over everything that the job runs
    number INTEGER NOT NULL,      -- its place in the plan, from 0
    variant TEXT NOT NULL,        -- what sets it apart from the other recipes of the plan
    mission TEXT NOT NULL,        -- path
    scene TEXT NOT NULL,          -- name or path; empty: the mission's own
    faults TEXT NOT NULL,         -- path; empty: none
    settings TEXT NOT NULL,       -- JSON object
    seed INTEGER NOT NULL,
    recipe TEXT NOT NULL,         -- hash of all that it runs but the seed; recipes/HASH.zip holds it
    status TEXT NOT NULL DEFAULT 'waiting',
                                  -- success, incomplete, failure, timeout, crashed; waiting: not yet run
    message TEXT NOT NULL DEFAULT '',
    digest TEXT NOT NULL DEFAULT '',
    attempts INTEGER NOT NULL DEFAULT 0,  -- times that a worker tried it
    items_total INTEGER, items_sorted INTEGER, items_misplaced INTEGER, items_left INTEGER,
    picks_tried INTEGER, picks_held INTEGER,
    sim_seconds REAL, cpu_seconds REAL, wall_seconds REAL,
    last_tick INTEGER,            -- number of the last tick in the log
    root_cause TEXT NOT NULL DEFAULT '',
    look_at TEXT NOT NULL DEFAULT '',     -- one line on what to look at
    folder TEXT NOT NULL DEFAULT ''       -- of the run with its log, below the batch; empty: not kept
) STRICT;
CREATE TABLE items (              -- true items, as the scorer found them
    job TEXT NOT NULL REFERENCES jobs, item TEXT NOT NULL,
    kind TEXT NOT NULL, form TEXT NOT NULL, colour TEXT NOT NULL,
    x REAL NOT NULL, y REAL NOT NULL,     -- where it lay at the start, m, world
    destination TEXT, bin TEXT,           -- where it belongs, and where it ended
    verdict TEXT NOT NULL,                -- sorted, misplaced, left
    PRIMARY KEY (job, item)
) STRICT;
CREATE TABLE picks (              -- closings of the fingers, as the robot felt them
    job TEXT NOT NULL REFERENCES jobs, time REAL NOT NULL,  -- simulated s
    object TEXT NOT NULL, held INTEGER NOT NULL, node TEXT NOT NULL
) STRICT;
CREATE TABLE failures (
    job TEXT NOT NULL REFERENCES jobs, time REAL NOT NULL,
    node TEXT NOT NULL, cause TEXT NOT NULL, message TEXT NOT NULL, item TEXT NOT NULL,
    fate TEXT NOT NULL,           -- cured, passed_over, branched, ended, open
    handled_by TEXT NOT NULL,     -- handlers that were tried, in order
    seconds_lost REAL             -- simulated s until its fate was decided
) STRICT;
CREATE TABLE plans (              -- requests to the planner
    job TEXT NOT NULL REFERENCES jobs, time REAL NOT NULL,
    request TEXT NOT NULL, planner TEXT NOT NULL, outcome TEXT NOT NULL,
    checks INTEGER NOT NULL, thinking REAL NOT NULL, duration REAL NOT NULL  -- s
) STRICT;
CREATE TABLE timings (            -- simulated s of a job by phase
    job TEXT NOT NULL REFERENCES jobs,
    phase TEXT NOT NULL,          -- observe, think, move, grasp, place, recover, other
    seconds REAL NOT NULL,
    PRIMARY KEY (job, phase)
) STRICT;
CREATE TABLE versions (           -- what a job was run with
    job TEXT NOT NULL REFERENCES jobs, library TEXT NOT NULL, version TEXT NOT NULL,
    PRIMARY KEY (job, library)
) STRICT;
CREATE INDEX failures_by_cause ON failures (cause);
CREATE INDEX picks_by_job ON picks (job);
CREATE INDEX plans_by_job ON plans (job);
CREATE INDEX failures_by_job ON failures (job);

CREATE VIEW success AS            -- how often each recipe reached its goal
    SELECT variant, count(*) AS jobs, sum(status = 'success') AS successes,
           sum(status = 'crashed') AS crashed, avg(sim_seconds) AS mean_sim_seconds
    FROM jobs WHERE status <> 'waiting' GROUP BY variant ORDER BY min(number);
CREATE VIEW picks_an_hour AS      -- objects held in a simulated hour, by job
    SELECT job, variant, seed, picks_held * 3600.0 / sim_seconds AS rate
    FROM jobs WHERE sim_seconds > 0 AND picks_held IS NOT NULL;
CREATE VIEW causes AS             -- why things failed, the most frequent first
    SELECT cause, count(*) AS failures, sum(fate = 'cured') AS cured,
           count(DISTINCT job) AS jobs, sum(seconds_lost) AS seconds_lost
    FROM failures GROUP BY cause ORDER BY count(*) DESC, cause;
CREATE VIEW sorted_by_form AS
    SELECT form, count(*) AS items, sum(verdict = 'sorted') AS sorted FROM items GROUP BY form;
CREATE VIEW sorted_by_colour AS
    SELECT colour, count(*) AS items, sum(verdict = 'sorted') AS sorted FROM items GROUP BY colour;
CREATE VIEW worst AS              -- jobs that missed their goal, the most items missed first
    SELECT seed, variant, status, items_total - items_sorted AS missed, root_cause, look_at, folder
    FROM jobs WHERE status NOT IN ('waiting', 'success') ORDER BY missed DESC, number;
"""
