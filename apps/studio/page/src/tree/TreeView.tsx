// A tree of nodes with their statuses. It makes no calls: whoever shows it gives the tree and the marks.
//
// Arrow keys go to parent, child and siblings, Enter and Space choose, + and − fold, the menu key opens the menu.

import { Background, Controls, Position, ReactFlow, ReactFlowProvider, ViewportPortal, useReactFlow, useStore } from "@xyflow/react";
import type { Node, NodeHandle, NodeProps } from "@xyflow/react";
import { createContext, memo, useCallback, useContext, useEffect, useLayoutEffect, useMemo, useRef, useState } from "react";
import type { JSX, KeyboardEvent } from "react";

import { NodeSymbol } from "../ui/Icon";
import { counted } from "../ui/words";
import { layOut } from "./layout";
import type { Box, Laid } from "./layout";
import { Cards, Lines } from "./Outlines";
import type { Outline } from "./Outlines";

export interface TreeNode {
  id: string;
  name: string;
  // A symbol of drawn trees: action, condition, sequence, fallback, recover, subtree, …
  kind: string;
  detail?: string;
  children: TreeNode[];
  collapsedByDefault?: boolean;
}

export type TreeStatus = "running" | "success" | "failure" | "skipped" | "idle";

export interface TreeMarks {
  [id: string]: { status?: TreeStatus; faults?: number; breakpoint?: boolean; coverage?: number };
}

export interface TreeViewProps {
  root: TreeNode;
  marks: TreeMarks;
  selected?: string;
  onSelect(id: string): void;
  onMenu?(id: string, at: { x: number; y: number }): void;
  onMove?(id: string, parent: string, index: number): void;
  className?: string;
}

const HEIGHT = 30;
const WIDTH_STEP = 20; // px: while one types a value, cards seldom change their size
const MARGIN = 16;
const READABLE = 0.6; // zoom below which the text is hard to read
const LARGE_ZOOM = 0.9;
const FAR = 0.4; // zoom below which no word can be read: cards are drawn as plain rectangles
const WITH_DETAIL = 46;
const STATUS_SIGNS: Record<TreeStatus, string> = { running: "▶", success: "✓", failure: "✗", skipped: "–", idle: "·" };
const FAMILIES: Record<string, string> = {
  action: "action", clock: "action", force: "decorator", condition: "condition", decorator: "decorator", not: "decorator", loop: "decorator",
  subtree: "subtree", recover: "cure",
};

type CardData = { node: TreeNode; folded: boolean };
type Card = Node<CardData, "card">;

interface Shared {
  marks: TreeMarks;
  selected?: string;
  fold(id: string): void;
}
const SharedContext = createContext<Shared>({ marks: {}, fold: () => undefined });

// Drawn again only when a property changes: give it the same functions, and the same objects for nodes that stay.
export const TreeView = memo(function TreeView(props: TreeViewProps): JSX.Element {
  return (
    <ReactFlowProvider>
      <Tree {...props} />
    </ReactFlowProvider>
  );
});

