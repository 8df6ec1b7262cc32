// A mission as text and picture side by side: one document, one history.

import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import type { DragEvent, KeyboardEvent } from "react";

import { go, href } from "../routing";
import { TreeView } from "../tree/TreeView";
import type { TreeMarks, TreeNode } from "../tree/TreeView";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { Prose } from "../ui/Prose";
import { counted } from "../ui/words";
import { applyChanges, markNode, redo, undo } from "./editor";
import { head, picture, treeOfHead } from "./model";
import type { Edit, MissionNode, NodeEntry, Place, TextFault } from "./model";
import { NodeActions, NodeForm } from "./NodeForm";
import { NodeMenu } from "./NodeMenu";
import { DRAGGED, PalettePanel } from "./PalettePanel";
import { RehearsePanel } from "./Rehearse";
import type { Rehearsal } from "./Rehearse";
import { ScenePanel } from "./ScenePanel";
import { useMission } from "./useMission";
import "./write.css";

type Tab = "node" | "add" | "rehearse" | "scene";
type Show = "both" | "text" | "picture";
/** The chosen node; one that was chosen in the picture scrolls the text to itself, once. */
type Selection = { id: string; scrolls: boolean };
const TABS: [Tab, string][] = [["node", "Node"], ["add", "Add"], ["rehearse", "Rehearse"], ["scene", "Scene"]];

