// Rows that were packed column by column, in the order of time, and found by what they are of.

export class Changes {
  // `keys`: of each row, what it is of; `times`: when it came, in the order of time.
  constructor(keys, times) {
    this.times = times;
    this.rows = new Map();
    for (let row = 0; row < keys.length; row += 1) {
      const key = keys[row];
      if (!this.rows.has(key)) this.rows.set(key, []);
      this.rows.get(key).push(row);
    }
  }

  // The last row of a key at `time` or before; -1 where there is none.
  at(key, time) {
    const rows = this.rows.get(key) ?? [];
    let [low, high] = [0, rows.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[rows[middle]] <= time + 1e-6) low = middle + 1;
      else high = middle;
    }
    return low ? rows[low - 1] : -1;
  }
}
