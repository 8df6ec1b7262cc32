// A plan as text and as a form, its matrix and what it will cost; it is started from here.

import { useEffect, useRef, useState } from "react";

import { call } from "../connection";
import type { CallError, Fault } from "../connection";
import type { BatchForecast, TextFile } from "../records";
import { go, href } from "../routing";
import type { Place } from "../routing";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { Field } from "../ui/Field";
import { toast, toastError } from "../ui/Toast";
import { YamlEditor } from "../ui/YamlEditor";
import { counted } from "../ui/words";
import { PlanForm } from "./PlanForm";
import type { FormValues } from "./PlanForm";
import { duration } from "./values";

type PlanText = TextFile & { draft?: string | null };
type Forecast = BatchForecast & { jobs: number; cpu_seconds: number | null; wall_seconds: number | null };

interface Checked {
  faults: Fault[];
  forecast?: Forecast;
}

const NEW_PLAN = "picktree: 1\nkind: plan\n# Each of these missions runs with everything that is listed below.\nmissions: []\nseeds: 0:8\nbackend: physics\n";
const PAUSE = 500; // ms after the last key until the text is kept and checked
const SHOWN = 60;

export function PlanPage({ place }: { place: Place }) {
  const path = place.rest;
  const [file, setFile] = useState<PlanText | null>(null);
  const [error, setError] = useState("");
  useEffect(() => {
    let wanted = true;
    const isNew = () => call<string | null>("files.drafted", { path }).then((draft) => ({ path, text: "", version: "", draft: draft ?? NEW_PLAN }));
    call<PlanText>("files.read", { path }).catch((told: CallError) => (told.message.includes("no such file") ? isNew() : Promise.reject(told)))
      .then((found) => wanted && setFile(found), (told: CallError) => wanted && setError(told.message));
    return () => { wanted = false; };
  }, [path]);
  if (error) return <Empty title="This plan cannot be opened"><p>{error}</p><p><a href={href("batches")}>All batches</a></p></Empty>;
  if (!file) return <p className="loading" role="status">Opening the plan …</p>;
  return <Opened key={path} path={path} file={file} />;
}

function Opened({ path, file }: { path: string; file: PlanText }) {
  const [saved, setSaved] = useState(file);
  const [text, setText] = useState(file.draft ?? file.text);
  const [checked, setChecked] = useState<Checked | null>(null);
  const [form, setForm] = useState<FormValues | null>(null);
  const [workers, setWorkers] = useState("");
  const [busy, setBusy] = useState(false);
  const now = useRef(text);
  const checking = useRef<Promise<unknown>>(Promise.resolve());
  now.current = text;
  const number = Number(workers) || null;

  useEffect(() => {
    let wanted = true;
    setChecked(null);
    call<FormValues>("plans.form", { text }).then((values) => wanted && setForm(values), () => wanted && setForm(null));
    const timer = setTimeout(() => {
      call("files.draft", { path, text: text === saved.text ? null : text }, true).catch(toastError);
      // One check at a time: a text that has changed meanwhile is not checked.
      checking.current = checking.current.then(() => (wanted ? call<Checked>("plans.check", { path, text, workers: number }) : null))
        .then((found) => { if (found && wanted) setChecked(found); }, (error) => { if (wanted) toastError(error); });
    }, PAUSE);
    return () => { wanted = false; clearTimeout(timer); };
  }, [path, text, number, saved.text]);

  const change = (key: string, value: unknown) => {
    call<string>("plans.change", { text: now.current, key, value }).then(setText, toastError);
  };
  const save = async () => {
    const written = await call<PlanText>("files.write", { path, text: now.current, version: saved.version || null });
    setSaved(written);
  };
  const start = async () => {
    setBusy(true);
    try {
      if (now.current !== saved.text) await save();
      const begun = await call<{ id: string }>("plans.start", { path, workers: number });
      go(href("batch", begun.id));
    } catch (error) {
      toastError(error);
      setBusy(false);
    }
  };
  const errors = checked?.faults.filter((fault) => fault.severity === "error") ?? [];
  const forecast = checked?.forecast;
  return (
    <div className="plan-page">
      <header className="plan-head">
        <h1>{path} {text !== saved.text && <small>not saved</small>}</h1>
        <div className="buttons">
          <Field label="Workers" hideLabel>
            {(attributes) => <input {...attributes} inputMode="numeric" className="workers" placeholder="workers: a core each" value={workers} onChange={(event) => setWorkers(event.target.value.replace(/\D/g, ""))} />}
          </Field>
          <Button onClick={() => void save().then(() => toast("Saved", "success"), toastError)} disabled={text === saved.text}>Save</Button>
          <Button primary onClick={() => void start()} disabled={!forecast || busy} title={forecast ? "Save the plan and run it" : "Mend the plan's faults first"}>Start {forecast ? counted(forecast.jobs, "job") : ""}</Button>
        </div>
      </header>
      <div className="plan-panes">
        <section className="plan-text" aria-label="Text"><YamlEditor label="Plan" text={text} onChange={setText} /></section>
        <section className="plan-side" aria-label="Form">
          {form ? <PlanForm path={path} values={form} onChange={change} /> : <p className="muted">The form needs a text that is YAML.</p>}
          <div className="plan-result" aria-live="polite">
            {!checked && <p className="muted">Checking …</p>}
            {errors.length > 0 && (
              <ul className="plan-faults" aria-label="Faults">
                {errors.map((fault, n) => (
                  <li key={n}><b>✗ {fault.file.endsWith(path) ? `line ${fault.line}` : `${fault.file.split("/").pop()}, line ${fault.line}`}</b> {fault.where && <code>{fault.where}</code>} {fault.message} {fault.advice && <span className="muted">({fault.advice})</span>}</li>
                ))}
              </ul>
            )}
            {forecast && <Matrix forecast={forecast} />}
          </div>
        </section>
      </div>
    </div>
  );
}

function Matrix({ forecast }: { forecast: Forecast }) {
  const known = forecast.wall_seconds !== null;
  const recorded = Math.min(...forecast.variants.map((variant) => variant.recorded));
  return (
    <>
      <h2>Matrix: {forecast.variants.length} × {counted(forecast.variants[0]?.jobs ?? 0, "seed")} = {counted(forecast.jobs, "job")}</h2>
      <p>
        {known
          ? `About ${duration(forecast.wall_seconds)} on ${forecast.workers} workers (${duration(forecast.cpu_seconds)} CPU), by ${recorded} or more recorded jobs of each mission.`
          : "The duration is unknown, because not every mission has recorded jobs. The first jobs will show it."}
      </p>
      <div className="scroll" tabIndex={0} role="region" aria-label="Matrix">
        <table>
          <thead><tr><th>Recipe</th><th>Mission</th><th>Scene</th><th>Faults</th><th className="number">Jobs</th><th className="number">CPU</th></tr></thead>
          <tbody>
            {forecast.variants.slice(0, SHOWN).map((variant) => (
              <tr key={`${variant.mission} ${variant.label}`}>
                <td>{variant.label}</td><td>{variant.mission}</td><td>{variant.scene || "its own"}</td><td>{variant.faults || "none"}</td>
                <td className="number">{variant.jobs}</td><td className="number">{duration(variant.cpu_seconds)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {forecast.variants.length > SHOWN && <p className="muted">and {forecast.variants.length - SHOWN} more</p>}
    </>
  );
}
