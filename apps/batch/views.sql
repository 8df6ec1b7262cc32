-- Views on the tables of a batch's results: each begins with its name and the question that it answers.
-- Cells of the table are 0.05 m wide (CELL_SIZE of tables.py); 1.959963984540054 is the 97.5 % quantile of the
-- standard normal distribution.

CREATE VIEW success AS  -- how often did each recipe reach its goal?
SELECT variant, count(*) AS jobs, sum(status = 'success') AS successes,
           sum(status = 'crashed') AS crashed, avg(sim_seconds) AS mean_sim_seconds
    FROM jobs WHERE status <> 'waiting' GROUP BY variant ORDER BY min(number);

CREATE VIEW units_an_hour AS  -- how many items does each job bring to their destination in a simulated hour?
SELECT job, variant, seed, items_sorted * 3600.0 / sim_seconds AS rate
    FROM jobs WHERE sim_seconds > 0 AND items_sorted IS NOT NULL;

CREATE VIEW cycle_time AS  -- where does each recipe spend its time?
WITH held AS (SELECT variant, sum(picks_held) AS picks FROM jobs GROUP BY variant)
    SELECT variant, phase, sum(seconds) AS seconds, sum(seconds) / nullif(picks, 0) AS seconds_a_pick,
           sum(seconds) / sum(sum(seconds)) OVER (PARTITION BY variant) AS share
    FROM timings JOIN jobs USING (job) JOIN held USING (variant)
    GROUP BY variant, phase ORDER BY min(number), sum(seconds) DESC;

CREATE VIEW first_try AS  -- how often does the first grasp at an object hold?
WITH tries AS (
        SELECT job, held, row_number() OVER (PARTITION BY job, object ORDER BY time) AS try FROM picks
    )
    SELECT variant, sum(try = 1) AS objects, sum(try = 1 AND held) AS held_at_first,
           avg(CASE try WHEN 1 THEN held END) AS share, count(*) AS tries
    FROM tries JOIN jobs USING (job) GROUP BY variant ORDER BY min(number);

CREATE VIEW causes AS  -- why do things fail, the most frequent first?
SELECT cause, count(*) AS failures, sum(fate = 'cured') AS cured,
           sum(fate = 'done_instead') AS done_instead, count(DISTINCT job) AS jobs,
           (SELECT sum(seconds) FROM episodes WHERE episodes.cause = failures.cause) AS seconds_lost
    FROM failures GROUP BY cause ORDER BY count(*) DESC, cause;

CREATE VIEW causes_by_recipe AS  -- why does each recipe fail?
SELECT variant, cause, count(*) AS failures, sum(fate = 'cured') AS cured,
           sum(fate = 'done_instead') AS done_instead, count(DISTINCT job) AS jobs,
           (SELECT sum(seconds) FROM episodes JOIN jobs AS j USING (job)
            WHERE j.variant = jobs.variant AND episodes.cause = failures.cause) AS seconds_lost
    FROM failures JOIN jobs USING (job) GROUP BY variant, cause ORDER BY min(number), count(*) DESC;

CREATE VIEW cures AS  -- for each cause of a job, what was tried last against it, and with which success?
SELECT job, cause, handler, count(*) AS seen, sum(ended = 'cured') AS cured,
           sum(ended = 'done_instead') AS done_instead, sum(ended = 'given_up') AS given_up,
           sum(ended = 'unhandled') AS unhandled, sum(ended = 'open') AS open, sum(tries) AS tries,
           sum(CASE ended WHEN 'cured' THEN tries ELSE 0 END) AS tries_cured, sum(seconds) AS seconds
    FROM episodes GROUP BY job, cause, handler;

CREATE VIEW cures_by_recipe AS  -- against which causes does each recipe know a cure?
SELECT variant, cause, handler, sum(seen) AS seen, sum(cured) AS cured,
           sum(done_instead) AS done_instead, sum(given_up) AS given_up, sum(unhandled) AS unhandled,
           sum(open) AS open, sum(tries) AS tries, sum(tries_cured) AS tries_cured, sum(seconds) AS seconds
    FROM cures JOIN jobs USING (job) GROUP BY variant, cause, handler
    ORDER BY min(number), cause, sum(cured) DESC, sum(seen) DESC, handler;

