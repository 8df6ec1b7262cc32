// A run that goes on: watched from all sides, paused, stepped, changed, answered, halted.

import { useCallback, useEffect, useMemo, useState, useSyncExternalStore } from "react";

import { call } from "../connection";
import { href } from "../routing";
import { TreeView } from "../tree/TreeView";
import type { TreeMarks, TreeNode, TreeStatus } from "../tree/TreeView";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Empty } from "../ui/Empty";
import { Status } from "../ui/Status";
import { toastError } from "../ui/Toast";
import { Board } from "./Board";
import { Lanes } from "./Lanes";
import { Cameras, Lines } from "./Lines";
import { Plots } from "./Plots";
import { Stage } from "./Stage";
import { TakeOver } from "./TakeOver";
import { useLive } from "./state";
import type { LiveNode, LiveState } from "./state";
import "./live.css";

const PANELS = [["stage", "3-D"], ["tree", "Tree"], ["board", "Blackboard"], ["lanes", "Lanes"], ["side", "Log, plots, camera"]] as const;
type Panel = (typeof PANELS)[number][0];
type Say = (line: string) => Promise<string>;

export function LiveRun({ id }: { id: string }) {
  const { state, error } = useLive(id);
  const [front, setFront] = useState<Panel>("stage");
  const say = useCallback<Say>((line) => call<string>("live.command", { id, line }), [id]);
  const order = useCallback((line: string) => void say(line).catch(toastError), [say]);
  const stopped = Boolean(state?.stop);
  const over = Boolean(state?.ended);
  const narrow = useNarrow();
  useKeys(state && !over ? { stopped, order } : null);
  if (!state) {
    if (!error) return <p className="loading" role="status">Connecting to the run …</p>;
    return <Empty title="This run is not in progress"><p>{error.message}</p><p><a className="button" href={href("run", id)}>Open it</a> <a className="button" href={href("live")}>Runs in progress</a></p></Empty>;
  }
  const shows = (panel: Panel) => !narrow || front === panel;
  return (
    <div className="live" data-stopped={stopped} data-ended={over}>
      <Bar id={id} state={state} order={order} />
      <nav className="live-tabs" aria-label="Panels">
        {PANELS.map(([name, words]) => <Button key={name} pressed={front === name} onClick={() => setFront(name)}>{words}</Button>)}
      </nav>
      {shows("stage") && <section className="live-panel stage" aria-label="3-D view"><Stage id={id} state={state} /></section>}
      {shows("lanes") && <section className="live-panel lanes" aria-label="Lanes"><h2>Lanes <small className="muted">last 30 s</small></h2><Lanes state={state} /></section>}
      {shows("board") && <section className="live-panel board" aria-label="Blackboard"><h2>Blackboard</h2><Board board={state.board} say={over ? null : say} /></section>}
      {shows("tree") && <TreePanel state={state} say={say} order={order} />}
      {shows("side") && <Side state={state} />}
    </div>
  );
}

