// The way of the ticks in time: a lane for each leaf that was active in the last half minute.

import { memo, useMemo } from "react";

import type { LiveState, Status, Transition } from "./state";
import { counted } from "../ui/words";

const SPAN = 30; // s
const MOST = 40;

interface Bar {
  from: number;
  to: number;
  status: Status;
  title: string;
}

export const Lanes = memo(function Lanes({ state }: { state: LiveState }) {
  const leaves = useMemo(() => new Set(state.tree.filter((node) => !node.children.length).map((node) => node.path)), [state.tree]);
  const lanes = useMemo(() => lanesOf(state.transitions, leaves, state.time), [state.transitions, leaves, state.time]);
  const start = state.time - SPAN;
  if (!lanes.length) return <p className="muted live-none">No leaf has run yet.</p>;
  return (
    <ul className="live-lanes" tabIndex={0} aria-label="Lanes of the leaves">
      {lanes.map(([path, bars]) => (
        <li key={path}>
          <span className="lane-name" title={path}>{path.split("/").pop()}</span>
          <span className="lane" role="img" aria-label={`${counted(bars.length, "time")}; last: ${bars[bars.length - 1]!.title}`}>
            {bars.map((bar) => (
              <i key={bar.from} className={bar.status.toLowerCase()} title={bar.title}
                style={{ left: `${(100 * Math.max(bar.from - start, 0)) / SPAN}%`, width: `max(3px, ${(100 * (bar.to - Math.max(bar.from, start))) / SPAN}%)` }}>
                {bar.status === "FAILURE" ? "✗" : ""}
              </i>
            ))}
          </span>
        </li>
      ))}
    </ul>
  );
});

// Leaves in the order of their first start, each with its bars.
function lanesOf(transitions: Transition[], leaves: Set<string>, now: number): [string, Bar[]][] {
  const lanes = new Map<string, Bar[]>();
  for (const [time, path, status, subject, cause] of transitions) {
    if (!leaves.has(path)) continue;
    let bars = lanes.get(path);
    if (!bars) lanes.set(path, (bars = []));
    const last = bars[bars.length - 1];
    if (status === "RUNNING") bars.push({ from: time, to: now, status, title: `${subject || path.split("/").pop()} since ${time.toFixed(2)} s` });
    else if (last?.status === "RUNNING") {
      Object.assign(last, { to: time, status, title: `${last.title.split(" since ")[0]}: ${status.toLowerCase()}${cause ? `, ${cause}` : ""}, ${last.from.toFixed(2)}–${time.toFixed(2)} s` });
    }
  }
  const found: [string, Bar[]][] = [];
  for (const [path, bars] of lanes) {
    const shown = bars.filter((bar) => bar.to >= now - SPAN);
    if (shown.length) found.push([path, shown]);
  }
  return found.slice(-MOST);
}
