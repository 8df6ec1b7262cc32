// Jobs: commands that the page has started, with their progress; each can be stopped, and its result opened.

import { useEffect, useState, useSyncExternalStore } from "react";

import { call, watch } from "./connection";
import { Button } from "./ui/Button";
import { Dialog } from "./ui/Dialog";
import { Icon } from "./ui/Icon";
import { toast, toastError } from "./ui/Toast";

export interface Job {
  number: number;
  title: string;
  command: string;
  result: string;
  began: number;
  ended: number | null;
  outcome: "running" | "done" | "no" | "failed" | "stopped";
  progress: string;
}

const OUTCOMES: Record<Job["outcome"], string> = {
  running: "running",
  done: "done",
  no: "done: the answer is no",
  failed: "failed",
  stopped: "stopped",
};

let jobs: Job[] = [];
let stop: (() => void) | null = null;
const listeners = new Set<() => void>();
const opened = new Set<number>();

function start(): void {
  stop ??= watch<Job[]>("jobs.watch", {}, (now) => {
    for (const job of now) {
      if (job.ended !== null && jobs.some((before) => before.number === job.number && before.ended === null)) told(job);
    }
    jobs = now;
    for (const listener of listeners) listener();
  });
}

function told(job: Job): void {
  if (opened.has(job.number)) return;
  const text = `${job.title}: ${OUTCOMES[job.outcome]}`;
  const open = job.result && job.outcome !== "failed" ? { href: job.result, text: "Open" } : undefined;
  toast(text, job.outcome === "failed" ? "failure" : "success", open);
}

export function useJobs(): Job[] {
  return useSyncExternalStore(
    (listener) => {
      start();
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => jobs,
  );
}

// A job by its number, once it is known.
export function useJob(number: number | null): Job | null {
  const all = useJobs();
  return all.find((job) => job.number === number) ?? null;
}

export function JobsButton() {
  const all = useJobs();
  const [open, setOpen] = useState(false);
  const running = all.filter((job) => job.ended === null).length;
  if (!all.length) return null;
  return (
    <>
      <button className="jobs" onClick={() => setOpen(true)} aria-label={`Jobs: ${running} running`}>
        {running ? <span className="spinner" aria-hidden="true" /> : <Icon name="done" />}
        <span>{running ? `${running} running` : "Jobs"}</span>
      </button>
      {open && (
        <Dialog title="Jobs" onClose={() => setOpen(false)}>
          <ul className="job-list">
            {all.map((job) => (
              <li key={job.number}><JobView job={job} /></li>
            ))}
          </ul>
        </Dialog>
      )}
    </>
  );
}

// One job: what it does, how far it is, what it wrote.
export function JobView({ job, output = false }: { job: Job; output?: boolean }) {
  const [text, setText] = useState<string | null>(null);
  const [shown, setShown] = useState(output);
  useEffect(() => {
    if (!shown) return;
    let wanted = true;
    call<string>("jobs.output", { number: job.number }).then((now) => wanted && setText(now), () => undefined);
    return () => { wanted = false; };
  }, [shown, job.progress, job.ended, job.number]);
  useEffect(() => {
    if (!output) return;
    opened.add(job.number);
    return () => { opened.delete(job.number); };
  }, [output, job.number]);
  const seconds = Math.max(0, (job.ended ?? Date.now() / 1000) - job.began);
  return (
    <div className="job" data-outcome={job.outcome}>
      <div className="job-line">
        {job.ended === null && <span className="spinner" aria-hidden="true" />}
        <b>{job.title}</b>
        <span className={`outcome ${job.outcome}`} role="status">{OUTCOMES[job.outcome]}</span>
        <span className="muted">{seconds.toFixed(0)} s</span>
        <span className="space" />
        {job.ended === null && <Button onClick={() => void call("jobs.stop", { number: job.number }).catch(toastError)}>Stop</Button>}
        {job.ended !== null && job.result && job.outcome !== "failed" && <OpenResult job={job} />}
        {!output && <Button onClick={() => setShown(!shown)} expanded={shown}>Output</Button>}
      </div>
      {job.ended === null && job.progress && <p className="progress">{job.progress}</p>}
      {shown && <pre tabIndex={0} aria-label={`Output of ${job.title}`}>{text ?? "…"}</pre>}
      {shown && <p className="muted mono command">{job.command}</p>}
    </div>
  );
}

function OpenResult({ job }: { job: Job }) {
  const own = job.result.startsWith("#");
  return <a className="button" href={job.result} target={own ? undefined : "_blank"} rel="noreferrer">Open</a>;
}
