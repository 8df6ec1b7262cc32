// The moment in the page's address: #t=12.35, and &failure=2 or &node=path where one is chosen.

export class Links {
  constructor(player) {
    this.player = player;
    this.written = null;
    this.follow();
    addEventListener("hashchange", () => {
      if (location.hash !== this.written) this.follow();
    });
    player.onTime(() => this.later());
    player.onFailure(() => this.later());
    player.onSelect(() => this.later());
  }

  follow() {
    const said = new URLSearchParams(location.hash.slice(1));
    const { player } = this;
    if (said.has("failure")) player.selectFailure(Number(said.get("failure")) - 1);
    if (said.has("tick")) player.seekTick(Number(said.get("tick")));
    if (said.has("t")) player.seek(Number(said.get("t")));
    if (said.has("node")) player.selectNode(said.get("node"));
  }

  // Not while it plays or is dragged: browsers count changes of the address.
  later() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (this.player.playing) return this.later();
      this.write();
    }, 200);
  }

  write() {
    this.written = hashOf(this.player);
    if (this.written !== location.hash) history.replaceState(null, "", this.written);
  }
}

// Times to the hundredth say a tick of 20 Hz exactly; longer only where ticks are closer than that.
export function hashOf(player) {
  const parts = [`t=${Number(player.time.toFixed(3))}`];
  if (player.failure !== null && player.failures[player.failure].time === player.time) {
    parts.push(`failure=${player.failure + 1}`);
  }
  if (player.node) parts.push(`node=${encodeURI(player.node)}`);
  return `#${parts.join("&")}`;
}
