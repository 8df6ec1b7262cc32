// The index of all runs of the folder: it sorts and filters on the server, and fetches the rows in view.

import { useCallback, useEffect, useMemo, useRef, useState } from "react";

import { call, useCall, watch } from "../connection";
import type { CallError } from "../connection";
import { go, href, replace } from "../routing";
import type { Place } from "../routing";
import { Empty } from "../ui/Empty";
import { Field } from "../ui/Field";
import { Status } from "../ui/Status";
import { Table } from "../ui/Table";
import type { Column } from "../ui/Table";
import { counted } from "../ui/words";
import { done, seconds, when } from "./rows";
import type { IndexEvent, RunRow } from "./rows";

const WINDOW = 100;
const COLUMNS: Column<RunRow>[] = [
  { key: "mission", head: "Mission", width: "minmax(110px, 1.4fr)", sortable: true, cell: (row) => row.mission || row.folder },
  { key: "status", head: "Status", width: "112px", sortable: true, cell: (row) => <Status status={row.status} /> },
  { key: "sorted", head: "Sorted", width: "72px", sortable: true, cell: done },
  { key: "units_an_hour", head: "Units/h", width: "76px", sortable: true, number: true, wide: true, cell: (row) => row.units_an_hour?.toFixed(0) ?? "" },
  { key: "mtbf", head: "MTBF", width: "76px", sortable: true, number: true, wide: true, cell: (row) => seconds(row.mtbf) },
  { key: "lost", head: "Lost", width: "72px", sortable: true, number: true, wide: true, cell: (row) => seconds(row.lost) },
  { key: "cause", head: "Causes", width: "minmax(120px, 1.6fr)", sortable: true, wide: true, cell: (row) => <span title={row.causes.join(", ")}>{row.causes.join(", ")}</span> },
  { key: "scene", head: "Scene", width: "minmax(80px, 1fr)", sortable: true, wide: true, cell: (row) => row.scene },
  { key: "seed", head: "Seed", width: "64px", sortable: true, number: true, wide: true, cell: (row) => row.seed },
  { key: "seconds", head: "Simulated", width: "88px", sortable: true, number: true, wide: true, cell: (row) => seconds(row.seconds) },
  { key: "written", head: "Written", width: "132px", sortable: true, wide: true, cell: when },
  { key: "folder", head: "Folder", width: "minmax(100px, 1.4fr)", sortable: true, wide: true, cell: (row) => <span title={row.folder}>{row.folder}</span> },
];
const FALLING_FIRST = new Set(["written", "lost", "seconds", "units_an_hour", "mtbf"]);

interface Query {
  where: string;
  text: string;
  sort: string;
  descending: boolean;
}