export function WritePage({ path }: { path: string }) {
  const [selection, setSelection] = useState<Selection>({ id: "", scrolls: false });
  const [tab, setTab] = useState<Tab>("node");
  const [show, setShow] = useState<Show>("both");
  const [only, setOnly] = useState("");
  const [menu, setMenu] = useState<{ id: string; x: number; y: number } | null>(null);
  const [rehearsal, setRehearsal] = useState<Rehearsal | null>(null);
  const marked = useRef<Selection | null>(null);
  const moved = useRef<(place: number) => void>(() => undefined);
  const writing = useMission(path, (place) => moved.current(place));
  const { view, text, mission, index, faults, palette } = writing;
  const selected = selection.id;
  const follow = useCallback((id: string) => setSelection((before) => (before.id === id ? before : { id, scrolls: false })), []);
  moved.current = (place) => { if (index) follow(index.at(place)); };

  // A node that was renamed in the text is the one at the cursor.
  useEffect(() => {
    if (index && view && selected && !index.node(selected) && !treeOfHead(selected)) follow(index.at(view.state.selection.main.head));
  }, [index, view, selected, follow]);

  // A choice in the picture shows its text; a move of the cursor chooses in the picture.
  const choose = useCallback((id: string) => {
    setSelection({ id, scrolls: true });
    setTab((before) => (before === "add" || before === "scene" ? before : "node"));
  }, []);
  const node = index?.node(selected) ?? null;
  useEffect(() => {
    if (!view) return;
    const scroll = selection.scrolls && marked.current !== selection;
    const tree = mission?.trees.find((each) => head(each.name) === selected);
    markNode(view, node ? index!.span(node.id) : tree && scroll ? { from: tree.start, to: tree.start + tree.name.length } : null, scroll);
    marked.current = selection;
  }, [view, selection, node, mission, index]);

  const change = useCallback(async (edit: Edit) => {
    const concerned = await writing.edit(edit);
    if (concerned !== null) setSelection({ id: concerned, scrolls: true });
  }, [writing]);

  const drawn = useRef<TreeNode | null>(null);
  const root = useMemo(() => {
    if (!mission) return null;
    drawn.current = picture(mission, mission.trees.some((tree) => tree.name === only) ? only : "", drawn.current);
    return drawn.current;
  }, [mission, only]);
  const marks = useMemo<TreeMarks>(() => {
    if (!index || (!faults?.length && !rehearsal)) return NO_MARKS;
    const found: TreeMarks = {};
    for (const fault of faults ?? []) {
      const id = index.at(fault.from);
      found[id] = { ...found[id], faults: (found[id]?.faults ?? 0) + 1 };
    }
    if (rehearsal) for (const [id, points] of Object.entries(rehearsal.nodes)) found[id] = { ...found[id], coverage: points.total ? points.reached / points.total : 1 };
    return found;
  }, [index, faults, rehearsal]);

  const move = useSteady((id: string, parent: string, place: number) => {
    if (!index || treeOfHead(id) || treeOfHead(parent) || !parent) return;
    // The picture counts without the node that is moved, an edit with it.
    const old = index.parent(id);
    const number = old?.id === parent ? old.children.findIndex((child) => child.id === id) : -1;
    void change({ do: "move", node: id, place: { parent, index: number >= 0 && place >= number ? place + 1 : place } });
  });
  const openMenu = useSteady((id: string, at: { x: number; y: number }) => {
    choose(id);
    setMenu({ id, ...at });
  });

  const target = addPlace(node, index?.parent(selected) ?? null, palette?.nodes ?? []);
  const add = useCallback((entry: NodeEntry, place: Place | null) => {
    if (place) void change({ do: "add", place: { parent: place.parent, index: place.index, slot: place.slot }, identity: entry.id, include: entry.include });
  }, [change]);
  const dropped = (event: DragEvent) => {
    const identity = event.dataTransfer.getData(DRAGGED);
    const entry = palette?.nodes.find((each) => each.id === identity);
    const id = (event.target as HTMLElement).closest<HTMLElement>("[data-tree-node]")?.dataset.treeNode;
    const onto = id === undefined ? null : index?.node(id) ?? null;
    if (!entry) return;
    event.preventDefault();
    add(entry, addPlace(onto ?? node, index?.parent(onto?.id ?? selected) ?? null, palette?.nodes ?? []));
  };
  const keys = (event: KeyboardEvent) => {
    const parent = index?.parent(selected);
    const place = parent?.children.findIndex((child) => child.id === selected) ?? -1;
    const move = (to: MissionNode, number: number) => void change({ do: "move", node: selected, place: { parent: to.id, index: number } });
    const moves: Record<string, () => void> = parent ? {
      ArrowUp: () => { if (place > 0) move(parent, place - 1); },
      ArrowDown: () => { if (place < parent.children.length - 1) move(parent, place + 2); },
      // Out of its parent, behind it; into the sibling before it, at its end.
      ArrowLeft: () => {
        const above = index!.parent(parent.id);
        if (above) move(above, above.children.findIndex((child) => child.id === parent.id) + 1);
      },
      ArrowRight: () => { if (place > 0) move(parent.children[place - 1]!, parent.children[place - 1]!.children.length); },
    } : {};
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && view) (event.shiftKey ? redo : undo)(view);
    else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y" && view) redo(view);
    else if (event.key === "Delete" && node && parent) void change({ do: "remove", node: node.id });
    else if (event.altKey && event.key in moves) moves[event.key]!();
    else if (event.key === "a" && !event.ctrlKey && !event.metaKey) showPalette();
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const showPalette = () => {
    setTab("add");
    requestAnimationFrame(() => document.getElementById("palette-search")?.focus());
  };
  const run = async () => {
    if (!writing.unsaved || (await writing.save())) go(href("live", "", { mission: path }));
  };
  const tree = mission?.trees.find((each) => head(each.name) === selected);
  const parent = index?.parent(selected) ?? null;
  const wrappers = (palette?.nodes ?? []).filter((each) => each.wraps).map((each) => each.id);

  if (writing.problem) return <Empty title="This file cannot be opened"><p>{writing.problem}</p><a href="#/write">To the missions</a></Empty>;
  return (
    <div className={`write-page show-${show} tool-${tab}`}>
      <div className="write-bar" role="toolbar" aria-label="Mission">
        <h1>{path}<small>{mission?.name}{writing.unsaved ? " · not saved" : ""}</small></h1>
        <Button primary onClick={() => void writing.save()} disabled={!view || !writing.unsaved} title="Ctrl+S">Save</Button>
        <Button onClick={() => view && undo(view)} disabled={!writing.undoable} title="Ctrl+Z">Undo</Button>
        <Button onClick={() => view && redo(view)} disabled={!writing.redoable} title="Ctrl+Shift+Z">Redo</Button>
        <Button onClick={() => void run()} disabled={!view} title={writing.unsaved ? "Save the mission, and start a run" : "Start a run of this mission"}>Run …</Button>
        <span className="space" />
        <select aria-label="Trees in the picture" value={only} onChange={(event) => setOnly(event.target.value)}>
          <option value="">All trees</option>
          {mission?.trees.map((each) => <option key={each.name}>{each.name}</option>)}
        </select>
        <span className="joined" role="group" aria-label="Show">
          {(["both", "text", "picture"] as const).map((each) => <Button key={each} pressed={show === each} onClick={() => setShow(each)}>{each === "both" ? "Both" : each === "text" ? "Text" : "Picture"}</Button>)}
        </span>
      </div>
      {mission?.left_out && <p className="lost">Nodes of plug-ins are left out: {mission.left_out}</p>}
      <div className="write-parts">
        <section className="write-text" aria-label="Text">
          <div className="write-editor" ref={writing.host} />
          <Faults faults={faults} onShow={(fault) => { if (view) { view.dispatch({ selection: { anchor: fault.from }, scrollIntoView: true }); view.focus(); } }} onFix={(fault) => { if (view) applyChanges(view, [fault.fix!], false); }} />
        </section>
        <section className="write-picture" aria-label="Picture" onKeyDownCapture={keys} onDragOver={(event) => { if (event.dataTransfer.types.includes(DRAGGED)) event.preventDefault(); }} onDrop={dropped}>
          {root ? <TreeView root={root} marks={marks} selected={selected} onSelect={choose} onMove={move} onMenu={openMenu} /> : <p className="loading">Reading the mission…</p>}
          {mission && !mission.whole && <p className="stale" role="status">The text has a syntax fault. The picture shows the part that can be read.</p>}
        </section>
        <aside className="write-side" aria-label="Tools">
          <div className="tabs" role="tablist">
            {TABS.map(([name, title]) => <button key={name} role="tab" id={`tab-${name}`} aria-selected={tab === name} aria-controls="write-tool" tabIndex={tab === name ? 0 : -1}
              onClick={() => setTab(name)}
              onKeyDown={(event) => {
                const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
                if (!step) return;
                const next = TABS[(TABS.findIndex(([each]) => each === tab) + step + TABS.length) % TABS.length]![0];
                setTab(next);
                document.getElementById(`tab-${next}`)?.focus();
              }}>{title}</button>)}
          </div>
          <div className="write-tool" id="write-tool" role="tabpanel" aria-labelledby={`tab-${tab}`} tabIndex={-1}>
            {tab === "node" && (node ? (
              <>
                <NodeActions node={node} parent={parent} siblings={parent?.children.length ?? 0} wrappers={wrappers} change={(edit) => void change(edit)} />
                <NodeForm path={path} text={text} node={node} palette={palette} change={(edit) => void change(edit)} />
              </>
            ) : tree ? (
              <TreeHead key={tree.name} name={tree.name} doc={tree.doc} ports={tree.ports} rename={(name) => void change({ do: "rename_tree", tree: tree.name, name }).then(() => setSelection({ id: head(name), scrolls: true }))} />
            ) : <p className="muted">Choose a node in the picture, or put the cursor on one in the text.</p>)}
            {tab === "add" && (palette ? <PalettePanel palette={palette} target={target?.words ?? "nothing: choose a node first"} add={(entry) => add(entry, target)} /> : <p className="loading">…</p>)}
            {tab === "rehearse" && <RehearsePanel path={path} text={text} result={rehearsal} onResult={setRehearsal} onNode={choose} />}
            {tab === "scene" && (mission?.scene ? <ScenePanel path={path} scene={mission.scene} key={mission.scene} /> : <p className="muted">The mission names no scene.</p>)}
          </div>
        </aside>
      </div>
      {menu && index?.node(menu.id) && <NodeMenu at={menu} node={index.node(menu.id)!} parent={index.parent(menu.id)} change={(edit) => void change(edit)} onAdd={showPalette} onClose={() => setMenu(null)} />}
    </div>
  );
}