function Bar({ id, state, order }: { id: string; state: LiveState; order(line: string): void }) {
  const [asking, setAsking] = useState<"" | "halt" | "take">("");
  const { stop, question, run, progress } = state;
  return (
    <header className="live-bar">
      <div className="live-head">
        <h1>{run?.mission ?? id}</h1>
        {state.ended ? <Status status={state.status ?? "killed"} /> : <Status status={question || stop ? "paused" : "running"} />}
        <span className="live-time" data-time={state.time}>{state.time.toFixed(2)} s</span>
        {progress && <span className="muted">{progress.text}; {progress.figures}</span>}
        <span className="muted wide-only">{run && `${run.scene}, seed ${run.seed}, ${run.robot}, ${run.backend}`}</span>
      </div>
      {state.ended ? (
        <p className="live-said" role="status">
          {state.status ? `The run has ended: ${state.status}.` : "The run's process has ended without a result."}{" "}
          <a className="button" href={href("run", id)}>Open the run</a> <a className="button" href={href("live")}>Start another</a>
        </p>
      ) : (
        <div className="buttons" role="toolbar" aria-label="Steer the run">
          {stop ? <Button primary onClick={() => order("continue")} title="Continue to the next breakpoint (space)">Go on</Button>
            : <Button onClick={() => order("pause")} disabled={Boolean(question)} title="Stop at the end of the next tick (space)">Pause</Button>}
          <Button onClick={() => order("step")} disabled={!stop} title="Continue to the end of the tick (.)">Step a tick</Button>
          <Button className="wide-only" onClick={() => order("next")} disabled={!stop} title="Continue to the next start or end of a node (n)">Next node</Button>
          <Button className="wide-only" onClick={() => setAsking("take")} title="Continue with another mission after the present item">Take over a mission …</Button>
          <Button className="danger" onClick={() => setAsking("halt")} title="Bring the arm to rest and end the run">Halt …</Button>
        </div>
      )}
      {stop && !state.ended && <p className="live-said" role="status">Stopped at {stop.where}</p>}
      {question && !state.ended && (
        <section className="live-question" role="alertdialog" aria-label="The mission asks for help">
          <h2>Help is wanted: {question.reason}</h2>
          <p>{question.situation}</p>
          <p className="buttons">
            {question.choices.map((choice, number) => <Button key={choice} primary={number === 0} onClick={() => order(`answer ${number + 1}`)}>{choice}</Button>)}
          </p>
        </section>
      )}
      {asking === "halt" && (
        <Dialog title="Halt this run?" onClose={() => setAsking("")}>
          <p>The tree is halted and the arm brought to rest; then the run ends as interrupted. It can be resumed from its last checkpoint.</p>
          <p className="buttons"><Button primary onClick={() => { setAsking(""); order("halt"); }}>Halt the run</Button> <Button onClick={() => setAsking("")}>Cancel</Button></p>
        </Dialog>
      )}
      {asking === "take" && <TakeOver id={id} onClose={() => setAsking("")} />}
    </header>
  );
}

const STATUSES: Record<string, TreeStatus> = { IDLE: "idle", RUNNING: "running", SUCCESS: "success", FAILURE: "failure", SKIPPED: "skipped" };

function TreePanel({ state, say, order }: { state: LiveState; say: Say; order(line: string): void }) {
  const [selected, setSelected] = useState("");
  const [told, setTold] = useState<{ path: string; text: string } | null>(null);
  const root = useMemo(() => nested(state.tree), [state.tree]);
  const marks = useMemo(() => {
    const found: TreeMarks = {};
    for (const [path, [status]] of Object.entries(state.nodes)) found[path] = { status: STATUSES[status] };
    for (const { path } of state.breakpoints) found[path] = { ...found[path], breakpoint: true };
    return found;
  }, [state.nodes, state.breakpoints]);
  const chosen = state.tree.find((node) => node.path === selected);
  const here = state.breakpoints.filter((each) => each.path === selected);
  const [status, , message, cause] = state.nodes[selected] ?? ["IDLE", false, "", ""];
  const ask = (path: string) => say(`node ${path}`).then((text) => setTold({ path, text }), toastError);
  return (
    <section className="live-panel tree" aria-label="Tree">
      <Running state={state} onSelect={setSelected} />
      {root ? <TreeView root={root} marks={marks} selected={selected || undefined} onSelect={setSelected} onMenu={(path) => setSelected(path)} /> : <p className="loading">The tree has not arrived yet.</p>}
      {chosen && (
        <div className="live-node">
          <p><b>{chosen.name}</b> <span className="muted">{chosen.id}</span> is {status.toLowerCase()}{cause || message ? <>: <span>{[cause, message].filter(Boolean).join(": ")}</span></> : ""}</p>
          {!state.ended && (
            <p className="buttons">
              {here.map((each) => <Button key={each.number} onClick={() => order(`delete ${each.number}`)}>Remove the breakpoint {each.when}</Button>)}
              {!here.some((each) => each.when === "before") && <Button onClick={() => order(`break ${selected} before`)}>Break before</Button>}
              {!here.some((each) => each.when === "after") && <Button onClick={() => order(`break ${selected} after`)}>Break after</Button>}
              <Button onClick={() => void ask(selected)}>Ports and values</Button>
            </p>
          )}
          {told?.path === selected && <pre tabIndex={0} aria-label="Ports and values">{told.text}</pre>}
        </div>
      )}
    </section>
  );
}

