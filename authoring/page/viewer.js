// The picture in a page: opening and closing, zooming, searching, details, keys.
//
// new PicktreeDrawing(element, chart) draws a chart into the element. A page about a run calls
// setStatuses({path: "RUNNING", …}) at each moment, reveal(path) to show a node, and listens by onselect.

const SVG = "http://www.w3.org/2000/svg";
const READABLE = 0.7; // the smallest scale at which a drawing is shown without being asked for it
const MOST = 3000; // nodes that are drawn at once

class PicktreeDrawing {
  constructor(element, chart, { expand = false } = {}) {
    this.chart = chart;
    this.root = rootItem(chart);
    this.statuses = {};
    this.selected = this.root.path; // where the keys are; shown once somebody chose it
    this.chosen = false;
    this.found = new Set();
    this.covered = { right: 0, bottom: 0 }; // pixels of the element that something else lies on
    this.onselect = () => {};
    this.ontoggle = () => {};
    this.groups = new Map();
    this.edges = []; // lines, each with the path of the node that it leads to
    this.svg = made("svg", { class: "drawing canvas", role: "tree", "aria-label": chart.title });
    this.svg.append(...parsed(`<defs>${chart.definitions}</defs>`));
    this.camera = made("g", {});
    this.svg.append(this.camera);
    element.append(this.svg);
    this.listen();
    if (expand) openUpTo(this.root, MOST);
    else this.openWhatFits();
    this.draw();
    this.begin();
  }

  // Opens sub-trees from the top down for as long as the whole can be read at once.
  openWhatFits() {
    const { width, height } = this.svg.getBoundingClientRect();
    openWhile(this.root, () => {
      arrange(this.root);
      return this.root.width * READABLE <= width && this.root.height * READABLE <= height;
    });
  }

  // Drawing.

  draw() {
    arrange(this.root);
    this.groups.clear();
    const rows = [];
    this.drawFrame(this.root, 0, 0, rows);
    this.camera.innerHTML = rows.join("");
    for (const group of this.camera.querySelectorAll("[data-path]")) {
      this.groups.set(group.dataset.path, group);
    }
    this.edges = [...this.camera.querySelectorAll(".edge")];
    const frames = [...this.root.shown()].filter((item) => item.isFrame);
    this.framed = frames.map((item) => [item, this.groups.get(item.path).querySelector(".titles")]);
    this.keepTitles();
    if (!this.groups.has(this.selected)) this.selected = this.root.path;
    this.paint();
  }

  drawFrame(item, x, y, rows) {
    Object.assign(item, { left: x, top: y });
    const { node, width, height } = item;
    const bar = `M1 ${node.header.height}V8a7 7 0 0 1 7-7H${width - 8}a7 7 0 0 1 7 7V${node.header.height}z`;
    rows.push(
      `<g class="node frame subtree ${item.level > 1 ? "called" : ""}" ${aria(item)} transform="translate(${x} ${y})">`,
      `<rect class="sheet" width="${width}" height="${height}" rx="8"/><path class="bar" d="${bar}"/>`,
      `<g class="titles">${node.header.svg}</g>`,
      item.level > 1 ? knob(width - 14, 14, "−") : "",
      "</g>",
    );
    for (const below of inFrame(item.children[0])) {
      if (below.parent !== item) rows.push(edge(below.parent, below, x, y));
    }
    for (const below of inFrame(item.children[0])) this.drawItem(below, x, y, rows);
  }

  drawItem(item, x, y, rows) {
    const { node, room } = item;
    if (node.pill) {
      const top = y + item.middle - node.pill.height / 2;
      rows.push(`<g transform="translate(${x + item.x} ${top})">${node.pill.svg}</g>`);
    }
    const [left, top] = [x + item.x + room, y + item.y];
    if (item.isFrame) {
      this.drawFrame(item, left, top, rows);
      return;
    }
    Object.assign(item, { left, top });
    const button = item.canOpen
      ? knob(item.width + 11, item.height / 2, item.open ? "−" : "+")
      : "";
    rows.push(
      `<g class="node ${node.classes}" ${aria(item)} transform="translate(${left} ${top})">${node.svg}${button}</g>`,
    );
  }