CREATE VIEW cures_by_cause AS  -- how many episodes of each cause are cured, with Wilson's 95 % interval, and what do they cost?
WITH counts AS (
        SELECT cause, sum(seen) AS seen, sum(cured) AS cured, sum(done_instead) AS done_instead,
               sum(unhandled) AS unhandled, sum(seen) - sum(done_instead) AS to_cure,
               sum(tries_cured) * 1.0 / nullif(sum(cured), 0) AS tries_a_cure, sum(seconds) AS seconds,
               count(DISTINCT job) AS jobs
        FROM cures GROUP BY cause
    ), shares AS (
        SELECT *, cured * 1.0 / to_cure AS share,
               1.959963984540054 * 1.959963984540054 / to_cure AS zz FROM counts
    )
    SELECT cause, seen, cured, done_instead, unhandled, share,
           max((share + zz / 2 - 1.959963984540054 * sqrt((share * (1 - share) + zz / 4) / to_cure)) /
           (1 + zz), 0.0) AS low,
           min((share + zz / 2 + 1.959963984540054 * sqrt((share * (1 - share) + zz / 4) / to_cure)) /
           (1 + zz), 1.0) AS high,
           tries_a_cure, seconds, jobs
    FROM shares ORDER BY seconds DESC, seen DESC, cause;

CREATE VIEW planted_seen AS  -- which failure does each kind of injected fault cause first, and is it cured?
SELECT variant, fault, cause, ended, count(*) AS faults, count(DISTINCT job) AS jobs, avg(after) AS after
    FROM planted JOIN jobs USING (job) GROUP BY variant, fault, cause, ended
    ORDER BY min(number), fault, count(*) DESC, cause, ended;

CREATE VIEW failures_by_seed AS  -- which seeds are hard for every recipe?
SELECT seed, count(*) AS jobs, sum(status = 'success') AS successes,
           sum((SELECT count(*) FROM failures WHERE failures.job = jobs.job)) AS failures,
           sum(items_total - items_sorted) AS missed
    FROM jobs WHERE status <> 'waiting' GROUP BY seed ORDER BY missed DESC, failures DESC, seed;

CREATE VIEW sorted_by_form AS  -- which forms are sorted?
SELECT form, count(*) AS items, sum(verdict = 'sorted') AS sorted FROM items
    WHERE verdict <> 'no destination' GROUP BY form;

CREATE VIEW sorted_by_colour AS  -- which colours are sorted?
SELECT colour, count(*) AS items, sum(verdict = 'sorted') AS sorted FROM items
    WHERE verdict <> 'no destination' GROUP BY colour;

CREATE VIEW sorted_by_place AS  -- where on the table are items sorted, in cells of 5 cm?
SELECT (CAST(x / 0.05 + 1e-9 + 1000 AS INTEGER) - 1000) * 0.05 AS x, (CAST(y / 0.05 + 1e-9 + 1000 AS INTEGER) - 1000) * 0.05 AS y,
           count(*) AS items, sum(verdict = 'sorted') AS sorted
    FROM items WHERE verdict <> 'no destination' GROUP BY 1, 2 ORDER BY 1, 2;

CREATE VIEW slowest AS  -- which jobs took the most simulated time for a pick?
SELECT job, seed, variant, status, sim_seconds / picks_held AS seconds_a_pick, sim_seconds, picks_held,
           look_at, folder
    FROM jobs WHERE picks_held > 0 ORDER BY seconds_a_pick DESC, number;

CREATE VIEW worst AS  -- which jobs missed their goal, the most items missed first?
SELECT job, seed, variant, status, items_total - items_sorted AS missed, root_cause, look_at, folder
    FROM jobs WHERE status NOT IN ('waiting', 'success') ORDER BY missed DESC, number;
