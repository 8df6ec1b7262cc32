// Comparison of two recipes, of one batch or of two: which, then what differs by more than chance explains.

import { useState } from "react";

import { call, useCall } from "../connection";
import { JobView, useJob } from "../jobs";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Field } from "../ui/Field";
import { toastError } from "../ui/Toast";
import type { BatchSummary } from "./values";

export function CompareBatches({ ids, onClose }: { ids: string[]; onClose(): void }) {
  const [first, second] = [ids[0]!, ids[1] ?? ids[0]!];
  const [number, setNumber] = useState<number | null>(null);
  const a = useRecipes(first);
  const b = useRecipes(second);
  const [labels, setLabels] = useState<[string | null, string | null]>([null, null]);
  const label = labels[0] ?? a[0] ?? "";
  const other = labels[1] ?? (first === second ? b[1] : undefined) ?? b[0] ?? "";
  const job = useJob(number);
  const same = first === second && label === other;
  const start = () => {
    call<number>("batches.compare", { id: first, other: second, label: a.length > 1 ? label : "", other_label: b.length > 1 ? other : "" }).then(setNumber, toastError);
  };
  return (
    <Dialog title="Compare two recipes" onClose={onClose} wide>
      <div className="compare-choice">
        <Field label={`A: ${first}`}>
          {(attributes) => <select {...attributes} value={label} onChange={(event) => setLabels([event.target.value, labels[1]])}>{a.map((each) => <option key={each}>{each}</option>)}</select>}
        </Field>
        <Field label={`B: ${second}`}>
          {(attributes) => <select {...attributes} value={other} onChange={(event) => setLabels([labels[0], event.target.value])}>{b.map((each) => <option key={each}>{each}</option>)}</select>}
        </Field>
        <Button primary onClick={start} disabled={same || !a.length || !b.length || job?.ended === null} title={same ? "Choose two different recipes" : undefined}>Compare</Button>
      </div>
      {job && <JobView key={job.number} job={job} output />}
    </Dialog>
  );
}

function useRecipes(id: string): string[] {
  const { value } = useCall<BatchSummary>("batches.summary", { id });
  return value?.recipes.map((recipe) => recipe.label) ?? [];
}
