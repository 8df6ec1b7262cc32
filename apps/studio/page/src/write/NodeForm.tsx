// The ports of the selected node as a form, made from the node's declaration.

import { useEffect, useState } from "react";

import { useCall } from "../connection";
import { Button } from "../ui/Button";
import { Field } from "../ui/Field";
import { Prose } from "../ui/Prose";
import type { PortEntry } from "../records";
import type { CommonEntry, Edit, MissionNode, NodeEntry, Palette } from "./model";

const CALM_AFTER = 600; // ms

interface Form {
  ports: { key: string; names: string[]; default: string }[];
  keys: string[];
}

export interface NodeFormProps {
  path: string;
  text: string;
  node: MissionNode;
  palette: Palette | null;
  change(edit: Edit): void;
}

export function NodeForm({ path, text, node, palette, change }: NodeFormProps) {
  const form = useCall<Form>("mission.form", { path, text: useCalm(text, node.id), node: node.id });
  const entry = palette?.nodes.find((each) => each.id === node.identity);
  const values = new Map(node.ports.map((port) => [port.key, port.text]));
  const known = new Set([...(entry?.ports ?? []).map((port) => port.key), ...(palette?.common ?? []).map((each) => each.key)]);
  const strange = node.ports.filter((port) => !known.has(port.key));
  const set = (key: string) => (value: string) => {
    if (value.trim() !== (values.get(key) ?? "")) change({ do: "set", node: node.id, key, value });
  };
  const keys = (form.value?.keys ?? []).map((key) => `{${key}}`);
  const details = (port: PortEntry) => form.value?.ports.find((each) => each.key === port.key);
  return (
    <div className="node-form">
      <header>
        <h2>{node.identity}</h2>
        <p className="muted mono">{node.id}</p>
        {entry && <p><Prose text={entry.summary} /></p>}
        {node.symbol === "unknown" && <p className="problem">There is no node of this name. Its text and its ports stay as they are.</p>}
        {node.listed && <p>This Sequence is written as a list of its nodes. A list has no ports.</p>}
        {node.aliased && <p className="problem">The text of this node is at an anchor: edit it there.</p>}
      </header>
      {!node.listed && !node.aliased && (
        <>
          {(entry?.ports ?? []).map((port) => (
            <PortField key={`${node.id} ${port.key}`} port={port} value={values.get(port.key) ?? ""} names={details(port)?.names ?? []} keys={keys} save={set(port.key)} />
          ))}
          {strange.map((port) => <TextField key={`${node.id} ${port.key}`} label={port.key} hint="no such port is declared" value={port.text} options={[]} save={set(port.key)} />)}
          {palette && (
            <details open={palette.common.some((each) => values.has(each.key))}>
              <summary>Name, conditions, breakpoint</summary>
              {palette.common.map((each) => <CommonField key={`${node.id} ${each.key}`} entry={each} value={values.get(each.key) ?? ""} save={set(each.key)} />)}
            </details>
          )}
        </>
      )}
      {entry && <EntryDoc entry={entry} />}
    </div>
  );
}

// A text as it was when `id` changed last, or when nobody had typed for a moment: the picture has precedence.
function useCalm(text: string, id: string): string {
  const [calm, setCalm] = useState({ text, id });
  if (calm.id !== id) setCalm({ text, id });
  useEffect(() => {
    const timer = setTimeout(() => setCalm((before) => (before.text === text ? before : { ...before, text })), CALM_AFTER);
    return () => clearTimeout(timer);
  }, [text]);
  return calm.text;
}

function EntryDoc({ entry }: { entry: NodeEntry }) {
  return (
    <details>
      <summary>What {entry.id} does</summary>
      {entry.doc.split("\n\n").map((part, number) => <p key={number}><Prose text={part} /></p>)}
      {entry.slots.length > 0 && <ul>{entry.slots.map((slot) => <li key={slot.key}><code>{slot.key}</code>: {slot.form}. <Prose text={slot.doc} /></li>)}</ul>}
    </details>
  );
}

