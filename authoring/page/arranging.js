// Where everything stands: the tree as it is opened, every sub-tree in a frame of its own. No DOM here.

const BESIDE = 44; // pixels between a node and its children
const BETWEEN = 10; // between two nodes above one another
const INSET = 16; // between a frame and what it holds
const PILL_GAP = 12; // between a label and its node

// One node of the running tree. `node` is what the chart says of it; a sub-tree holds the root of its tree.
class Item {
  constructor(chart, node, path, parent, level) {
    Object.assign(this, { chart, node, path, parent, level, open: !node.calls });
    this.kids = null;
  }

  // Nodes below it in the same tree, made when they are asked for.
  get children() {
    if (this.kids === null) {
      const tree = this.chart.trees[this.node.calls];
      const below = tree ? [tree.root] : this.node.children;
      this.kids = below.map(
        (node) => new Item(this.chart, node, `${this.path}/${node.name}`, this, this.level + 1),
      );
    }
    return this.kids;
  }

  get isCall() {
    return Boolean(this.node.calls);
  }

  get canOpen() {
    return this.isCall || this.node.children.length > 0;
  }

  get isFrame() {
    return this.isCall && this.open;
  }

  *shown() {
    yield this;
    if (this.open) for (const child of this.children) yield* child.shown();
  }

  find(path) {
    if (path === this.path) return this;
    const next = this.children.find((child) => path === child.path || path.startsWith(`${child.path}/`));
    return next ? next.find(path) : null;
  }
}

// The root of the running tree: the tree `Main`, or the first one where there is no Main.
function rootItem(chart) {
  const name = chart.order[0];
  const tree = chart.trees[name];
  const node = { ...tree.call, calls: name, name, children: [] };
  const item = new Item(chart, node, name, null, 1);
  item.open = true;
  return item;
}

// Opens sub-trees, those nearest to the root first, and closes again each after which `holds` is not true.
function openWhile(root, holds) {
  const waiting = callsIn(root);
  while (waiting.length) {
    const item = waiting.shift();
    item.open = true;
    if (holds()) waiting.push(...callsIn(item.children[0]));
    else item.open = false;
  }
}

// Opens everything, as long as no more than `most` nodes are shown.
function openUpTo(root, most) {
  for (const item of root.shown()) if (!item.isCall) item.open = true;
  let count = [...root.shown()].length;
  const waiting = callsIn(root);
  while (waiting.length) {
    const item = waiting.shift();
    item.open = true;
    const added = [...item.shown()].length - 1;
    if (count + added > most) {
      item.open = false;
      continue;
    }
    count += added;
    waiting.push(...callsIn(item.children[0]));
  }
}

// The closed sub-trees that are shown at or below an item, from the top down.
function callsIn(item) {
  return [...item.shown()].filter((below) => below.isCall && !below.open).sort((a, b) => a.level - b.level);
}

// Gives every shown item `x`, `y`, `width`, `height` (its card or frame) within its frame, and `pill`.
function arrange(root) {
  return measure(root);
}

function measure(item) {
  const { node } = item;
  item.room = node.pill ? node.pill.room + PILL_GAP : 0;
  if (item.isFrame) {
    measureFrame(item);
  } else {
    item.width = node.width;
    item.height = node.height;
  }
  item.outer = Math.max(item.height, node.pill ? node.pill.height : 0);
  return item;
}

function measureFrame(item) {
  const [inner] = item.children;
  for (const below of inFrame(inner)) measure(below);
  const { flextree } = picktreeLibraries;
  const layout = flextree({
    children: (below) => (below.open && !below.isCall ? below.children : []),
    nodeSize: ({ data }) => [data.outer + BETWEEN, data.room + data.width + BESIDE],
    spacing: 0,
  });
  const placed = layout(layout.hierarchy(inner)).nodes;
  const top = Math.min(...placed.map((spot) => spot.x - spot.data.outer / 2));
  const { header } = item.node;
  let right = 0;
  let bottom = 0;
  for (const spot of placed) {
    const below = spot.data;
    below.x = Math.round(spot.y) + INSET;
    below.middle = Math.round(spot.x - top) + header.height + INSET;
    below.y = below.middle - Math.round(below.height / 2);
    right = Math.max(right, below.x + below.room + below.width);
    bottom = Math.max(bottom, below.middle + Math.round(below.outer / 2));
  }
  item.width = Math.max(right + INSET, header.width + INSET);
  item.height = bottom + INSET;
  item.height += item.height % 2;
}

// The items that stand in the same frame as `root`, itself included.
function* inFrame(root) {
  yield root;
  if (root.open && !root.isCall) for (const child of root.children) yield* inFrame(child);
}

// Paths of all nodes, opened or not, of which `fits(node, tree)` holds; at most `most`.
function searchPaths(root, fits, most) {
  const found = [];
  const visit = (node, path, chart) => {
    if (found.length >= most) return;
    if (fits(node)) found.push(path);
    const tree = chart.trees[node.calls];
    for (const child of tree ? [tree.root] : node.children) visit(child, `${path}/${child.name}`, chart);
  };
  visit(root.node, root.path, root.chart);
  return found;
}

if (typeof module !== "undefined") {
  module.exports = { Item, arrange, inFrame, openUpTo, openWhile, rootItem, searchPaths };
}
