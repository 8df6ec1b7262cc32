// One batch: its progress, what came of its jobs, and the runs behind each figure.

import { useEffect, useRef, useState } from "react";

import { call, useCall, useWatch } from "../connection";
import { JobView, useJob } from "../jobs";
import { href } from "../routing";
import type { Place } from "../routing";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Empty } from "../ui/Empty";
import { Field } from "../ui/Field";
import { Status } from "../ui/Status";
import { toastError } from "../ui/Toast";
import { counted } from "../ui/words";
import { CompareBatches } from "./CompareBatches";
import { ProgressBar } from "./ProgressBar";
import { Results } from "./Results";
import type { Asked, BatchProgress, BatchSummary, JobBehind } from "./values";

const AGAIN = 10_000; // ms between two summaries while jobs end

export function BatchPage({ place }: { place: Place }) {
  const id = place.rest;
  const { value, error } = useWatch<BatchProgress>("batches.progress", { id });
  if (error && !value) return <Empty title="This batch cannot be opened"><p>{error.message}</p><p><a href={href("batches")}>All batches</a></p></Empty>;
  if (!value) return <p className="loading" role="status">Opening the batch …</p>;
  return <Opened key={id} id={id} batch={value} />;
}

function Opened({ id, batch }: { id: string; batch: BatchProgress }) {
  const [label, setLabel] = useState("");
  const [asked, setAsked] = useState<Asked | null>(null);
  const [comparing, setComparing] = useState(false);
  const [stopping, setStopping] = useState(false);
  const [job, setJob] = useState<number | null>(null);
  const shown = useJob(job);
  const again = usePaced(batch.done, batch.running ? AGAIN : 0);
  const summary = useCall<BatchSummary>("batches.summary", { id }, again);
  useEffect(() => { if (!batch.running) setStopping(false); }, [batch.running]);
  const stop = (now: boolean) => {
    setStopping(true);
    call("batches.stop", { id, now }).catch(toastError);
  };
  const labels = summary.value?.recipes.map((recipe) => recipe.label) ?? [];
  return (
    <div className="batch-page">
      <header className="batch-head">
        <div>
          <h1>{batch.name} <small className="mono">{id}</small></h1>
          <ProgressBar batch={batch} />
        </div>
        <div className="buttons" role="toolbar" aria-label="Batch">
          {batch.running && <Button onClick={() => stop(false)} disabled={stopping} title="Let the running jobs finish, and start no further job">{stopping ? "Finishing …" : "Stop"}</Button>}
          {batch.running && stopping && <Button onClick={() => stop(true)} title="Break off the running jobs; they run again when the batch continues">Stop at once</Button>}
          {!batch.running && batch.done < batch.total && <Button primary onClick={() => call<number>("batches.resume", { id }).then(setJob, toastError)}>Go on</Button>}
          <Button onClick={() => setComparing(true)} disabled={labels.length < 2} title={labels.length < 2 ? "This batch has only one recipe; compare it with another batch in the list of batches" : undefined}>Compare recipes …</Button>
          <Button onClick={() => call<number>("batches.write_report", { id }).then(setJob, toastError)} disabled={!batch.done} title="The results as one file, in reports/">Write the page</Button>
        </div>
      </header>
      {shown && <section className="card"><JobView key={shown.number} job={shown} /></section>}
      <Tiles batch={batch} onAsk={setAsked} />
      {labels.length > 1 && (
        <Field label="Below: the jobs of">
          {(attributes) => <select {...attributes} value={label} onChange={(event) => setLabel(event.target.value)}><option value="">all recipes</option>{labels.map((each) => <option key={each}>{each}</option>)}</select>}
        </Field>
      )}
      {summary.error && batch.done > 0 && <p role="alert">{summary.error.message}</p>}
      {summary.value && batch.done > 0 && <Results summary={summary.value} label={label} onAsk={setAsked} />}
      {batch.done === 0 && <p className="muted">Results appear here as soon as the first job has ended.</p>}
      {asked && <Behind id={id} asked={asked} done={batch.done} onClose={() => setAsked(null)} />}
      {comparing && <CompareBatches ids={[id]} onClose={() => setComparing(false)} />}
    </div>
  );
}

// A value that changes at most once in a while.
function usePaced(value: number, pause: number): number {
  const [paced, setPaced] = useState(value);
  const last = useRef(0);
  useEffect(() => {
    const wait = Math.max(0, last.current + pause - Date.now());
    const timer = setTimeout(() => { last.current = Date.now(); setPaced(value); }, wait);
    return () => clearTimeout(timer);
  }, [value, pause]);
  return paced;
}

const SIGN: Record<string, string> = { success: "✓", waiting: "·", crashed: "†", timeout: "◔", incomplete: "◐" };

function Tiles({ batch, onAsk }: { batch: BatchProgress; onAsk(asked: Asked): void }) {
  return (
    <section className="card" aria-label="Job by job">
      <h2>Job by job</h2>
      <div className="buttons">
        {Object.entries(batch.counts).map(([status, count]) => (
          <Button key={status} disabled={status === "waiting"} onClick={() => onAsk({ what: "status", value: status, label: "", title: `Jobs that ended as ${status}` })}>
            <Status status={status} /> {count}
          </Button>
        ))}
      </div>
      <div className="job-tiles" aria-hidden="true">
        {batch.jobs.map((job) => <i key={job.number} className={`tile ${job.status}`} title={`${job.label}, seed ${job.seed}: ${job.status}`}>{SIGN[job.status] ?? "✗"}</i>)}
      </div>
      {batch.total > batch.jobs.length && <p className="muted">the first {batch.jobs.length} of {batch.total}</p>}
    </section>
  );
}

// The jobs that a bar counts, each with its run.
function Behind({ id, asked, done, onClose }: { id: string; asked: Asked; done: number; onClose(): void }) {
  const { what, value, label } = asked;
  const { value: jobs, error } = useCall<JobBehind[]>("batches.behind", { id, what, value, label }, done);
  const [number, setNumber] = useState<number | null>(null);
  const job = useJob(number);
  return (
    <Dialog title={asked.title} onClose={onClose} wide>
      {error && <p role="alert">{error.message}</p>}
      {job && <JobView key={job.number} job={job} output />}
      {jobs && <p className="muted">{counted(jobs.length, "job")}</p>}
      <ul className="behind" aria-label="Jobs">
        {jobs?.map((each) => (
          <li key={each.job}>
            <p>
              <Status status={each.status} /> <b>seed {each.seed}</b> {each.label}{" "}
              <span className="muted">{[each.items === null ? "" : `${each.sorted} of ${each.items} sorted`, each.seconds === null ? "" : `${each.seconds.toFixed(1)} s`, each.look_at].filter(Boolean).join(" · ")}</span>
            </p>
            {each.run
              ? <a className="button" href={href("run", each.run)}>Open the run</a>
              : <Button onClick={() => call<number>("batches.rerun", { id, job: each.job }).then(setNumber, toastError)} title="The job's log was not kept: run the job again and compare">Run again</Button>}
          </li>
        ))}
      </ul>
    </Dialog>
  );
}
