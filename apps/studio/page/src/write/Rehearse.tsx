// Rehearsal with cases: verdicts, and coverage that the picture draws.

import { useState } from "react";

import { call, useCall } from "../connection";
import type { CallError } from "../connection";
import type { ListedFile } from "../records";
import { Button } from "../ui/Button";
import { Prose } from "../ui/Prose";
import { counted } from "../ui/words";

export interface Rehearsal {
  file: string;
  passed: boolean;
  cases: Case[];
  coverage: { percent: number; reached: number; total: number; missed: { node: string; message: string; place: { file: string; line: number } }[] };
  // By node: how many of its points some case reaches.
  nodes: Record<string, { reached: number; total: number; missed: string[] }>;
}

interface Case {
  name: string;
  doc: string;
  passed: boolean;
  status: string;
  cause: string | null;
  message: string;
  ticks: number;
  seconds: number;
  differences: { message: string; where: string; place: { line: number } }[];
  leaves: { node: string; tick: number; outcome: string; cause: string | null }[];
}

export function RehearsePanel({ path, text, result, onResult, onNode }: { path: string; text: string; result: Rehearsal | null; onResult(found: Rehearsal | null): void; onNode(id: string): void }) {
  const files = useCall<ListedFile[]>("files.list", { kind: "cases" });
  const usual = path.replace(/([^/]+)$/, "cases/$1");
  const [cases, setCases] = useState(usual);
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState<CallError | null>(null);
  const found = files.value ?? [];
  const chosen = found.some((each) => each.path === cases) ? cases : "";
  const rehearse = () => {
    setBusy(true);
    setError(null);
    call<Rehearsal>("mission.rehearse", { path, text, cases: chosen }, true).then(onResult, (failed: CallError) => {
      onResult(null);
      setError(failed);
    }).finally(() => setBusy(false));
  };
  return (
    <div className="rehearse">
      <p>The tree is ticked without a robot; its leaves answer as the cases say.</p>
      <div className="buttons">
        <select aria-label="File with cases" value={chosen} onChange={(event) => setCases(event.target.value)}>
          <option value="">{found.length ? "choose cases" : "no cases in this folder"}</option>
          {found.map((each) => <option key={each.path}>{each.path}</option>)}
        </select>
        <Button primary onClick={rehearse} disabled={busy || !chosen}>{busy ? "Rehearsing…" : "Rehearse"}</Button>
        {result && <Button onClick={() => onResult(null)}>Clear</Button>}
      </div>
      {error && (
        <div className="problem" role="alert">
          {error.faults.length ? <ul>{error.faults.map((fault, number) => <li key={number}>{fault.file}:{fault.line}: {fault.message}</li>)}</ul> : <p>{error.message}</p>}
        </div>
      )}
      {result && <Verdict result={result} onNode={onNode} />}
    </div>
  );
}

function Verdict({ result, onNode }: { result: Rehearsal; onNode(id: string): void }) {
  const { coverage } = result;
  return (
    <>
      <p role="status"><b>{result.passed ? "✓ All cases pass" : "✗ Some cases fail"}</b>; {coverage.reached} of {counted(coverage.total, "point")} of the text are reached, {coverage.percent} %.</p>
      <ul className="cases">
        {result.cases.map((each) => (
          <li key={each.name}>
            <details open={!each.passed}>
              <summary><span className={`status ${each.passed ? "success" : "failure"}`}>{each.passed ? "✓" : "✗"}</span> {each.name} <small className="muted">{each.status}{each.cause ? `, ${each.cause}` : ""}, {each.ticks} ticks</small></summary>
              {each.doc && <p className="muted"><Prose text={each.doc} /></p>}
              {each.differences.map((difference, number) => <p key={number} className="problem">{difference.where}: {difference.message}</p>)}
              <ol className="leaves">{each.leaves.map((leaf, number) => <li key={number}><span className="mono">{leaf.node.split("/").at(-1)}</span> <small className="muted">tick {leaf.tick}: {leaf.cause ?? leaf.outcome}</small></li>)}</ol>
            </details>
          </li>
        ))}
      </ul>
      {coverage.missed.length > 0 && (
        <>
          <h3>Not reached</h3>
          <ul className="missed">
            {coverage.missed.map((each, number) => <li key={number}><button className="link" onClick={() => onNode(each.node)}>{each.node.split("/").slice(-2).join("/")}</button> {each.message}</li>)}
          </ul>
        </>
      )}
    </>
  );
}