function PortField({ port, value, names, keys, save }: { port: PortEntry; value: string; names: string[]; keys: string[]; save(value: string): void }) {
  const flag = port.type.startsWith("true or false");
  const given = port.direction === "in" ? [...port.choices, ...names, ...(flag ? ["true", "false"] : [])] : [];
  const hint = [port.doc, port.type, port.bounds].filter(Boolean).join("; ");
  const usual = port.required ? "required" : port.default && port.default !== "none" ? `usually ${port.default}` : "";
  const label = `${port.key}${port.direction === "out" ? " (written)" : ""}${port.unit ? `, ${port.unit}` : ""}`;
  const closed = given.length > 0 && given.length <= 40;
  if (!closed) return <TextField label={label} hint={hint} usual={usual} required={port.required} value={value} options={[...given, ...keys]} save={save} />;
  const all = [...new Set([...given, ...keys])];
  return (
    <Field label={label} hint={hint} fault={port.required && !value ? "A value is missing." : undefined}>
      {(attributes) => (
        <select {...attributes} value={value} onChange={(event) => save(event.target.value)}>
          <option value="">{usual || "not given"}</option>
          {value && !all.includes(value) && <option value={value}>{value}</option>}
          {all.map((each) => <option key={each} value={each}>{each}</option>)}
        </select>
      )}
    </Field>
  );
}

function CommonField({ entry, value, save }: { entry: CommonEntry; value: string; save(value: string): void }) {
  return <TextField label={entry.key} hint={entry.doc} value={value} options={entry.choices} save={save} />;
}

interface TextFieldProps {
  label: string;
  hint: string;
  usual?: string;
  required?: boolean;
  value: string;
  options: string[];
  save(value: string): void;
}

// A value is saved when the field is left, or with Enter; Escape takes the typing back.
function TextField({ label, hint, usual, required, value, options, save }: TextFieldProps) {
  const [typed, setTyped] = useState(value);
  const [before, setBefore] = useState(value);
  if (before !== value) {
    setBefore(value);
    setTyped(value);
  }
  return (
    <Field label={label} hint={hint} fault={required && !value ? "A value is missing." : undefined}>
      {(attributes) => (
        <>
          <input {...attributes} value={typed} placeholder={usual} spellCheck={false} list={options.length ? `${attributes.id}-list` : undefined}
            onChange={(event) => setTyped(event.target.value)} onBlur={() => save(typed)}
            onKeyDown={(event) => {
              if (event.key === "Enter") save(typed);
              else if (event.key === "Escape") setTyped(value);
            }} />
          {options.length > 0 && <datalist id={`${attributes.id}-list`}>{options.map((each) => <option key={each} value={each} />)}</datalist>}
        </>
      )}
    </Field>
  );
}

export function NodeActions({ node, parent, siblings, wrappers, change }: { node: MissionNode; parent: MissionNode | null; siblings: number; wrappers: string[]; change(edit: Edit): void }) {
  const [wrapper, setWrapper] = useState("Recover");
  const place = parent ? parent.children.findIndex((child) => child.id === node.id) : -1;
  const inList = parent !== null && siblings > 1;
  return (
    <div className="node-actions" role="group" aria-label="What to do with the node">
      <span className="joined">
        <Button onClick={() => change({ do: "wrap", node: node.id, identity: wrapper })} disabled={node.aliased}>Wrap in</Button>
        <select aria-label="Node to wrap it in" value={wrapper} onChange={(event) => setWrapper(event.target.value)}>
          {wrappers.map((each) => <option key={each}>{each}</option>)}
        </select>
      </span>
      <Button onClick={() => change({ do: "unwrap", node: node.id })} disabled={node.children.length !== 1} title="Replace the node by its only child">Unwrap</Button>
      <Button onClick={() => change({ do: "move", node: node.id, place: { parent: parent!.id, index: place - 1, slot: node.slot } })} disabled={!inList || place <= 0} title="Alt+↑">Up</Button>
      <Button onClick={() => change({ do: "move", node: node.id, place: { parent: parent!.id, index: place + 2, slot: node.slot } })} disabled={!inList || place === siblings - 1} title="Alt+↓">Down</Button>
      <Button onClick={() => change({ do: "remove", node: node.id })} disabled={!parent || node.aliased} title="Delete">Remove</Button>
    </div>
  );
}