  // Titles of frames that begin left of the view stay in it.
  keepTitles() {
    const { x, k } = this.transform;
    for (const [item, titles] of this.framed) {
      const room = item.width - item.node.header.width - 30;
      const shift = Math.max(Math.min(-x / k - item.left, room), 0);
      titles.setAttribute("transform", `translate(${shift} 0)`);
    }
  }

  paint() {
    for (const [path, group] of this.groups) {
      const status = (this.statuses[path] || "").toLowerCase();
      for (const word of ["running", "success", "failure", "skipped"]) {
        group.classList.toggle(word, word === status);
      }
      group.classList.toggle("found", this.found.has(path));
      group.classList.toggle("selected", this.chosen && path === this.selected);
      group.setAttribute("tabindex", path === this.selected ? "0" : "-1");
    }
    for (const edge of this.edges) {
      const status = this.statuses[edge.dataset.to];
      edge.classList.toggle("running", status === "RUNNING");
      edge.classList.toggle("failure", status === "FAILURE");
    }
  }

  // What a page may call.

  setStatuses(statuses) {
    this.statuses = statuses || {};
    this.paint();
  }

  // The item at a path, with all above it opened; null where there is none.
  reveal(path) {
    const item = this.root.find(path);
    if (!item) return null;
    let changed = false;
    for (let above = item.parent; above; above = above.parent) {
      changed ||= !above.open;
      above.open = true;
    }
    if (changed) this.draw();
    return item;
  }

  select(path, { centre = false, focus = false } = {}) {
    const item = this.reveal(path);
    if (!item) return;
    this.selected = path;
    this.chosen = true;
    this.paint();
    this.onselect(item);
    if (centre) this.centre(item);
    else this.bring(item);
    if (focus) this.groups.get(path).focus({ preventScroll: true });
  }

  toggle(item) {
    if (!item.canOpen || item === this.root) return;
    const [left, top] = [item.left, item.top + (item.isFrame ? item.node.header.height : item.height) / 2];
    item.open = !item.open;
    this.draw();
    // What was touched stays under the finger.
    const now = item.top + (item.isFrame ? item.node.header.height : item.height) / 2;
    const { k } = this.transform;
    this.moveBy((left - item.left) * k, (top - now) * k);
    this.ontoggle(item);
  }

  openAll(open) {
    const close = (item) => {
      if (item.isCall && item !== this.root) item.open = false;
      else item.children.forEach(close);
    };
    if (open) openUpTo(this.root, MOST);
    else close(this.root);
    this.draw();
    this.begin();
  }

  search(text) {
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (node) => words.every((word) => node.words.includes(word));
    const paths = words.length ? searchPaths(this.root, fits, 2000) : [];
    this.found = new Set(paths);
    this.paint();
    return paths;
  }

  // The view.

  get space() {
    const { width, height } = this.svg.getBoundingClientRect();
    return { width: width - this.covered.right, height: height - this.covered.bottom };
  }

  get transform() {
    return this.now || picktreeLibraries.zoomIdentity;
  }

  view(x, y, k) {
    const { zoomIdentity } = picktreeLibraries;
    this.selection.call(this.zoom.transform, zoomIdentity.translate(x, y).scale(k));
  }

  moveBy(x, y) {
    const { transform } = this;
    this.view(transform.x + x, transform.y + y, transform.k);
  }

  scaleBy(factor) {
    this.selection.call(this.zoom.scaleBy, factor);
  }

  fit() {
    const { width, height } = this.space;
    const { root } = this;
    const k = Math.min((width - 24) / root.width, (height - 24) / root.height, 1.25);
    this.view((width - root.width * k) / 2, Math.max((height - root.height * k) / 2, 12), k);
  }

  // The whole where it can be read so, else the root in readable size.
  begin() {
    const { width, height } = this.space;
    const { root } = this;
    const k = Math.min((width - 24) / root.width, (height - 24) / root.height);
    if (k >= READABLE) {
      this.fit();
      return;
    }
    const scale = 0.85;
    const first = root.children[0];
    const centred = height / 2 - (first.top + first.height / 2) * scale;
    const highest = Math.max((height - root.height * scale) / 2, 12);
    this.view(12, Math.min(Math.max(centred, height - root.height * scale - 12), highest), scale);
  }

  centre(item) {
    const { width, height } = this.space;
    const { k } = this.transform;
    const down = item.isFrame ? item.node.header.height : item.height;
    const across = Math.min(item.width, width / k);
    this.view(width / 2 - (item.left + across / 2) * k, height / 2 - (item.top + down / 2) * k, k);
  }

