// What the server says of a mission's text, and the picture made of it. Places count in UTF-16 units: those of trees
// from the beginning of the text, those of nodes and ports from the beginning of their tree.

import type { PortEntry, SlotEntry } from "../records";
import type { TreeNode } from "../tree/TreeView";

export interface Port {
  key: string;
  text: string;
  start: number;
  end: number;
}

export interface MissionNode {
  id: string;
  identity: string;
  name: string;
  symbol: string;
  slot: string;
  label: string;
  // Label of its branch, as "when grasp.missed".
  shown: string;
  // A Sequence that is written as a bare list: it has no ports.
  listed: boolean;
  aliased: boolean;
  start: number;
  end: number;
  ports: Port[];
  slots: string[];
  children: MissionNode[];
}

interface TreeContent {
  // A name of the content: it is the same for the same content, and sent alone for one that the page has.
  content: string;
  doc: string;
  ports: Port[];
  root: MissionNode | null;
}

export interface MissionTree extends TreeContent {
  name: string;
  start: number;
  end: number;
}

export interface Mission {
  readable: boolean;
  // False while the text has a fault of form: the picture is made of what could be read.
  whole: boolean;
  name: string;
  scene: string;
  left_out: string;
  trees: MissionTree[];
}

export interface Change {
  from: number;
  to: number;
  insert: string;
}

export interface TextFault {
  from: number;
  to: number;
  line: number;
  column: number;
  message: string;
  code: string;
  severity: "error" | "warning";
  elsewhere: boolean;
  fix: Change | null;
}

export interface NodeEntry {
  id: string;
  kind: string;
  symbol: string;
  summary: string;
  doc: string;
  ports: PortEntry[];
  slots: SlotEntry[];
  include: string;
  wraps?: boolean;
}

export interface CommonEntry {
  key: string;
  doc: string;
  type: string;
  choices: string[];
}

export interface Palette {
  nodes: NodeEntry[];
  common: CommonEntry[];
}

export interface Place {
  parent: string;
  index: number;
  slot?: string;
  label?: string;
}

export type Edit =
  | { do: "set"; node: string; key: string; value: string }
  | { do: "add"; place: Place; identity: string; include?: string }
  | { do: "remove" | "unwrap"; node: string }
  | { do: "move"; node: string; place: Place }
  | { do: "wrap" | "replace"; node: string; identity: string }
  | { do: "rename_tree"; tree: string; name: string };

export interface Edited {
  changes: Change[];
  selected: string;
  tree: Mission;
}

// An answer with the contents that the page had when it asked.
export function completed(answer: Mission, had: Mission | null): Mission {
  const contents = new Map(had?.trees.map(({ content, doc, ports, root }) => [content, { doc, ports, root }]));
  return { ...answer, trees: answer.trees.map((tree) => ({ ...tree, ...contents.get(tree.content) })) };
}

// Nodes by id, with their parents.
export class Index {
  private readonly found = new Map<string, { node: MissionNode; parent: MissionNode | null; tree: MissionTree }>();

  constructor(readonly mission: Mission) {
    for (const tree of mission.trees) if (tree.root) this.add(tree.root, null, tree);
  }

  private add(node: MissionNode, parent: MissionNode | null, tree: MissionTree): void {
    this.found.set(node.id, { node, parent, tree });
    for (const child of node.children) this.add(child, node, tree);
  }

  // Where the node stands in the text.
  span(id: string): { from: number; to: number } | null {
    const found = this.found.get(id);
    return found ? { from: found.tree.start + found.node.start, to: found.tree.start + found.node.end } : null;
  }

  node(id: string): MissionNode | null {
    return this.found.get(id)?.node ?? null;
  }

  parent(id: string): MissionNode | null {
    return this.found.get(id)?.parent ?? null;
  }

  // The innermost node at a place of the text, else the tree's head.
  at(place: number): string {
    for (const tree of this.mission.trees) {
      if (place < tree.start || place > tree.end) continue;
      let id = head(tree.name);
      let node = tree.root;
      const inside = place - tree.start;
      while (node && inside >= node.start && inside <= node.end) {
        id = node.id;
        node = node.children.find((child) => inside >= child.start && inside <= child.end) ?? null;
      }
      return id;
    }
    return "";
  }
}

// The id of a tree's card, which no node has.
export const head = (tree: string) => `/${tree}`;
export const treeOfHead = (id: string) => (id.startsWith("/") ? id.slice(1) : "");

const DETAIL = 46;
// Of nodes whose tree's text has not changed.
const cards = new WeakMap<MissionNode, TreeNode>();

// The picture of all trees, or of one. Cards that are as they were in `before` are the same objects.
export function picture(mission: Mission, only: string, before: TreeNode | null): TreeNode {
  const share = (made: TreeNode, old: TreeNode | undefined): TreeNode => {
    const same = old && old.name === made.name && old.kind === made.kind && old.detail === made.detail && old.children.length === made.children.length &&
      old.children.every((child, number) => child === made.children[number]);
    return same ? old : made;
  };
  const card = (node: MissionNode, old: TreeNode | undefined): TreeNode => {
    const drawn = cards.get(node);
    if (drawn) return drawn;
    const children = node.children.map((child, place) => card(child, old && (old.children[place]?.id === child.id ? old.children[place] : old.children.find((each) => each.id === child.id))));
    const made = share({ id: node.id, name: nameOf(node), kind: node.symbol === "unknown" ? "action" : node.symbol, detail: detailOf(node), children }, old);
    cards.set(node, made);
    return made;
  };
  const old = new Map((before?.id === "" ? before.children : before ? [before] : []).map((tree) => [tree.id, tree]));
  const trees = mission.trees.filter((tree) => !only || tree.name === only).map((tree): TreeNode => {
    const drawn = old.get(head(tree.name));
    return share({
      id: head(tree.name),
      name: tree.name,
      kind: "subtree",
      detail: tree.ports.map((port) => port.key).join(", ") || undefined,
      children: tree.root ? [card(tree.root, drawn?.children[0])] : [],
    }, drawn);
  });
  if (trees.length === 1) return trees[0]!;
  return share({ id: "", name: mission.name || "mission", kind: "sequence", children: trees }, before ?? undefined);
}

function nameOf(node: MissionNode): string {
  const numbered = node.name.startsWith(`${node.identity}#`);
  const own = node.listed || numbered || node.name === node.identity ? "" : node.name;
  const name = own ? `${own} (${node.identity})` : node.listed ? "in turn" : node.identity;
  return !node.shown ? name : node.listed ? node.shown : `${node.shown}: ${name}`;
}

function detailOf(node: MissionNode): string | undefined {
  const ports = node.ports.filter((port) => port.key !== "name").map((port) => `${port.key}: ${port.text}`).join(", ");
  return ports.length > DETAIL ? `${ports.slice(0, DETAIL - 1)}…` : ports || undefined;
}
