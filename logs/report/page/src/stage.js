import "./stage.css";

export class Stage {
  constructor(host, section, player) {
    player.onTick((tick) => (host.textContent = `tick ${tick} of ${section.objects}`));
  }
}
