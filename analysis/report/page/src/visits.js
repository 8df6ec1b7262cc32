// The visits of a run as the lanes' section has them: columns, and for each node the order of its own.

export class Visits {
  constructor({ nodes, outcomes, visits, steps = {} }, times) {
    this.nodes = nodes;
    this.columns = visits;
    this.words = visits.words;
    this.outcomes = outcomes;
    this.times = times;
    this.count = visits.node.length;
    this.stepsOf = steps;
    this.numbers = new Map(nodes.map(({ path }, number) => [path, number]));
    this.byNode = nodes.map(() => []);
    for (let i = 0; i < this.count; i += 1) this.byNode[visits.node[i]].push(i);
    this.failing = this.byNode.map((own) => own.filter((i) => this.failed(i)));
    this.step = times.length > 1 ? times[1] - times[0] : 0.05; // a status holds until the next tick
  }

  start(i) {
    return this.times[this.columns.first[i]];
  }

  end(i) {
    return this.times[this.columns.last[i]];
  }

  // Where its bar ends: what began and ended in one tick still lasted that tick.
  until(i) {
    const { first, last } = this.columns;
    return first[i] === last[i] ? this.end(i) + this.step : this.end(i);
  }

  outcome(i) {
    return this.outcomes[this.columns.outcome[i]];
  }

  // A failure with a cause; a condition that is false has none.
  failed(i) {
    return this.outcome(i) === "FAILURE" && this.columns.cause[i] > 0;
  }

  // Steps of a skill: name, start, end, outcome.
  steps(i) {
    return this.stepsOf[i] ?? [];
  }

  word(column, i) {
    return this.words[this.columns[column][i]];
  }

  // A failure that came up in this very node.
  failedItself(i) {
    return this.failed(i) && this.word("origin", i) === this.nodes[this.columns.node[i]].path;
  }

  // Place among the node's own visits of the first that ends at `time` or later.
  firstFrom(node, time) {
    const own = this.byNode[node];
    let [low, high] = [0, own.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.until(own[middle]) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The visit that is under way at a tick, or ends in it; else the last before; -1 where there is none.
  at(node, tick) {
    const own = this.byNode[node];
    let [low, high] = [0, own.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.columns.first[own[middle]] <= tick) low = middle + 1;
      else high = middle;
    }
    return low ? own[low - 1] : -1;
  }

  // The node's status at a tick: RUNNING inside a visit, its outcome in the tick in which it ends, else "".
  status(node, tick) {
    const i = this.at(node, tick);
    if (i < 0 || this.columns.last[i] < tick) return "";
    return this.columns.last[i] === tick ? this.outcome(i) : "RUNNING";
  }

  // What it was about, in a word or two.
  about(i) {
    const item = this.word("item", i);
    const attempt = this.columns.attempt[i];
    return item ? (attempt > 1 ? `${item}, attempt ${attempt}` : item) : "";
  }
}