export function RunIndex({ place }: { place: Place }) {
  const query = useMemo<Query>(() => ({
    where: place.query.get("where") ?? "",
    text: place.query.get("text") ?? "",
    sort: place.query.get("sort") ?? "written",
    descending: place.query.get("order") !== "rising",
  }), [place.query.get("where"), place.query.get("text"), place.query.get("sort"), place.query.get("order")]);
  const [typed, setTyped] = useState({ text: query.text, where: query.where });
  const set = useCallback((change: Partial<Query>) => {
    const wanted = { ...query, ...change };
    const words: Record<string, string> = {};
    if (wanted.where) words.where = wanted.where;
    if (wanted.text) words.text = wanted.text;
    if (wanted.sort !== "written") words.sort = wanted.sort;
    if (!wanted.descending) words.order = "rising";
    replace(href("runs", "", words));
  }, [query]);

  const [state, setState] = useState<{ event: IndexEvent; query: Query } | null>(null);
  const [fault, setFault] = useState<CallError | null>(null);
  const pages = useRef(new Map<number, RunRow[]>());
  const [, draw] = useState(0);
  const version = useRef(0);

  useEffect(() => watch<IndexEvent>("runs.index", { ...query, count: WINDOW }, (event) => {
    version.current = event.version;
    pages.current = new Map([[0, event.rows]]);
    setState({ event, query });
    setFault(null);
  }, setFault), [query]);

  const range = useRef({ first: 0, last: 0 });
  const fetchRange = useCallback((first: number, last: number) => {
    range.current = { first, last };
    if (!state) return;
    for (let page = Math.floor(first / WINDOW); page * WINDOW < last; page++) {
      if (pages.current.has(page)) continue;
      const [kept, asked] = [pages.current, state.event.version];
      kept.set(page, []);
      call<RunRow[]>("runs.rows", { ...state.query, offset: page * WINDOW, count: WINDOW }).then((rows) => {
        if (asked !== version.current || kept !== pages.current) return;
        kept.set(page, rows);
        draw((n) => n + 1);
      }, () => kept.delete(page));
    }
  }, [state]);
  useEffect(() => fetchRange(range.current.first, range.current.last), [fetchRange]);

  const sort = useCallback((key: string) => {
    if (key === query.sort) set({ descending: !query.descending });
    else set({ sort: key, descending: FALLING_FIRST.has(key) });
  }, [query, set]);

  if (state?.event.total === 0 && state.event.complete) return <NoRuns problem={state.event.problem} />;
  return (
    <div className="run-index">
      <form className="filters" role="search" onSubmit={(event) => { event.preventDefault(); set(typed); }}>
        <h1>Runs</h1>
        <Field label="Words" hideLabel>
          {(attributes) => <input {...attributes} type="search" placeholder="Words: mission, cause, folder …" value={typed.text}
            onChange={(event) => { setTyped({ ...typed, text: event.target.value }); set({ text: event.target.value }); }} />}
        </Field>
        <Where value={typed.where} fault={fault?.message} onChange={(where) => { setTyped({ ...typed, where }); if (!where) set({ where }); }} onDone={() => set(typed)} />
        <button type="submit" className="hidden-text" tabIndex={-1}>Filter</button>
        <p className="found" role="status">{state ? found(state.event) : "Looking into the logs …"}</p>
      </form>
      {state && state.event.matched === 0 && state.event.complete ? (
        <Empty title="No run meets the condition"><p><a href={href("runs")} onClick={() => setTyped({ text: "", where: "" })}>Show all {state.event.total}</a></p></Empty>
      ) : (
        <Table label="Runs" columns={COLUMNS} count={state?.event.matched ?? 0} keyOf={(row) => row.id}
          row={(index) => pages.current.get(Math.floor(index / WINDOW))?.[index % WINDOW]} onRange={fetchRange}
          sort={{ key: query.sort, descending: query.descending }} onSort={sort}
          hrefOf={(row) => href("run", row.id)} onOpen={(row) => go(href("run", row.id))} />
      )}
    </div>
  );
}

function found({ total, matched, complete }: IndexEvent): string {
  const number = matched === total ? counted(total, "run") : `${matched} of ${counted(total, "run")}`;
  return complete ? number : `${number}, looking further …`;
}

// A condition as of `picktree runs --where`.
function Where({ value, fault, onChange, onDone }: { value: string; fault?: string; onChange(where: string): void; onDone(): void }) {
  const { value: columns } = useCall<Record<string, string>>("runs.columns", {});
  return (
    <div className="where">
      <Field label="Condition" hideLabel fault={fault}>
        {(attributes) => <input {...attributes} className="mono" spellCheck={false} autoCapitalize="off" placeholder="Condition: status == 'failure' and lost > 20"
          value={value} onChange={(event) => onChange(event.target.value)} onBlur={onDone} />}
      </Field>
      <details className="names">
        <summary>Names</summary>
        <dl>
          {Object.entries(columns ?? {}).map(([name, meaning]) => [<dt key={name}><code>{name}</code></dt>, <dd key={`${name} is`}>{meaning}</dd>])}
        </dl>
      </details>
    </div>
  );
}

function NoRuns({ problem }: { problem: string }) {
  return (
    <Empty title="No run in this folder yet">
      {problem && <p role="alert">{problem}</p>}
      <p>A run is made by <code>picktree run MISSION --seed 0</code>, here or in a terminal; it appears in this table while it goes on.</p>
      <p><a href="#/">What is in the folder</a></p>
    </Empty>
  );
}
