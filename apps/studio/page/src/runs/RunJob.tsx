// The job that was started from a run, with its progress and its result.

import { JobView, useJob } from "../jobs";

export function RunJob({ number, onClose }: { number: number; onClose(): void }) {
  const job = useJob(number);
  if (!job) return null;
  return (
    <section className="card run-job" aria-label={job.title}>
      <JobView job={job} output />
      <button className="icon" aria-label="Close" title="Close; the job continues" onClick={onClose}>×</button>
    </section>
  );
}
