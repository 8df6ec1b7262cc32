// Which nodes have a row among the lanes: the tree as it is opened, all of it or a part.

export class Rows {
  constructor(visits) {
    this.visits = visits;
    this.nodes = visits.nodes;
    this.below = this.nodes.map(() => []);
    this.depth = [];
    for (const [number, { parent }] of this.nodes.entries()) {
      if (parent >= 0) this.below[parent].push(number);
      this.depth.push(parent < 0 ? 0 : this.depth[parent] + 1);
    }
    this.ran = this.spread((number) => visits.byNode[number].length > 0);
    this.failed = this.spread((number) => visits.failing[number].length > 0);
    this.closed = new Set();
    this.filter = "ran";
    this.words = [];
  }

  // The nodes of which it holds, and all above them.
  spread(holds) {
    const found = new Uint8Array(this.nodes.length);
    for (let number = this.nodes.length - 1; number >= 0; number -= 1) {
      if (!found[number] && !holds(number)) continue;
      found[number] = 1;
      if (this.nodes[number].parent >= 0) found[this.nodes[number].parent] = 1;
    }
    return found;
  }

  search(text) {
    this.words = text.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (number) => {
      const { id, name } = this.nodes[number];
      const said = `${id} ${name}`.toLowerCase();
      return this.words.every((word) => said.includes(word));
    };
    this.hits = this.words.length ? new Set([...this.nodes.keys()].filter(fits)) : null;
    this.around = this.hits ? this.spread((number) => this.hits.has(number)) : null;
  }

  // Numbers of the nodes that have a row, from the top down. What is searched for opens what is above it.
  shown() {
    const kept = { all: null, ran: this.ran, failed: this.failed }[this.filter];
    const found = [];
    const visit = (number) => {
      if (this.around ? !this.around[number] : kept && !kept[number]) return;
      found.push(number);
      if (!this.around && this.closed.has(number)) return;
      this.below[number].forEach(visit);
    };
    for (const [number, { parent }] of this.nodes.entries()) if (parent < 0) visit(number);
    return found;
  }

  isOpen(number) {
    return this.around ? true : !this.closed.has(number);
  }

  toggle(number) {
    if (!this.below[number].length) return;
    if (!this.closed.delete(number)) this.closed.add(number);
  }

  openAll(open) {
    this.closed.clear();
    if (open) return;
    for (const [number, { parent }] of this.nodes.entries()) {
      if (parent >= 0 && this.below[number].length) this.closed.add(number);
    }
  }

  // Opens what is above a node, and shows everything where the filter would hide it.
  reveal(number) {
    for (let above = this.nodes[number].parent; above >= 0; above = this.nodes[above].parent) {
      this.closed.delete(above);
    }
    const kept = { all: null, ran: this.ran, failed: this.failed }[this.filter];
    if (kept && !kept[number]) this.filter = "all";
    if (this.around && !this.around[number]) this.search("");
  }

  // The failures at or below a node.
  *failuresUnder(number) {
    yield* this.visits.failing[number];
    for (const child of this.below[number]) yield* this.failuresUnder(child);
  }
}
