// Comparison of a run with another one: which, then where they part and what that changed.

import { useState } from "react";

import { call, useWatch } from "../connection";
import { JobView, useJob } from "../jobs";
import { Dialog } from "../ui/Dialog";
import { Field } from "../ui/Field";
import { Status } from "../ui/Status";
import { toastError } from "../ui/Toast";
import type { OpenedRun } from "./RunPage";
import { done, when } from "./rows";
import type { IndexEvent } from "./rows";

const SHOWN = 50;

export function Compare({ run, onClose }: { run: OpenedRun; onClose(): void }) {
  const [text, setText] = useState(run.mission);
  const [number, setNumber] = useState<number | null>(null);
  const { value } = useWatch<IndexEvent>("runs.index", { text, count: SHOWN });
  const job = useJob(number);
  const others = (value?.rows ?? []).filter((row) => row.id !== run.id);
  const start = (other: string) => {
    call<number>("runs.diff", { id: run.id, other }).then(setNumber, toastError);
  };
  return (
    <Dialog title="Compare with another run" onClose={onClose} wide>
      {job && <JobView key={job.number} job={job} output />}
      <Field label="The other run">
        {(attributes) => <input {...attributes} type="search" value={text} onChange={(event) => setText(event.target.value)} />}
      </Field>
      {value?.complete && others.length === 0 && <p className="muted">No other run has these words. A what-if makes one to compare with.</p>}
      <ul className="run-choice" aria-label="Runs">
        {others.map((row) => (
          <li key={row.id}>
            <button onClick={() => start(row.id)}>
              <Status status={row.status} /> <b>{row.mission || row.folder}</b>
              <span className="muted">{[row.seed === null ? "" : `seed ${row.seed}`, done(row), row.cause, when(row), row.folder].filter(Boolean).join(" · ")}</span>
            </button>
          </li>
        ))}
      </ul>
    </Dialog>
  );
}
