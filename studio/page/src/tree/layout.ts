// Places of the nodes of a tree, from left to right, parents beside the middle of their children.
//
// d3-flextree, as of drawn trees, needs some milliseconds for a thousand nodes; elk's layouts of trees took a second.

import { flextree } from "d3-flextree";

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

const BETWEEN = 10; // px between neighbours
const AWAY = 44; // px between a parent and its children

export function layOut(root: Box): Laid {
  const columns: number[] = [];
  const measure = (box: Box, depth: number) => {
    columns[depth] = Math.max(columns[depth] ?? 0, box.width);
    for (const child of box.children) measure(child, depth + 1);
  };
  measure(root, 0);
  const layout = flextree<Box>({ nodeSize: (node) => [node.data.height + BETWEEN, columns[node.depth]! + AWAY] });
  const tree = layout.hierarchy(root, (box) => box.children);
  layout(tree);
  const nodes = tree.descendants();
  const top = nodes.reduce((least, node) => Math.min(least, node.x - node.data.height / 2), 0);
  const places = new Map<string, { x: number; y: number }>();
  let [width, height] = [0, 0];
  for (const node of nodes) {
    const place = { x: node.y, y: node.x - node.data.height / 2 - top };
    places.set(node.data.id, place);
    width = Math.max(width, place.x + node.data.width);
    height = Math.max(height, place.y + node.data.height);
  }
  return { places, width, height };
}
