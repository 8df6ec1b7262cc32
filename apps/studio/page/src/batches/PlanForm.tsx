// The keys of a plan as controls. Each change is written into the text; a list is written with commas.

import { useEffect, useState } from "react";

import { useCall } from "../connection";
import type { ListedFile } from "../records";
import { Field } from "../ui/Field";

export type FormValues = Record<string, unknown>;

const LISTS: [key: string, label: string, hint: string, kind: string][] = [
  ["missions", "Missions", "files, from the plan's folder", "mission"],
  ["scenes", "Scenes", "replace the missions' own scenes; empty: keep these", "scene"],
  ["robots", "Robots", "replace the scenes' own robots; empty: keep these", "robot"],
  ["faults", "Faults", "files; none is a run without faults", "faults"],
];

export function PlanForm({ path, values, onChange }: { path: string; values: FormValues; onChange(key: string, value: unknown): void }) {
  return (
    <div className="plan-form">
      <Text label="Name" hint="default: the file's name" value={words(values.name)} onDone={(text) => onChange("name", text || null)} />
      {LISTS.map(([key, label, hint, kind]) => <List key={key} path={path} label={label} hint={hint} kind={kind} value={list(values[key])} onDone={(found) => onChange(key, found.length || key === "missions" ? found : null)} />)}
      <Text label="Seeds" hint="0:100 (100 not included), or 3,7" value={words(values.seeds)} onDone={(text) => onChange("seeds", text || null)} />
      <Text label="Settings" hint="a port or parameter with its values, as SortOne/Grasp.force=15,30; a semicolon between two of them" value={settings(values.set)} onDone={(text) => onChange("set", parsed(text))} />
      <Choice label="Backend" value={words(values.backend) || "physics"} options={["physics", "kinematic"]} onDone={(text) => onChange("backend", text)} />
      <Choice label="Logs that stay" value={words(values.keep) || "failures"} options={["failures", "all", "none"]} onDone={(text) => onChange("keep", text)} />
      <Text label="Simulated time of a job" hint="default: 3600 s" value={words(values.limit)} onDone={(text) => onChange("limit", text || null)} />
    </div>
  );
}

// A control that tells its value when it is left, or with Enter.
function Text({ label, hint, value, onDone, list }: { label: string; hint: string; value: string; onDone(text: string): void; list?: string }) {
  const [text, setText] = useState(value);
  useEffect(() => setText(value), [value]);
  const done = () => { if (text.trim() !== value) onDone(text.trim()); };
  return (
    <Field label={label} hint={hint}>
      {(attributes) => <input {...attributes} value={text} list={list} spellCheck={false} onChange={(event) => setText(event.target.value)} onBlur={done}
        onKeyDown={(event) => { if (event.key === "Enter") done(); }} />}
    </Field>
  );
}

function List({ path, label, hint, kind, value, onDone }: { path: string; label: string; hint: string; kind: string; value: string[]; onDone(found: string[]): void }) {
  const { value: files } = useCall<ListedFile[]>("files.list", { kind });
  const below = path.includes("/") ? `${path.slice(0, path.lastIndexOf("/"))}/` : "";
  const names = (files ?? []).map((file) => file.path).filter((each) => each.startsWith(below)).map((each) => each.slice(below.length));
  const left = names.filter((name) => !value.includes(name));
  return (
    <div className="form-list">
      <Text label={label} hint={hint} value={value.join(", ")} onDone={(text) => onDone(text.split(",").map((each) => each.trim()).filter(Boolean))} />
      {left.length > 0 && (
        <select aria-label={`Add to ${label}`} value="" onChange={(event) => onDone([...value, event.target.value])}>
          <option value="">Add …</option>
          {left.map((name) => <option key={name}>{name}</option>)}
        </select>
      )}
    </div>
  );
}

function Choice({ label, value, options, onDone }: { label: string; value: string; options: string[]; onDone(text: string): void }) {
  return (
    <Field label={label}>
      {(attributes) => <select {...attributes} value={value} onChange={(event) => onDone(event.target.value)}>{options.map((each) => <option key={each}>{each}</option>)}</select>}
    </Field>
  );
}

const words = (value: unknown): string => (value === undefined || value === null ? "" : Array.isArray(value) ? value.join(",") : String(value));
const list = (value: unknown): string[] => (Array.isArray(value) ? value.map(String) : []);

function settings(value: unknown): string {
  if (value === null || typeof value !== "object") return "";
  return Object.entries(value).map(([name, values]) => `${name}=${Array.isArray(values) ? values.join(",") : String(values)}`).join("; ");
}

function parsed(text: string): Record<string, unknown> | null {
  const found: Record<string, unknown> = {};
  for (const part of text.split(";")) {
    const at = part.indexOf("=");
    if (at > 0) found[part.slice(0, at).trim()] = part.slice(at + 1).split(",").map((each) => number(each.trim()));
  }
  return Object.keys(found).length ? found : null;
}

// A number stays one in the text.
const number = (text: string): unknown => (/^-?\d+(\.\d+)?$/.test(text) ? Number(text) : text === "true" || text === "false" ? text === "true" : text);
