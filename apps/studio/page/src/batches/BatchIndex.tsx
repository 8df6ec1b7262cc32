// The batches of the folder with their progress, and the plans from which they are made.

import { useState } from "react";

import { useCall, useWatch } from "../connection";
import type { ListedFile } from "../records";
import { go, href } from "../routing";
import type { Place } from "../routing";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { Field } from "../ui/Field";
import { CompareBatches } from "./CompareBatches";
import { ProgressBar } from "./ProgressBar";
import type { BatchRow } from "./values";

export function BatchIndex(_: { place: Place }) {
  const { value, error } = useWatch<BatchRow[]>("batches.index", {});
  const [chosen, setChosen] = useState<string[]>([]);
  const [comparing, setComparing] = useState(false);
  if (error) return <Empty title="The batches cannot be listed"><p>{error.message}</p></Empty>;
  const choose = (id: string) => setChosen(chosen.includes(id) ? chosen.filter((each) => each !== id) : [...chosen, id].slice(-2));
  return (
    <div className="batches">
      <h1>Batches</h1>
      <Plans />
      {value === null && <p className="loading" role="status">Looking for batches …</p>}
      {value?.length === 0 && (
        <Empty title="No batch in this folder yet">
          <p>A batch runs missions with many seeds, scenes, faults and settings, and says how often they reach their goal. Write a plan above, look at its matrix and its cost, and start the batch.</p>
          <p className="muted">In a terminal: <code>picktree batch run --mission MISSION --seeds 0:20</code></p>
        </Empty>
      )}
      {value && value.length > 0 && (
        <section className="card" aria-label="Batches">
          <div className="buttons">
            <Button disabled={chosen.length === 0} onClick={() => setComparing(true)} title="Choose one or two batches below">
              {chosen.length < 2 ? "Compare its recipes …" : "Compare the two …"}
            </Button>
            <span className="muted note">Choose one or two batches to compare.</span>
          </div>
          <ul className="batch-list">
            {value.map((batch) => (
              <li key={batch.id}>
                <input type="checkbox" aria-label={`Compare ${batch.id}`} checked={chosen.includes(batch.id)} onChange={() => choose(batch.id)} />
                <div>
                  <a href={href("batch", batch.id)}><b>{batch.name}</b></a> <span className="muted mono">{batch.id}</span>
                  {batch.problem ? <p role="alert">{batch.problem}</p> : <ProgressBar batch={batch} />}
                </div>
              </li>
            ))}
          </ul>
        </section>
      )}
      {comparing && <CompareBatches ids={chosen} onClose={() => setComparing(false)} />}
    </div>
  );
}

function Plans() {
  const { value } = useCall<ListedFile[]>("files.list", { kind: "plan" });
  const [name, setName] = useState("");
  const path = name.trim() && (/\.ya?ml$/.test(name.trim()) ? name.trim() : `${name.trim()}.yaml`);
  const taken = value?.some((file) => file.path === path);
  return (
    <section className="card" aria-label="Plans">
      <h2>Plans <span className="count">{value?.length ?? 0}</span></h2>
      {value && value.length > 0 && (
        <ul className="plans">
          {value.map((file) => <li key={file.path}><a href={href("plan", file.path)}>{file.path}</a> <span className="muted">{file.name}</span></li>)}
        </ul>
      )}
      <form className="new-plan" onSubmit={(event) => { event.preventDefault(); if (path) go(href("plan", path)); }}>
        <Field label="New plan" hint={taken ? "this plan exists; it will be opened" : "name of its file, as night.yaml"}>
          {(attributes) => <input {...attributes} value={name} onChange={(event) => setName(event.target.value)} />}
        </Field>
        <Button type="submit" disabled={!path}>Write it</Button>
      </form>
    </section>
  );
}