function Tree({ root, marks, selected, onSelect, onMenu, onMove, className }: TreeViewProps) {
  const [changed, setChanged] = useState<ReadonlyMap<string, boolean>>(new Map());
  const [drops, setDrops] = useState(0);
  const flow = useReactFlow<Card>();
  const host = useRef<HTMLDivElement>(null);
  const fitted = useRef(false);
  const isFolded = useCallback((node: TreeNode) => node.children.length > 0 && (changed.get(node.id) ?? node.collapsedByDefault ?? false), [changed]);

  const shown = useMemo(() => collect(root, isFolded), [root, isFolded]);
  // Most edits change no size: then all stays where it is.
  const boxes = useSame(useMemo(() => boxOf(root, isFolded), [root, isFolded]), sameBox);
  const laid = useMemo(() => layOut(boxes), [boxes]);

  // What is folded stays where it is on the screen, while the rest moves.
  const anchor = useRef<{ id: string; x: number; y: number } | null>(null);
  useLayoutEffect(() => {
    const before = anchor.current;
    anchor.current = null;
    const after = before && laid.places.get(before.id);
    if (!before || !after) return;
    const { x, y, zoom } = flow.getViewport();
    void flow.setViewport({ x: x + (before.x - after.x) * zoom, y: y + (before.y - after.y) * zoom, zoom });
  }, [laid, flow]);
  const foldIt = useRef<(id: string) => void>(undefined);
  foldIt.current = (id) => {
    const place = laid.places.get(id);
    anchor.current = place ? { id, ...place } : null;
    const node = find(root, id);
    if (!node?.children.length) return;
    const folded = isFolded(node);
    setChanged((before) => new Map(before).set(id, !folded));
    // The choice is never hidden: it goes to what is folded, and comes back when it is chosen again.
    if (!folded && selected !== undefined && above(node, selected).length) onSelect(id);
  };
  const fold = useCallback((id: string) => foldIt.current!(id), []); // the same one always: cards need not be drawn again

  // Cards that stay the same keep their objects, so that only the others cost something. Those of folded branches are kept as hidden:
  // for each that is taken away, React Flow throws and catches several errors before its element goes.
  const made = useRef(new Map<string, Card>());
  const movable = Boolean(onMove);
  const every = useMemo(() => everyNode(root), [root]);
  const nodes = useMemo<Card[]>(() => {
    const before = made.current;
    const cards = every.map((node): Card => {
      const old = before.get(node.id);
      const place = laid.places.get(node.id);
      const position = place ?? old?.position ?? ORIGIN;
      const [hidden, folded] = [!place, isFolded(node)];
      const draggable = movable && node.id !== root.id;
      const same = old && old.data.node === node && old.data.folded === folded;
      if (same && old.position.x === position.x && old.position.y === position.y && old.draggable === draggable && old.hidden === hidden) return old;
      return { id: node.id, type: "card", position, data: same ? old.data : { node, folded }, width: widthOf(node), height: heightOf(node), handles: HANDLES, hidden, draggable, focusable: false };
    });
    made.current = new Map(cards.map((card) => [card.id, card]));
    return cards;
    // A card that was dropped where it cannot go returns: `drops` makes it anew.
  }, [laid, every, isFolded, movable, root.id, drops]);
  // From afar no words can be read, and a thousand cards of a document are slow: rectangles stand for them.
  const far = useStore((store) => store.transform[2] < FAR);
  const drawn = useSame(useMemo(() => [...shown.values()].map(({ node, parent }): Outline => ({
    id: node.id, parent, family: FAMILIES[node.kind] ?? "control", width: widthOf(node), height: heightOf(node), ...laid.places.get(node.id)!,
  })), [shown, laid]), sameOutlines);

  const whole = useCallback(() => {
    const box = host.current!.getBoundingClientRect();
    const zoom = Math.min(1, (box.width - 2 * MARGIN) / laid.width, (box.height - 2 * MARGIN) / laid.height);
    return { x: (box.width - zoom * laid.width) / 2, y: (box.height - zoom * laid.height) / 2, zoom };
  }, [laid]);
  const showAll = () => void flow.setViewport(whole());
  useEffect(() => {
    if (fitted.current) return;
    fitted.current = true;
    const [all, start] = [whole(), laid.places.get(root.id)!];
    // All of it where that can be read, else its root at the left edge.
    if (all.zoom >= READABLE) void flow.setViewport(all);
    else void flow.setViewport({ x: MARGIN, y: host.current!.clientHeight / 2 - start.y * LARGE_ZOOM, zoom: LARGE_ZOOM });
  }, [laid, flow, root.id, whole]);

  const keys = (event: KeyboardEvent) => {
    const here = shown.get(selected ?? root.id) ?? shown.get(root.id)!;
    const siblings = here.parent !== undefined ? shown.get(here.parent)!.node.children : [here.node];
    const place = siblings.findIndex((each) => each.id === here.node.id);
    const to: Record<string, string | undefined> = {
      ArrowLeft: here.parent,
      ArrowRight: here.folded ? undefined : here.node.children[0]?.id,
      ArrowDown: siblings[place + 1]?.id,
      ArrowUp: siblings[place - 1]?.id,
      Home: root.id,
    };
    if (event.key in to) {
      event.preventDefault();
      const id = to[event.key];
      if (id !== undefined) choose(id);
    } else if (event.key === "+" || event.key === "-") {
      event.preventDefault();
      if (here.folded === (event.key === "+")) fold(here.node.id);
    } else if ((event.key === "ContextMenu" || (event.key === "F10" && event.shiftKey)) && onMenu) {
      event.preventDefault();
      const card = host.current!.querySelector(`[data-tree-node="${CSS.escape(here.node.id)}"]`)?.getBoundingClientRect();
      onMenu(here.node.id, { x: card?.left ?? 0, y: card?.bottom ?? 0 });
    } else if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      onSelect(here.node.id);
    }
  };
  const choose = (id: string) => {
    onSelect(id);
    bring(id);
  };
  // Moves the view only when the node is out of it.
  const bring = (id: string) => {
    const place = laid.places.get(id);
    const box = host.current?.getBoundingClientRect();
    if (!place || !box) return;
    const at = flow.flowToScreenPosition(place);
    const { zoom } = flow.getViewport();
    const node = shown.get(id)!.node;
    const inside = at.x >= box.left && at.y >= box.top && at.x + widthOf(node) * zoom <= box.right && at.y + HEIGHT * zoom <= box.bottom;
    if (!inside) void flow.setCenter(place.x + widthOf(node) / 2, place.y + HEIGHT / 2, { zoom });
  };
  // A node that was chosen elsewhere comes into view, out of branches that are folded.
  const bringIt = useRef(bring);
  bringIt.current = bring;
  const hidden = selected !== undefined && !shown.has(selected);
  const brought = useRef<string>(undefined);
  useEffect(() => {
    if (selected === undefined || brought.current === selected) return;
    if (hidden) setChanged((before) => new Map([...before, ...above(root, selected).map((id) => [id, false] as const)]));
    else {
      brought.current = selected; // from now on it may be folded away, and the view may leave it
      bringIt.current(selected);
    }
  }, [selected, hidden, root]);
  // Also when the view gets smaller, as by the details of the node below it.
  const last = useRef(selected);
  last.current = selected;
  useEffect(() => {
    const watch = new ResizeObserver(() => { if (last.current !== undefined) bringIt.current(last.current); });
    watch.observe(host.current!);
    return () => watch.disconnect();
  }, []);
  const tree = useRef<HTMLDivElement>(null);
  const owned = useMemo(() => [...shown.values()].map(({ node }) => elementIdOf(node)).join(" "), [shown]);
  const shared = useMemo<Shared>(() => ({ marks, selected, fold }), [marks, selected, fold]);
  const active = selected && shown.has(selected) ? elementId(selected) : undefined;
  // A card out of view is not drawn, and none that is not there may be named as the active one.
  const nameActive = () => {
    if (active && document.getElementById(active)) tree.current?.setAttribute("aria-activedescendant", active);
    else tree.current?.removeAttribute("aria-activedescendant");
  };
  useEffect(() => {
    nameActive();
    const drawn = requestAnimationFrame(() => requestAnimationFrame(nameActive));
    return () => cancelAnimationFrame(drawn);
  });

  const at = ({ clientX, clientY }: { clientX: number; clientY: number }) => {
    const { x, y } = flow.screenToFlowPosition({ x: clientX, y: clientY });
    return drawn.find((each) => x >= each.x && y >= each.y && x <= each.x + each.width && y <= each.y + each.height)?.id;
  };

  // A dropped card goes before, behind or into the card below it, or among the children of the nearest parent by height.
  const dropped = (_: unknown, card: Card) => {
    if (!onMove) return;
    const target = dropTarget(card, shown, laid);
    made.current.delete(card.id);
    setDrops((n) => n + 1);
    if (target) onMove(card.id, target.parent, target.index);
  };

  return (
    <div className={`tree-view ${className ?? ""}`} ref={host} onKeyDown={keys} onPointerUp={() => { if (!host.current!.contains(document.activeElement)) tree.current!.focus({ preventScroll: true }); }}>
      {/* The cards are drawn among what is no tree; this is the tree that has the focus and owns them. */}
      <div ref={tree} className="tree-keys" role="tree" aria-label={`Tree of ${root.name}`} tabIndex={0} aria-owns={owned} />
      <SharedContext.Provider value={shared}>
        <ReactFlow
          nodes={far ? NONE : nodes} nodeTypes={NODE_TYPES} onlyRenderVisibleElements minZoom={0.02} maxZoom={2}
          nodesConnectable={false} elementsSelectable={false} nodesFocusable={false} edgesFocusable={false} disableKeyboardA11y
          proOptions={{ hideAttribution: false }}
          onNodeClick={(_, card) => onSelect(card.id)}
          onNodeDoubleClick={(_, card) => fold(card.id)}
          onNodeContextMenu={(event, card) => { if (onMenu) { event.preventDefault(); onMenu(card.id, { x: event.clientX, y: event.clientY }); } }}
          onNodeDragStop={onMove ? dropped : undefined}
          onMoveStart={() => host.current!.classList.add("moving")}
          onMoveEnd={() => { host.current!.classList.remove("moving"); requestAnimationFrame(nameActive); }}
          onPaneClick={far ? (event) => { const id = at(event); if (id !== undefined) onSelect(id); } : undefined}
          onPaneContextMenu={far && onMenu ? (event) => { const id = at(event); if (id === undefined) return; event.preventDefault(); onMenu(id, { x: event.clientX, y: event.clientY }); } : undefined}
        >
          <ViewportPortal>
            <Lines shown={drawn} />
            {far && <Cards shown={drawn} marks={marks} selected={selected} />}
          </ViewportPortal>
          <Background gap={24} />
          <Controls showInteractive={false} onFitView={showAll} />
        </ReactFlow>
      </SharedContext.Provider>
    </div>
  );
}

