// Places of the nodes of a tree, from left to right, parents beside the middle of their children.
//
// Layout of van der Ploeg (2014), "Drawing Non-layered Tidy Trees in Linear Time", with one column for each depth: a contour is a
// number for each depth then. d3-flextree lays out the same, but took a third of the work of a fold in a large tree.

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

// A node with those below it; lengths in px from the middle of the node, downwards.
interface Branch {
  box: Box;
  children: Branch[];
  offset: number; // of the node from its parent
  top: number[]; // of the branch at each depth
  bottom: number[];
}

const BETWEEN = 10; // px between neighbours
const AWAY = 44; // px between a parent and its children

export function layOut(root: Box): Laid {
  const columns: number[] = []; // widths
  const tree = arrange(root, 0, columns);
  const places = new Map<string, { x: number; y: number }>();
  const top = tree.top.reduce((least, each) => Math.min(least, each + BETWEEN / 2), 0);
  let [width, height] = [0, 0];
  const add = ({ box, children }: Branch, depth: number, x: number, middle: number) => {
    const y = middle - box.height / 2;
    places.set(box.id, { x, y });
    width = Math.max(width, x + box.width);
    height = Math.max(height, y + box.height);
    for (const child of children) add(child, depth + 1, x + columns[depth]! + AWAY, middle + child.offset);
  };
  add(tree, 0, 0, -top);
  return { places, width, height };
}

function arrange(box: Box, depth: number, columns: number[]): Branch {
  columns[depth] = Math.max(columns[depth] ?? 0, box.width);
  const half = (box.height + BETWEEN) / 2;
  const children = box.children.map((child) => arrange(child, depth + 1, columns));
  const [top, bottom, lowest]: [number[], number[], number[]] = [[], [], []]; // lowest: number of the last child that reaches a depth
  children.forEach((child, number) => {
    child.offset = (bottom[0] ?? child.top[0]!) - child.top[0]!;
    for (let d = 1; d < Math.min(bottom.length, child.top.length); d++) {
      const over = bottom[d]! - child.offset - child.top[d]!;
      if (over <= 0) continue;
      child.offset += over;
      // The children between the two that touch share the gap.
      const first = lowest[d]!;
      for (let k = first + 1; k < number; k++) children[k]!.offset += (over * (k - first)) / (number - first);
    }
    for (let d = 0; d < child.top.length; d++) {
      top[d] ??= child.offset + child.top[d]!;
      bottom[d] = child.offset + child.bottom[d]!;
      lowest[d] = number;
    }
  });
  const middle = children.length ? (top[0]! + bottom[0]!) / 2 : 0;
  for (const child of children) child.offset -= middle;
  return { box, children, offset: 0, top: [-half, ...top.map((y) => y - middle)], bottom: [half, ...bottom.map((y) => y - middle)] };
}
