// How far a batch is: a bar, and the same in words.

import type { BatchRow } from "./values";
import { duration } from "./values";
import { counted } from "../ui/words";

export function ProgressBar({ batch }: { batch: BatchRow }) {
  const { total = 0, done = 0, success = 0 } = batch;
  const state = batch.running ? "running" : done === total && total > 0 ? "done" : "stopped";
  const parts = [
    `${done} of ${counted(total, "job")}`,
    done ? `${success} reached the goal` : "",
    batch.counts?.crashed ? `${batch.counts.crashed} crashed` : "",
    batch.cpu_seconds_a_job ? `${batch.cpu_seconds_a_job.toFixed(1)} s CPU a job` : "",
    state !== "done" && batch.cpu_seconds_a_job ? `${duration(batch.cpu_seconds_a_job * (total - done))} CPU to do` : "",
  ];
  return (
    <div className="batch-progress" data-state={state}>
      <div className="bar" role="progressbar" aria-label="Jobs done" aria-valuemin={0} aria-valuemax={total} aria-valuenow={done}>
        <span className="good" style={{ width: `${total ? (100 * success) / total : 0}%` }} />
        <span className="bad" style={{ width: `${total ? (100 * (done - success)) / total : 0}%` }} />
      </div>
      <p><span className={`outcome ${state}`} role="status">{state}</span> <span className="muted">{parts.filter(Boolean).join(" · ")}</span></p>
    </div>
  );
}
