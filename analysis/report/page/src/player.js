// Where the reader is in the run. All panels follow it, and any panel may move it.
//
//   time, tick          simulated s; number of the last tick at that time or before
//   times               time of every tick, s
//   begin, end          of the run, s
//   failures            [{time, tick, node, cause, item, fate}], in order; a failure's number is its place
//   node, failure       what is chosen: a node's path or null, a failure's number or null
//   playing, speed
//
// onTime(cb): cb(time, tick) after every move, at most once a frame; onTick(cb): cb(tick, time) only when the
// tick is another. onSelect(cb): cb(path). onFailure(cb): cb(number). onPlay(cb): cb(playing, speed). Each
// calls back once at the start as well, and returns a function that ends it.

export class Player {
  constructor(run) {
    this.times = run.times.length ? run.times : new Float64Array([0]);
    this.begin = this.times[0];
    this.end = this.times[this.times.length - 1];
    this.failures = run.failures;
    this.time = this.begin;
    this.tick = 0;
    this.node = null;
    this.failure = null;
    this.playing = false;
    this.speed = 1;
    this.listeners = { time: new Set(), tick: new Set(), select: new Set(), failure: new Set(), play: new Set() };
    this.shown = { time: NaN, tick: -1 };
    this.asked = false;
    this.before = null;
  }

  // Calls everyone once; before it, subscriptions are only noted.
  start() {
    this.started = true;
    for (const [kind, listeners] of Object.entries(this.listeners)) {
      for (const callback of listeners) this.tell(kind, callback);
    }
  }

  onTime(callback) { return this.subscribe("time", callback); }
  onTick(callback) { return this.subscribe("tick", callback); }
  onSelect(callback) { return this.subscribe("select", callback); }
  onFailure(callback) { return this.subscribe("failure", callback); }
  onPlay(callback) { return this.subscribe("play", callback); }

  // The last tick at `time` or before.
  tickAt(time) {
    let [low, high] = [0, this.times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[middle] <= time + 1e-6) low = middle + 1;
      else high = middle;
    }
    return Math.max(low - 1, 0);
  }

  seek(time) {
    if (!Number.isFinite(time)) return;
    this.time = Math.min(Math.max(time, this.begin), this.end);
    this.tick = this.tickAt(this.time);
    this.request();
  }

  seekTick(tick) {
    this.seek(this.times[Math.min(Math.max(tick, 0), this.times.length - 1)]);
  }

  // By whole ticks; from between two ticks it goes to the nearest in that direction.
  step(ticks) {
    const between = this.time > this.times[this.tick] + 1e-6;
    this.seekTick(this.tick + ticks + (between && ticks < 0 ? 1 : 0));
  }

  play() {
    if (this.playing) return;
    if (this.time >= this.end) this.seek(this.begin);
    this.playing = true;
    this.before = null;
    this.told("play");
    this.request();
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.told("play");
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  setSpeed(speed) {
    this.speed = speed;
    this.told("play");
  }

  selectNode(path) {
    this.node = path;
    this.told("select");
  }

  // Chooses a failure, goes to its tick and chooses its node; null chooses none.
  selectFailure(number) {
    const failure = number === null ? null : this.failures[number];
    if (failure === undefined) return;
    this.failure = number;
    if (failure) {
      this.pause();
      this.seek(failure.time);
      this.selectNode(failure.node);
    }
    this.told("failure");
  }

  // The next failure in time for 1, the one before for -1; stays where there is none.
  stepFailure(direction) {
    const here = this.failure !== null && this.failures[this.failure]?.time === this.time ? this.failure : null;
    if (here !== null) {
      if (this.failures[here + direction]) this.selectFailure(here + direction);
      return;
    }
    const numbers = [...this.failures.keys()];
    const found =
      direction > 0
        ? numbers.find((n) => this.failures[n].time > this.time + 1e-6)
        : numbers.findLast((n) => this.failures[n].time < this.time - 1e-6);
    if (found !== undefined) this.selectFailure(found);
  }

  // Telling.

  subscribe(kind, callback) {
    this.listeners[kind].add(callback);
    if (this.started) this.tell(kind, callback);
    return () => this.listeners[kind].delete(callback);
  }

  tell(kind, callback) {
    const words = {
      time: [this.time, this.tick],
      tick: [this.tick, this.time],
      select: [this.node],
      failure: [this.failure],
      play: [this.playing, this.speed],
    };
    // One panel's fault is not to stop the others.
    try {
      callback(...words[kind]);
    } catch (error) {
      console.error(error);
    }
  }

  told(kind) {
    if (!this.started) return;
    for (const callback of this.listeners[kind]) this.tell(kind, callback);
  }

  request() {
    if (this.asked || !this.started) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    if (this.playing) {
      // A tab that was away does not jump ahead when it comes back.
      const passed = this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.25);
      this.before = now;
      this.time = Math.min(this.time + passed * this.speed, this.end);
      this.tick = this.tickAt(this.time);
      if (this.time >= this.end) this.pause();
      else this.request();
    }
    if (this.time !== this.shown.time) {
      this.shown.time = this.time;
      this.told("time");
    }
    if (this.tick !== this.shown.tick) {
      this.shown.tick = this.tick;
      this.told("tick");
    }
  }
}