  // The item in the middle, but no more than a margin beyond the drawing's right and lower ends.
  look(item) {
    this.centre(item);
    const { width, height } = this.space;
    const { x, y, k } = this.transform;
    const within = (start, size, room) => Math.max(start, Math.min(room - size - 12, 12));
    this.view(within(x, this.root.width * k, width), within(y, this.root.height * k, height), k);
  }

  // Moves the view only as far as the item is out of it.
  bring(item) {
    const box = this.space;
    const { x, y, k } = this.transform;
    const down = item.isFrame ? item.node.header.height : item.height;
    const across = item.isFrame ? Math.min(item.width, 200) : item.width;
    const edgeOf = (start, size, room) =>
      start < 16 ? 16 - start : start + size > room - 16 ? Math.max(room - 16 - start - size, 16 - start) : 0;
    const right = edgeOf(item.left * k + x, across * k, box.width);
    const lower = edgeOf(item.top * k + y, down * k, box.height);
    if (right || lower) this.moveBy(right, lower);
  }

  // Listening.

  listen() {
    const { select, zoom } = picktreeLibraries;
    this.selection = select(this.svg);
    this.zoom = zoom()
      .scaleExtent([0.05, 4])
      .on("zoom", (event) => {
        this.now = event.transform;
        this.camera.setAttribute("transform", event.transform);
        this.keepTitles();
      });
    this.selection.call(this.zoom).on("dblclick.zoom", null);
    this.svg.addEventListener("click", (event) => {
      const item = this.itemAt(event.target);
      if (!item) return;
      if (event.target.closest(".knob")) {
        this.selected = item.path;
        this.toggle(item);
      } else {
        this.select(item.path, { focus: true });
      }
    });
    this.svg.addEventListener("dblclick", (event) => {
      const item = this.itemAt(event.target);
      if (item && !event.target.closest(".knob")) this.toggle(item);
    });
    this.svg.addEventListener("keydown", (event) => this.key(event));
  }

  itemAt(target) {
    const group = target.closest("[data-path]");
    return group ? this.root.find(group.dataset.path) : null;
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const items = [...this.root.shown()];
    const item = this.root.find(this.selected) || this.root;
    const index = items.indexOf(item);
    const go = (other) => other && this.select(other.path, { focus: true });
    const actions = {
      ArrowDown: () => go(items[index + 1]),
      ArrowUp: () => go(items[index - 1]),
      ArrowRight: () => (item.canOpen && !item.open ? this.toggle(item) : go(item.children[0])),
      ArrowLeft: () => (item.open && item.canOpen && item !== this.root ? this.toggle(item) : go(item.parent)),
      Home: () => go(items[0]),
      End: () => go(items[items.length - 1]),
      Enter: () => this.toggle(item),
      " ": () => this.toggle(item),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
    const group = this.groups.get(this.selected);
    if (group) group.focus({ preventScroll: true });
  }
}

// A node's accessible name and state, and its path.
function aria(item) {
  const { node } = item;
  const name = `${node.pill ? `${node.pill.label}: ` : ""}${node.title}`;
  const expanded = item.canOpen ? ` aria-expanded="${item.open}"` : "";
  return `role="treeitem" aria-level="${item.level}"${expanded} aria-label="${escaped(name)}" data-path="${escaped(item.path)}" tabindex="-1"`;
}

function knob(x, y, sign) {
  const stroke = sign === "+" ? "M-4 0h8M0-4v8" : "M-4 0h8";
  return `<g class="knob" transform="translate(${x} ${y})"><circle class="reach" r="15"/><circle class="disc" r="8"/><path d="${stroke}"/></g>`;
}

function edge(above, below, x, y) {
  const from = x + above.x + above.room + above.width;
  const start = y + above.middle;
  const to = x + below.x;
  const end = y + below.middle;
  const bend = (from + to) / 2;
  const over = start === end ? `H${to}` : `C${bend} ${start} ${bend} ${end} ${to} ${end}`;
  return `<path class="edge ${below.node.role}" data-to="${escaped(below.path)}" d="M${from} ${start}${over}H${to + below.room}"/>`;
}

function made(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function parsed(text) {
  const holder = made("g", {});
  holder.innerHTML = text;
  return [...holder.childNodes];
}

function escaped(text) {
  return text.replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);
}