const CardView = memo(function CardView({ data }: NodeProps<Card>) {
  const { marks, selected, fold } = useContext(SharedContext);
  const { node, folded } = data;
  const mark = marks[node.id];
  const status = mark?.status;
  const family = FAMILIES[node.kind] ?? "control";
  const words = [node.detail ? `${node.name} ${node.detail}` : node.name, status && status !== "idle" ? status : "", mark?.faults ? counted(mark.faults, "fault") : "", mark?.breakpoint ? "breakpoint" : "",
    mark?.coverage !== undefined ? `covered ${Math.round(mark.coverage * 100)} %` : ""].filter(Boolean);
  return (
    <div className={`tree-card ${family} ${status ?? ""} ${selected === node.id ? "selected" : ""} ${mark?.coverage === 0 ? "uncovered" : ""}`}
      id={elementIdOf(node)} data-tree-node={node.id} role="treeitem" aria-label={words.join(", ")} aria-selected={selected === node.id}
      aria-expanded={node.children.length ? !folded : undefined}>
      {mark?.breakpoint && <span className="tree-breakpoint" title="Breakpoint" />}
      <NodeSymbol symbol={node.kind} />
      <span className="tree-name"><b>{node.name}</b>{" "}{node.detail && <small>{node.detail}</small>}</span>
      {mark?.faults ? <span className="tree-faults" title={counted(mark.faults, "fault")}>{mark.faults}</span> : null}
      {mark?.coverage !== undefined && <span className={`tree-coverage${mark.coverage < 1 ? " partly" : ""}`} aria-hidden="true">{mark.coverage < 1 ? `${Math.round(mark.coverage * 100)} %` : "✓"}</span>}
      {status && <span className="tree-status" aria-hidden="true">{STATUS_SIGNS[status]}</span>}
      {node.children.length > 0 && (
        <button className="tree-fold nodrag" tabIndex={-1} aria-label={folded ? `Unfold ${node.name}` : `Fold ${node.name}`}
          onClick={(event) => { event.stopPropagation(); fold(node.id); }}>{folded ? `+${count(node) - 1}` : "−"}</button>
      )}
    </div>
  );
});
// Names of nodes may have blanks, ids of elements none.
const elementIds = new WeakMap<TreeNode, string>();
function elementIdOf(node: TreeNode): string {
  let known = elementIds.get(node);
  if (known === undefined) elementIds.set(node, (known = elementId(node.id)));
  return known;
}
const elementId = (id: string) => `tree-${encodeURIComponent(id)}`;
const NODE_TYPES = { card: CardView };
const NONE: Card[] = [];
// Cards without them are all drawn once to be measured, in view or not.
const HANDLES: NodeHandle[] = [{ type: "source", position: Position.Right, x: 0, y: 0 }];

