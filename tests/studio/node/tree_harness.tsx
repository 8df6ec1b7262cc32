// A tree of a thousand nodes alone on a page, for the tests.

import { useState } from "react";
import { createRoot } from "react-dom/client";

import { TreeView } from "../../../apps/studio/page/src/tree/TreeView";
import type { TreeMarks, TreeNode } from "../../../apps/studio/page/src/tree/TreeView";

declare global {
  var selected: string;
  var count: number;
}

const SIZE = 1000;
const nodes: TreeNode[] = Array.from({ length: SIZE }, (_, k) => ({ id: `n${k}`, name: `Node ${k}`, kind: k % 4 ? "action" : "sequence", detail: k % 3 ? undefined : `item: "{item_${k}}"`, children: [] }));
for (let k = 1; k < SIZE; k++) nodes[Math.floor((k - 1) / 5)]!.children.push(nodes[k]!);
const marks: TreeMarks = { n1: { status: "failure", faults: 2 }, n2: { status: "running", breakpoint: true } };

function Harness() {
  const [selected, setSelected] = useState<string>();
  globalThis.selected = selected ?? "";
  globalThis.count = SIZE;
  return <div style={{ height: "100vh" }}><TreeView root={nodes[0]!} marks={marks} selected={selected} onSelect={setSelected} /></div>;
}

createRoot(document.getElementById("root")!).render(<Harness />);