// The leaves that run, each with its parents: where the run stands, also where the tree is too wide.
function Running({ state, onSelect }: { state: LiveState; onSelect(path: string): void }) {
  const leaves = state.tree.filter((node) => !node.children.length && state.nodes[node.path]?.[0] === "RUNNING");
  if (!leaves.length) return null;
  return (
    <ul className="live-running" aria-label="Running leaves">
      {leaves.map((leaf) => (
        <li key={leaf.path}>
          <button onClick={() => onSelect(leaf.path)} title={leaf.path}><span aria-hidden="true">▶</span> <small>{leaf.path.split("/").slice(0, -1).slice(-3).join(" › ")} ›</small> <b>{leaf.name}</b></button>
        </li>
      ))}
    </ul>
  );
}

function nested(nodes: LiveNode[]): TreeNode | null {
  const byPath = new Map(nodes.map((node) => [node.path, node]));
  const handlers = new Set(nodes.filter((node) => node.symbol === "recover").flatMap((node) => node.children.slice(1)));
  const made = (node: LiveNode): TreeNode => ({
    id: node.path,
    name: node.name,
    kind: node.symbol,
    detail: node.name.split("#")[0] === node.id ? undefined : node.id,
    // The handlers of a Recover are many, and most of them never run.
    collapsedByDefault: handlers.has(node.path),
    children: node.children.flatMap((path) => (byPath.has(path) ? [made(byPath.get(path)!)] : [])),
  });
  return nodes[0] ? made(nodes[0]) : null;
}

const SIDES = ["Log", "Speed and force", "Camera"] as const;

function Side({ state }: { state: LiveState }) {
  const [side, setSide] = useState<(typeof SIDES)[number]>("Log");
  return (
    <section className="live-panel side" aria-label="Log, plots and camera">
      <div className="side-tabs" role="group" aria-label="What is shown here">
        {SIDES.map((name) => <Button key={name} pressed={side === name} onClick={() => setSide(name)}>{name}</Button>)}
      </div>
      {side === "Log" ? <Lines lines={state.lines} /> : side === "Camera" ? <Cameras images={state.images} /> : <Plots rows={state.rows} />}
    </section>
  );
}

// One panel at a time where the page is narrow: the others are not there, and cost nothing.
const NARROW = matchMedia("(max-width: 1000px)");

function useNarrow(): boolean {
  return useSyncExternalStore(
    (listener) => {
      NARROW.addEventListener("change", listener);
      return () => NARROW.removeEventListener("change", listener);
    },
    () => NARROW.matches,
  );
}

// Space pauses and goes on, "." steps a tick, "n" goes to the next node.
function useKeys(steering: { stopped: boolean; order(line: string): void } | null): void {
  const stopped = steering?.stopped;
  const order = steering?.order;
  useEffect(() => {
    if (!order) return;
    const pressed = (event: KeyboardEvent) => {
      if (event.ctrlKey || event.metaKey || event.altKey || (event.target as HTMLElement).closest("input, textarea, select, button, a, dialog, .tree-view")) return;
      const line = event.key === " " ? (stopped ? "continue" : "pause") : stopped && event.key === "." ? "step" : stopped && event.key === "n" ? "next" : "";
      if (!line) return;
      event.preventDefault();
      order(line);
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  }, [stopped, order]);
}