const ORIGIN = { x: 0, y: 0 };

const everyNode = (node: TreeNode): TreeNode[] => [node, ...node.children.flatMap(everyNode)];

interface Shown {
  node: TreeNode;
  parent?: string;
  folded: boolean;
}

function collect(root: TreeNode, isFolded: (node: TreeNode) => boolean): Map<string, Shown> {
  const found = new Map<string, Shown>();
  const add = (node: TreeNode, parent?: string) => {
    const folded = isFolded(node);
    found.set(node.id, { node, parent, folded });
    if (!folded) for (const child of node.children) add(child, node.id);
  };
  add(root);
  return found;
}

// The last value that was not the same as the one before it.
function useSame<T>(value: T, same: (a: T, b: T) => boolean): T {
  const last = useRef(value);
  if (last.current !== value && !same(last.current, value)) last.current = value;
  return last.current;
}

const sameBox = (a: Box, b: Box): boolean => a.id === b.id && a.width === b.width && a.height === b.height && a.children.length === b.children.length &&
  a.children.every((child, number) => sameBox(child, b.children[number]!));
const sameOutlines = (a: Outline[], b: Outline[]): boolean => a.length === b.length && a.every((each, number) => {
  const other = b[number]!;
  return each.id === other.id && each.parent === other.parent && each.family === other.family && each.width === other.width && each.height === other.height &&
    each.x === other.x && each.y === other.y;
});