const NO_MARKS: TreeMarks = {};

// A function that stays the same object, and does what the one of the last drawing does.
function useSteady<A extends unknown[]>(action: (...args: A) => void): (...args: A) => void {
  const last = useRef(action);
  last.current = action;
  return useCallback((...args: A) => last.current(...args), []);
}

// Where a new node goes: into a node that takes children, else behind the node among its siblings.
function addPlace(node: MissionNode | null, parent: MissionNode | null, nodes: NodeEntry[]): (Place & { words: string }) | null {
  if (!node) return null;
  const takes = node.listed || node.slots.length > 0;
  if (takes) {
    const slot = node.slots.includes("do") || node.listed ? "" : node.slots[0];
    const inside = node.children.filter((child) => !slot ? child.slot === "do" : child.slot === slot);
    return { parent: node.id, index: inside.length, slot: slot || undefined, words: `at the end of ${node.name}` };
  }
  if (!parent || !nodes.length) return null;
  const siblings = parent.children.filter((child) => child.slot === node.slot && child.label === node.label);
  return { parent: parent.id, index: siblings.findIndex((child) => child.id === node.id) + 1, slot: parent.listed || node.slot === "do" ? undefined : node.slot, words: `behind ${node.name}` };
}

function Faults({ faults, onShow, onFix }: { faults: TextFault[] | null; onShow(fault: TextFault): void; onFix(fault: TextFault): void }) {
  const errors = faults?.filter((each) => each.severity === "error").length ?? 0;
  const warnings = (faults?.length ?? 0) - errors;
  const found = [errors ? counted(errors, "error") : "", warnings ? counted(warnings, "warning") : ""].filter(Boolean).join(", ");
  return (
    <div className="write-faults">
      <p role="status">{faults === null ? "Checking…" : found ? <b>{found}</b> : "✓ No faults"}</p>
      {faults !== null && faults.length > 0 && (
        <ul>
          {faults.map((fault, number) => (
            <li key={number} className={fault.severity}>
              <button className="link" onClick={() => onShow(fault)}><span aria-hidden="true">{fault.severity === "error" ? "✗" : "!"}</span> {fault.line}:{fault.column}</button>
              <span>{fault.message} <small className="muted">{fault.code}</small></span>
              {fault.fix && <Button onClick={() => onFix(fault)}>Write {fault.fix.insert}</Button>}
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}

function TreeHead({ name, doc, ports, rename }: { name: string; doc: string; ports: { key: string; text: string }[]; rename(name: string): void }) {
  const [typed, setTyped] = useState(name);
  return (
    <div className="node-form">
      <h2>Tree {name}</h2>
      {doc && <p><Prose text={doc} /></p>}
      {ports.length > 0 && <ul>{ports.map((port) => <li key={port.key}><code>{port.key}</code> <span className="muted">{port.text}</span></li>)}</ul>}
      {name !== "Main" && (
        <form onSubmit={(event) => { event.preventDefault(); if (typed !== name) rename(typed); }} className="buttons">
          <input aria-label="Name of the tree" value={typed} onChange={(event) => setTyped(event.target.value)} />
          <Button type="submit" disabled={typed === name}>Rename with its calls</Button>
        </form>
      )}
    </div>
  );
}
