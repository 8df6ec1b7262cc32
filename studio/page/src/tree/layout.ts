// Places of the nodes of a tree, computed by elk in a worker of its own.

import ELK from "elkjs/lib/elk-api";
import type { ElkNode } from "elkjs/lib/elk-api";

export interface Laid {
  places: Map<string, { x: number; y: number }>;
  width: number;
  height: number;
}

export interface Box {
  id: string;
  width: number;
  height: number;
  children: Box[];
}

let elk: InstanceType<typeof ELK> | null = null;

const OPTIONS = {
  "elk.algorithm": "mrtree",
  "elk.direction": "RIGHT",
  "elk.spacing.nodeNode": "10",
  "elk.mrtree.weighting": "MODEL_ORDER",
  "elk.mrtree.searchOrder": "DFS",
  "elk.padding": "[top=12,left=12,bottom=12,right=12]",
};

export async function layOut(root: Box): Promise<Laid> {
  elk ??= new ELK({ workerUrl: "/page/elk.js" });
  const children: ElkNode[] = [];
  const edges: { id: string; sources: string[]; targets: string[] }[] = [];
  const add = (box: Box) => {
    children.push({ id: box.id, width: box.width, height: box.height });
    for (const child of box.children) {
      edges.push({ id: `${edges.length}`, sources: [box.id], targets: [child.id] });
      add(child);
    }
  };
  add(root);
  const graph: ElkNode = { id: "\u0000graph", layoutOptions: OPTIONS, children, edges };
  const laid: ElkNode = await elk.layout(graph);
  const places = new Map((laid.children ?? []).map((each) => [each.id, { x: each.x ?? 0, y: each.y ?? 0 }]));
  return { places, width: laid.width ?? 0, height: laid.height ?? 0 };
}