function boxOf(node: TreeNode, isFolded: (node: TreeNode) => boolean): Box {
  const children = isFolded(node) ? [] : node.children.map((child) => boxOf(child, isFolded));
  return { id: node.id, width: widthOf(node), height: heightOf(node), children };
}

function find(node: TreeNode, id: string): TreeNode | null {
  if (node.id === id) return node;
  for (const child of node.children) {
    const found = find(child, id);
    if (found) return found;
  }
  return null;
}

// The ids of the nodes above a node, from the root on; none when it is not in the tree.
function above(node: TreeNode, id: string): string[] {
  for (const child of node.children) {
    if (child.id === id) return [node.id];
    const found = above(child, id);
    if (found.length) return [node.id, ...found];
  }
  return [];
}

const counts = new WeakMap<TreeNode, number>();
function count(node: TreeNode): number {
  let known = counts.get(node);
  if (known === undefined) {
    known = node.children.reduce((sum, child) => sum + count(child), 1);
    counts.set(node, known);
  }
  return known;
}

const widths = new WeakMap<TreeNode, number>();
function widthOf(node: TreeNode): number {
  let known = widths.get(node);
  if (known === undefined) {
    const letters = Math.max(node.name.length * 7.4, (node.detail?.length ?? 0) * 6);
    known = Math.min(Math.max(Math.ceil((letters + 104) / WIDTH_STEP) * WIDTH_STEP, 130), 300);
    widths.set(node, known);
  }
  return known;
}

const heightOf = (node: TreeNode) => (node.detail ? WITH_DETAIL : HEIGHT);

function dropTarget(card: Card, boxes: Map<string, Shown>, laid: Laid): { parent: string; index: number } | null {
  const inside = new Set<string>();
  const mark = (node: TreeNode) => {
    inside.add(node.id);
    node.children.forEach(mark);
  };
  mark(card.data.node);
  const middle = { x: card.position.x, y: card.position.y + HEIGHT / 2 };
  let best: { parent: string; index: number; distance: number } | null = null;
  for (const { node, folded, parent } of boxes.values()) {
    if (inside.has(node.id)) continue;
    const place = laid.places.get(node.id);
    if (!place) continue;
    const over = middle.x >= place.x && middle.x <= place.x + widthOf(node) && middle.y >= place.y && middle.y <= place.y + heightOf(node);
    if (over) {
      // The upper edge is the place before it, the lower one that behind it; a leaf has nothing between them.
      const leaf = !node.children.length && ["action", "condition"].includes(FAMILIES[node.kind] ?? "");
      const edge = leaf ? 0.5 : 0.25;
      const part = (middle.y - place.y) / heightOf(node);
      const siblings = parent === undefined ? [] : boxes.get(parent)!.node.children.filter((child) => !inside.has(child.id));
      const number = siblings.findIndex((child) => child.id === node.id);
      if (parent !== undefined && part < edge) return { parent, index: number };
      if (parent !== undefined && part >= 1 - edge) return { parent, index: number + 1 };
      return { parent: node.id, index: node.children.length };
    }
    const children = folded ? [] : node.children.filter((child) => !inside.has(child.id));
    if (!children.length) continue;
    const at = children.map((child) => laid.places.get(child.id)).filter((each) => each !== undefined);
    const column = at[0]!.x;
    const [top, bottom] = [at[0]!.y, at[at.length - 1]!.y + HEIGHT];
    const outside = Math.max(top - middle.y, middle.y - bottom, 0);
    // Just above the first or below the last of its siblings it stays one of them, though others may be near.
    const own = boxes.get(card.id)?.parent === node.id ? 2 * HEIGHT : 0;
    const distance = Math.abs(middle.x - column) + 2 * outside - own;
    const index = at.filter((each) => each.y + HEIGHT / 2 < middle.y).length;
    if (distance < 200 && (!best || distance < best.distance)) best = { parent: node.id, index, distance };
  }
  return best && { parent: best.parent, index: best.index };
}
