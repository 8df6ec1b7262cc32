// Places of the nodes of a tree: parents to the left of their children, siblings below each other in their order.
//
// Each sub-tree has a band of its own, so that a node is found where its order says. One pass each way: a tree of a
// thousand nodes takes a few milliseconds, which general layouts of graphs do not.

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

const BETWEEN = 10; // px between siblings
const COUSINS = 6; // px more between sub-trees
const STEP = 44; // px between parent and child
const MARGIN = 12;

export function layOut(root: Box): Laid {
  const places = new Map<string, { x: number; y: number }>();
  let width = 0;
  // Places a sub-tree from `top` on; returns the end of its band and the middle of its root.
  const place = (box: Box, x: number, top: number): { end: number; middle: number } => {
    width = Math.max(width, x + box.width);
    let end = top;
    let first = 0;
    let last = 0;
    box.children.forEach((child, number) => {
      const gap = number ? BETWEEN + (child.children.length || box.children[number - 1]!.children.length ? COUSINS : 0) : 0;
      const laid = place(child, x + box.width + STEP, end + gap);
      if (!number) first = laid.middle;
      last = laid.middle;
      end = laid.end;
    });
    let middle = box.children.length ? (first + last) / 2 : top + box.height / 2;
    middle = Math.max(middle, top + box.height / 2);
    places.set(box.id, { x, y: middle - box.height / 2 });
    return { end: Math.max(end, middle + box.height / 2), middle };
  };
  const { end } = place(root, MARGIN, MARGIN);
  return { places, width: width + MARGIN, height: end + MARGIN };
}
