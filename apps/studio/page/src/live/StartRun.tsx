// What goes on in the folder, and the form that starts a run.

import { useEffect, useId, useState } from "react";

import { call, useCall, useWatch } from "../connection";
import { go, href } from "../routing";
import type { FolderState } from "../start/Start";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { Field } from "../ui/Field";
import { toastError } from "../ui/Toast";
import "./live.css";

interface Parameter {
  name: string;
  type: string;
  unit: string;
  doc: string;
  required: boolean;
  default: string;
  choices: string[];
}

interface Form {
  mission: string;
  scene: string;
  parameters: Parameter[];
  scenes: string[];
  robots: string[];
  faults: string[];
}

interface GoingOn {
  id: string;
  began: number;
}

export function StartRun({ mission: first }: { mission: string }) {
  const { value: folder, error } = useCall<FolderState>("folder.state", {});
  const { value: runs } = useWatch<GoingOn[]>("live.runs", {});
  const [chosen, setChosen] = useState(first);
  if (error) return <Empty title="The folder cannot be read"><p>{error.message}</p></Empty>;
  if (!folder) return <p className="loading" role="status">Looking into the folder …</p>;
  const missions = folder.files.filter((file) => file.kind === "mission");
  const mission = missions.some((file) => file.path === chosen) ? chosen : (missions[0]?.path ?? "");
  return (
    <div className="start-run">
      <section className="card" aria-label="Runs in progress">
        <h1>Runs in progress <span className="count">{runs?.length ?? 0}</span></h1>
        {runs && !runs.length && <p className="muted">None goes on in this folder. One that is started here goes on when this page, or the studio, is closed.</p>}
        <ul>
          {runs?.map((run) => (
            <li key={run.id}><a href={href("live", run.id)}>{run.id}</a> <span className="muted">since {new Date(run.began * 1000).toLocaleTimeString()}</span></li>
          ))}
        </ul>
      </section>
      {mission ? (
        <section className="card" aria-label="Start a run">
          <h1>Start a run</h1>
          <Field label="Mission">
            {(attributes) => (
              <select {...attributes} value={mission} onChange={(event) => setChosen(event.target.value)}>
                {missions.map((file) => <option key={file.path} value={file.path}>{file.path}{file.name ? ` (${file.name})` : ""}</option>)}
              </select>
            )}
          </Field>
          <OrderForm mission={mission} key={mission} />
        </section>
      ) : (
        <Empty title="No mission is in this folder yet"><p>Copy the examples on the <a href="#/">start page</a>, or write a mission.</p></Empty>
      )}
    </div>
  );
}

const PACES: [value: string, words: string][] = [["1", "real time"], ["0.25", "a quarter of real time"], ["4", "four times real time"], ["0", "as fast as possible"]];

function OrderForm({ mission }: { mission: string }) {
  const { value: form, error } = useCall<Form>("live.form", { mission });
  const [values, setValues] = useState<Record<string, string>>({});
  const [starting, setStarting] = useState(false);
  const lists = useId();
  useEffect(() => setValues({}), [mission]);
  if (error) {
    return (
      <div role="alert">
        <p>This mission has faults:</p>
        <pre>{error.faults.length ? error.faults.map((fault) => `${fault.file}:${fault.line}: ${fault.message}${fault.advice ? ` (${fault.advice})` : ""}`).join("\n") : error.message}</pre>
        <p><a className="button" href={href("write", mission)}>Mend it</a></p>
      </div>
    );
  }
  if (!form) return <p className="loading" role="status">Reading the mission …</p>;
  const value = (name: string, usual = "") => values[name] ?? usual;
  const set = (name: string, to: string) => setValues((before) => ({ ...before, [name]: to }));
  const start = async () => {
    const parameters: Record<string, string> = {};
    for (const { name } of form.parameters) if (value(`set.${name}`).trim()) parameters[name] = value(`set.${name}`).trim();
    setStarting(true);
    try {
      const order = {
        mission, parameters, scene: value("scene"), robot: value("robot"), faults: value("faults"),
        seed: Math.max(0, Math.trunc(Number(value("seed", "0")) || 0)), backend: value("backend", "physics"), pace: Number(value("pace", "1")),
      };
      go(href("live", await call<string>("live.start", { order })));
    } catch (problem) {
      toastError(problem);
      setStarting(false);
    }
  };
  const choice = (name: string, label: string, options: [value: string, words: string][], usual = "", hint = "") => (
    <Field label={label} hint={hint}>
      {(attributes) => (
        <select {...attributes} value={value(name, usual)} onChange={(event) => set(name, event.target.value)}>
          {options.map(([each, words]) => <option key={each} value={each}>{words}</option>)}
        </select>
      )}
    </Field>
  );
  const same = (names: string[]): [string, string][] => names.map((name) => [name, name]);
  return (
    <form className="order" onSubmit={(event) => { event.preventDefault(); void start(); }}>
      <div className="order-fields">
        {choice("scene", "Scene", [["", form.scene ? `${form.scene}, the mission's` : "the mission names none"], ...same(form.scenes)])}
        <Field label="Seed" hint="of all random numbers; the same seed gives the same run">
          {(attributes) => <input {...attributes} type="number" min={0} max={2147483647} step={1} value={value("seed", "0")} onChange={(event) => set("seed", event.target.value)} />}
        </Field>
        {choice("backend", "Backend", [["physics", "physics"], ["kinematic", "kinematic: objects follow the gripper"]], "physics")}
        {choice("pace", "Pace", PACES, "1", "a run that is slower by itself takes longer")}
        {choice("robot", "Robot", [["", "the scene's"], ...same(form.robots)])}
        {choice("faults", "Faults", [["", "none"], ...same(form.faults)])}
      </div>
      {form.parameters.length > 0 && (
        <fieldset>
          <legend>Parameters</legend>
          <div className="order-fields">
            {form.parameters.map((each) => (
              <Field key={each.name} label={`${each.name}${each.required ? " (needed)" : ""}`} hint={[each.doc, each.type, each.unit].filter(Boolean).join(", ")}>
                {(attributes) => (
                  <>
                    <input {...attributes} required={each.required} list={each.choices.length ? `${lists}-${each.name}` : undefined} placeholder={each.default} value={value(`set.${each.name}`)} onChange={(event) => set(`set.${each.name}`, event.target.value)} />
                    {each.choices.length > 0 && <datalist id={`${lists}-${each.name}`}>{each.choices.map((one) => <option key={one} value={one} />)}</datalist>}
                  </>
                )}
              </Field>
            ))}
          </div>
        </fieldset>
      )}
      <p className="buttons">
        <Button type="submit" primary disabled={starting}>{starting ? "Starting …" : "Start"}</Button>
        {starting && <span role="status" className="muted">The cell is being built; this takes a few seconds.</span>}
      </p>
    </form>
  );
}
